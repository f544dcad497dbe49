"""Poses read from features and from images: right without noise, refused when implausible, one contract for all."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from camnet.errors import ConfigError
from camnet.geometry import rotations as rot
from camnet.geometry.settings import CameraModel, Intrinsics
from camnet.sensing.pnp import BranchKeeper, Candidate
from camnet.sensing.pose_sensor import PoseSensor
from camnet.sensing.readers import FeatureReader, ImageReader, develop, surroundings
from camnet.sensing.settings import FeatureSettings, ImageSettings, SensingSettings
from camnet.sensing.vision_sensor import build_sensor
from camnet.types import Snapshot

FLAT = np.array([(0.12, 0.12, 0.3), (0.12, -0.12, 0.3), (-0.12, -0.12, 0.3), (-0.12, 0.12, 0.3)])
SOLID = np.array([*FLAT[:3], (-0.1, 0.1, 0.1), (0.0, 0.0, 0.4)])
LENS = Intrinsics(width_px=320, height_px=240, fx_px=300.0, fy_px=305.0, cx_px=158.0, cy_px=121.0)
BENT = LENS.model_copy(update={"distortion": (-0.2, 0.05, 1e-3, -1e-3)})
NONE = np.zeros((0, 3))


def scene(t=0.0, eye=(0.4, 0.3, 1.8), p=(0.0, 0.0, 0.0), turn=0.3):
    eye = np.array(eye)
    q_cam = rot.look_at(eye, np.array([0.0, 0.0, 0.3]))
    rows = (eye[None], q_cam[None], np.zeros((1, 3)), np.zeros((1, 3)), np.array([p], float))
    rows += (rot.from_yaw(turn)[None], np.zeros((1, 3)), np.zeros((1, 3)))
    return Snapshot(t, 0, NONE, np.zeros((0, 4)), NONE, NONE, *rows)


def camera(intrinsics=LENS, far=5.0):
    return CameraModel(name="c", intrinsics=intrinsics, near_m=0.3, far_m=far)


def errors(pose, snapshot):
    q_cam, p_cam = snapshot.camera_q_world[0], snapshot.camera_p_world[0]
    p = rot.rotate(q_cam, pose.p) + p_cam - snapshot.target_p_world[0]
    q = rot.angle_between(rot.multiply(q_cam, pose.q), snapshot.target_q_world[0])
    return float(np.linalg.norm(p)), np.degrees(float(q))


@pytest.mark.parametrize("intrinsics", [LENS, BENT])
@pytest.mark.parametrize(("points", "solver"), [(FLAT, "ippe"), (FLAT, "sqpnp"), (SOLID, "sqpnp"),
                                                (FLAT, "auto"), (SOLID, "auto")])  # fmt: skip
def test_features_without_noise_give_the_pose(intrinsics, points, solver):
    reader = FeatureReader(FeatureSettings(pixel_noise_px=0.0, solver=solver), [camera(intrinsics)], [points])
    for k in range(5):
        snapshot = scene(k / 30, eye=(0.6 * np.cos(k), 0.6 * np.sin(k), 1.7), turn=k)
        p, q = errors(reader.read(snapshot, 0, 0, np.random.default_rng(0)), snapshot)
        assert p < 1e-4
        assert q < 0.05


def test_noise_of_features_is_in_pixels():
    """Twice the pixel noise, twice the error; and the right order: s / f of the distance across the line of sight."""
    spread, middle = [], SOLID.mean(axis=0)
    for noise in (0.1, 0.2):
        reader = FeatureReader(FeatureSettings(pixel_noise_px=noise), [camera()], [SOLID])
        across = []
        for k in range(150):
            snapshot = scene(k / 30)
            pose = reader.read(snapshot, 0, 0, np.random.default_rng(k))
            seen = pose.p + rot.rotate(pose.q, middle)
            in_world = rot.rotate(rot.from_yaw(0.3), middle) - snapshot.camera_p_world[0]
            across.append((seen - rot.rotate(rot.conjugate(snapshot.camera_q_world[0]), in_world))[:2])
        spread.append(np.std(across))
    assert spread[1] / spread[0] == pytest.approx(2.0, rel=0.15)
    assert spread[0] == pytest.approx(0.1 / 300.0 * 1.6 / np.sqrt(5.0), rel=0.4)


def test_what_no_pose_explains_is_refused():
    far = FeatureReader(FeatureSettings(pixel_noise_px=0.0), [camera(far=1.0)], [FLAT])
    assert far.read(scene(), 0, 0, np.random.default_rng(0)) is None
    noisy = FeatureReader(FeatureSettings(pixel_noise_px=8.0, max_reprojection_px=1.0), [camera()], [SOLID])
    read = [noisy.read(scene(k), 0, 0, np.random.default_rng(k)) for k in range(20)]
    assert sum(pose is None for pose in read) > 10
    with pytest.raises(ConfigError, match="one plane"):
        FeatureReader(FeatureSettings(solver="ippe"), [camera()], [SOLID])


@pytest.mark.parametrize("intrinsics", [LENS, BENT])
def test_an_image_gives_the_pose(intrinsics):
    reader = ImageReader(ImageSettings(), [camera(intrinsics)], [FLAT])
    found = []
    for k in range(20):
        snapshot = scene(k / 30, eye=(0.7 * np.cos(k / 5), 0.7 * np.sin(k / 5), 1.7), turn=0.2 * k)
        found.append(errors(reader.read(snapshot, 0, 0, np.random.default_rng(k)), snapshot))
    p, q = np.array(found).T
    assert np.median(p) < 0.004
    assert p.max() < 0.03
    assert np.median(q) < 0.7


def test_an_image_too_dark_or_blurred_gives_nothing():
    blurred = ImageReader(ImageSettings(blur_px=12.0), [camera()], [FLAT])
    assert blurred.read(scene(), 0, 0, np.random.default_rng(0)) is None
    drowned = ImageReader(ImageSettings(noise_levels=200.0), [camera()], [FLAT])
    assert drowned.read(scene(), 0, 0, np.random.default_rng(0)) is None
    away = ImageReader(ImageSettings(), [camera()], [FLAT])
    assert away.read(scene(p=(5.0, 0.0, 0.0)), 0, 0, np.random.default_rng(0)) is None


def test_pybullets_pictures_show_one_instant():
    for option in ({"exposure_s": 0.01}, {"readout_s": 0.01}):
        with pytest.raises(ConfigError, match="one instant"):
            ImageReader(ImageSettings(renderer="pybullet", **option), [camera()], [FLAT], print)
    with pytest.raises(ConfigError, match="renders"):
        ImageReader(ImageSettings(renderer="pybullet"), [camera()], [FLAT])


def test_development_of_a_picture():
    flat, quiet = (
        np.full((40, 40), 100.0, dtype=np.float32),
        {"blur_px": 0.0, "noise_levels": 0.0, "gain_std": 0.0},
    )
    assert (develop(flat, ImageSettings(**quiet), np.random.default_rng(0)) == 100).all()
    noisy = develop(flat, ImageSettings(**quiet | {"noise_levels": 5.0}), np.random.default_rng(0))
    assert noisy.std() == pytest.approx(5.0, rel=0.1)
    gains = [
        develop(flat, ImageSettings(**quiet | {"gain_std": 0.1}), np.random.default_rng(k)).mean()
        for k in range(300)
    ]
    assert np.std(np.log(gains)) == pytest.approx(0.1, rel=0.15)
    ground = surroundings(640, 368, 15.0)
    assert ground.shape == (368, 640)
    assert 8.0 < ground.std() < 20.0
    assert abs(ground.mean() - 110.0) < 6.0


def _two(q_true, q_mirror, true_px, mirror_px):
    both = [Candidate(np.zeros(3), q_true, true_px), Candidate(np.zeros(3), q_mirror, mirror_px)]
    return sorted(both, key=lambda one: one.error_px)


def test_the_branch_follows_the_last_pose_and_gives_way_to_evidence():
    level, q, mirror = rot.IDENTITY, rot.exp([0.3, 0, 0]), rot.exp([-0.3, 0, 0])
    keeper = BranchKeeper(0.1)
    chosen = keeper.choose(_two(q, mirror, 0.1, 0.3), 4, level, 0.0)
    assert chosen.q is q
    # one frame in which noise prefers the other branch changes nothing
    assert keeper.choose(_two(q, mirror, 0.14, 0.12), 4, level, 0.03).q is q
    wrong = BranchKeeper(0.1)
    assert wrong.choose(_two(q, mirror, 0.14, 0.12), 4, level, 0.0).q is mirror
    taken = [wrong.choose(_two(q, mirror, 0.1, 0.15), 4, level, 0.03 * k).q is q for k in range(1, 15)]
    assert not taken[0]
    assert taken[-1]
    assert sorted(taken) == taken  # it changes once
    # after a long time the last pose says nothing
    assert keeper.choose(_two(q, mirror, 0.14, 0.12), 4, level, 60.0).q is mirror


def test_continuity_is_judged_in_the_world():
    """The camera turns by more than the branches differ; the target does not."""
    q, mirror = rot.exp([0.3, 0, 0]), rot.exp([-0.3, 0, 0])
    keeper, q_cam = BranchKeeper(0.1), rot.exp([0.9, 0.2, 0.1])
    keeper.choose(_two(q, mirror, 0.1, 0.2), 4, rot.IDENTITY, 0.0)
    back = rot.conjugate(q_cam)
    two = _two(rot.multiply(back, q), rot.multiply(back, mirror), 0.13, 0.12)
    np.testing.assert_allclose(np.abs(keeper.choose(two, 4, q_cam, 0.03).q @ rot.multiply(back, q)), 1.0)


def _two_by_two(t):
    one = scene(t)
    twice = {}
    for name in Snapshot.__slots__:
        value = getattr(one, name)
        twice[name] = np.concatenate([value] * 2) if name.startswith(("camera", "target")) else value
    return Snapshot(**twice)


@pytest.mark.parametrize("level", ["features", "image"])
def test_the_contract_of_the_pose_sensor_holds(level):
    """Rate, latency, drop-outs; a view's noise does not depend on what else is visible."""

    def sensor(**changes):
        return build_sensor(SensingSettings(level=level, **changes), [camera()] * 2, [FLAT] * 2)

    everything, only = np.ones((2, 2), dtype=bool), np.array([[False, False], [False, True]])
    a, b = sensor(latency_s=0.05, dropout_probability=0.4), sensor(latency_s=0.05, dropout_probability=0.4)
    rng_a, rng_b, count = np.random.default_rng(1), np.random.default_rng(1), 0
    for k in range(24):
        t = k / 60
        full = a.measure(_two_by_two(t), everything, rng_a)
        alone = b.measure(_two_by_two(t), only, rng_b)
        here = [z for z in full if (z.camera, z.target) == (1, 1)]
        assert len(here) == len(alone)
        for x, y in zip(here, alone, strict=True):
            np.testing.assert_array_equal(x.p_cam, y.p_cam)
            assert t - x.t_s == pytest.approx(0.05, abs=1 / 60)
        count += len(full)
    assert 0.35 * 4 * 11 < count < 0.85 * 4 * 11


def test_the_level_decides_the_sensor():
    assert type(build_sensor(SensingSettings(), [camera()], [FLAT])) is PoseSensor
    with pytest.raises(ConfigError, match="rectangle"):
        build_sensor(SensingSettings(level="image"), [camera()], [SOLID])


def test_random_orientations_in_space_are_read_too():
    """A target that is not upright, seen from where it faces."""
    reader, ok = ImageReader(ImageSettings(), [camera()], [FLAT]), 0
    for k, tilt in enumerate(Rotation.random(12, random_state=3).as_rotvec() * 0.25):
        snapshot = scene(float(k))
        q = rot.exp(tilt)
        tilted = Snapshot(
            float(k), 0, NONE, np.zeros((0, 4)), NONE, NONE, snapshot.camera_p_world, snapshot.camera_q_world,
            np.zeros((1, 3)), np.zeros((1, 3)), np.zeros((1, 3)), q[None], np.zeros((1, 3)), np.zeros((1, 3)),
        )  # fmt: skip
        p, turned = errors(reader.read(tilted, 0, 0, np.random.default_rng(k)), tilted)
        ok += p < 0.03 and turned < 3.0
    assert ok >= 10
