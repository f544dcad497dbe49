"""The pose sensor: exact without noise, the stated statistics with it, rate, latency and drop-outs."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from camnet.geometry import rotations as rot
from camnet.sensing.pose_sensor import PoseSensor
from camnet.sensing.settings import SensingSettings
from camnet.types import Snapshot

RNG = np.random.default_rng(4)
N_C, N_M = 3, 2
POSES = {
    "camera_p_world": RNG.normal(size=(N_C, 3)) * 3,
    "camera_q_world": Rotation.random(N_C, random_state=1).as_quat(scalar_first=True),
    "camera_v_world": RNG.normal(size=(N_C, 3)),
    "camera_w_cam": RNG.normal(size=(N_C, 3)),
    "target_p_world": RNG.normal(size=(N_M, 3)) * 3,
    "target_q_world": Rotation.random(N_M, random_state=2).as_quat(scalar_first=True),
    "target_v_world": np.zeros((N_M, 3)),
    "target_w_body": np.zeros((N_M, 3)),
}
ALL = np.ones((N_C, N_M), dtype=bool)


def at(t):
    none = np.zeros((0, 3))
    return Snapshot(t, 0, none, np.zeros((0, 4)), none, none, **POSES)


def sensor(**changes):
    quiet = {"position_noise_m": 0.0, "orientation_noise_rad": 0.0, "rate_hz": 30.0}
    return PoseSensor(SensingSettings(**(quiet | changes)), N_M, N_C)


def homogeneous(p, q):
    t = np.eye(4)
    t[:3, :3], t[:3, 3] = Rotation.from_quat(q, scalar_first=True).as_matrix(), p
    return t


def test_without_noise_it_is_the_relative_pose_of_every_visible_pair():
    visible = np.array([[True, False], [True, True], [False, False]])
    snapshot = at(0.0)
    got = sensor().measure(snapshot, visible, np.random.default_rng(0))
    assert [(z.camera, z.target) for z in got] == [(0, 0), (1, 0), (1, 1)]
    for z in got:
        camera = homogeneous(snapshot.camera_p_world[z.camera], snapshot.camera_q_world[z.camera])
        target = homogeneous(snapshot.target_p_world[z.target], snapshot.target_q_world[z.target])
        np.testing.assert_allclose(homogeneous(z.p_cam, z.q_cam), np.linalg.inv(camera) @ target, atol=1e-12)
        np.testing.assert_array_equal(z.motion.v_world, snapshot.camera_v_world[z.camera])
        np.testing.assert_array_equal(z.motion.w_cam, snapshot.camera_w_cam[z.camera])
        assert z.t_s == 0.0


def test_noise_has_the_stated_spread():
    s = sensor(position_noise_m=0.02, orientation_noise_rad=0.03, rate_hz=1.0)
    rng = np.random.default_rng(7)
    exact = sensor().measure(at(0.0), ALL, rng)[3]
    p, r = [], []
    for k in range(3000):
        z = s.measure(at(float(k)), ALL, rng)[3]
        p.append(z.p_cam - exact.p_cam)
        r.append(rot.log(rot.multiply(z.q_cam, rot.conjugate(exact.q_cam))))
        assert np.linalg.norm(z.q_cam) == pytest.approx(1.0)
    for sample, std in ((np.array(p), 0.02), (np.array(r), 0.03)):
        np.testing.assert_allclose(sample.std(axis=0), std, rtol=0.05)
        np.testing.assert_allclose(sample.mean(axis=0), 0.0, atol=4 * std / np.sqrt(3000))
        np.testing.assert_allclose(np.corrcoef(sample.T), np.eye(3), atol=0.08)


@pytest.mark.parametrize("rate", [30.0, 10.0, 7.0])
def test_frames_come_at_the_rate_whatever_the_step(rate):
    s, rng = sensor(rate_hz=rate), np.random.default_rng(0)
    steps = np.arange(240 * 10) / 240.0
    frames = [t for t in steps if s.measure(at(t), ALL, rng)]
    assert len(frames) == round(10 * rate)
    ideal = np.arange(len(frames)) / rate
    assert np.all((np.array(frames) - ideal >= -1e-6) & (np.array(frames) - ideal < 1 / 240 + 1e-6))


def test_due_says_whether_a_frame_will_be_taken():
    s, rng = sensor(rate_hz=30.0), np.random.default_rng(0)
    for t in np.arange(240) / 240.0:
        due = s.due(t)
        assert due == (len(s.measure(at(t), ALL, rng)) > 0)


def test_latency_delivers_old_frames_late_and_in_order():
    s, rng = sensor(rate_hz=30.0, latency_s=0.1), np.random.default_rng(0)
    delivered = []
    for t in np.arange(240) / 240.0:
        for z in s.measure(at(t), ALL, rng):
            assert t - z.t_s >= 0.1 - 1e-9
            assert t - z.t_s < 0.1 + 1 / 240 + 1e-9
            delivered.append((z.t_s, z.camera, z.target))
    assert delivered == sorted(delivered)
    assert len(delivered) == 27 * N_C * N_M  # frames 0 to 26 of 30


def test_dropouts_have_the_stated_share():
    s, rng = sensor(rate_hz=1.0, dropout_probability=0.3), np.random.default_rng(3)
    n = sum(len(s.measure(at(float(t)), ALL, rng)) for t in range(2000))
    assert n / (2000 * N_C * N_M) == pytest.approx(0.7, abs=0.015)
    certain = sensor(dropout_probability=1.0)
    assert certain.measure(at(0.0), ALL, rng) == []


def test_noise_of_one_pair_does_not_depend_on_what_else_is_visible():
    only = np.zeros_like(ALL)
    only[2, 1] = True
    for dropout in (0.0, 0.4):
        a = sensor(position_noise_m=0.1, orientation_noise_rad=0.1, dropout_probability=dropout)
        b = sensor(position_noise_m=0.1, orientation_noise_rad=0.1, dropout_probability=dropout)
        rng_a, rng_b = np.random.default_rng(5), np.random.default_rng(5)
        for k in range(20):
            full = [z for z in a.measure(at(k / 30), ALL, rng_a) if (z.camera, z.target) == (2, 1)]
            alone = b.measure(at(k / 30), only, rng_b)
            assert len(full) == len(alone)
            for x, y in zip(full, alone, strict=True):
                np.testing.assert_array_equal(x.p_cam, y.p_cam)
                np.testing.assert_array_equal(x.q_cam, y.q_cam)
