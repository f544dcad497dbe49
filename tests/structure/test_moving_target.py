"""Poses on a learned structure, the twist filter and its smoother, replay of earlier passages."""

import numpy as np
import pytest

from camnet.errors import DataError
from camnet.estimation.structure.moving import twist_filter as tw
from camnet.estimation.structure.moving.known_points import track_poses
from camnet.estimation.structure.moving.replay import PoseRecord, Replay, ReplaySettings
from camnet.estimation.structure.moving.rest import learn_at_rest
from camnet.estimation.structure.odometry import Odometry, OdometryErrors
from camnet.geometry import rotations as rot

BODY = np.random.default_rng(3).uniform(-0.3, 0.3, (12, 3))


def images(t, noise, rng):
    p = np.column_stack([np.sin(0.3 * t), 0.2 * np.cos(t), 4.0 + np.cos(0.2 * t)])
    q = rot.exp(np.column_stack([0.2 * np.sin(t), 0.3 * t, 0.1 * np.cos(t)]))
    x = rot.rotate(q[:, None], BODY) + p[:, None]
    xy = x[..., :2] / x[..., 2:]
    return p, q, xy + noise * rng.standard_normal(xy.shape)


def test_poses_on_known_points_are_exact_without_noise_and_found_again_after_a_gap():
    t = np.arange(0.0, 6.0, 0.1)
    p, q, xy = images(t, 0.0, np.random.default_rng(0))
    xy[20:40] = np.nan
    xy[45, :9] = np.nan  # three points give no pose
    track = track_poses(t, xy, BODY, 1e-3)
    gone = np.isin(np.arange(60), [*range(20, 40), 45])
    np.testing.assert_array_equal(track.seen, ~gone)
    assert np.isnan(track.p[gone]).all()
    np.testing.assert_allclose(track.p[~gone], p[~gone], atol=1e-7)
    assert rot.angle_between(track.q[~gone], q[~gone]).max() < 1e-7


def test_errors_of_poses_have_the_stated_covariance():
    t = np.arange(0.0, 12.0, 0.05)
    p, q, xy = images(t, 1e-3, np.random.default_rng(1))
    track = track_poses(t, xy, BODY, 1e-3)
    e = np.concatenate([p - track.p, rot.log(rot.multiply(rot.conjugate(track.q), q))], axis=1)
    nees = np.einsum("ki,kij,kj->k", e, np.linalg.inv(track.covariance), e)
    # mean of 240 chi-square variables of 6 degrees: 6 +- 4 SD
    assert abs(nees.mean() - 6.0) < 4.0 * np.sqrt(12.0 / len(t))


def simulate(rng, count=400, dt=0.1):
    """A target with the filter's own model, measured with a covariance that is not diagonal."""
    s = tw.TwistFilterSettings()
    p, q = np.zeros(3), rot.exp([0.1, 0.2, 0.3])
    v, w = np.array([0.3, 0.0, 0.0]), np.array([0.0, 0.02, 0.15])
    root = np.tril(rng.uniform(-0.02, 0.02, (6, 6))) + 0.02 * np.eye(6)
    flow = tw.TwistFilter(s)
    truth = []
    for k in range(count):
        e = root @ rng.standard_normal(6)
        flow.update(k * dt, p + e[:3], rot.multiply(q, rot.exp(e[3:])), root @ root.T)
        truth.append((p, q, v, w))
        for _ in range(5):
            p, q = tw._coasted(p, q, v, w, dt / 5.0)
            v = v + np.sqrt(s.accel_psd_m2ps3 * dt / 5.0) * rng.standard_normal(3)
            w = w + np.sqrt(s.angular_psd_rad2ps3 * dt / 5.0) * rng.standard_normal(3)
    return flow, truth


def errors(state, truth):
    p, q, v, w = truth
    return np.concatenate(
        [p - state.p, rot.log(rot.multiply(rot.conjugate(state.q), q)), v - state.v_body, w - state.w_body]
    )


def test_the_filter_and_its_smoother_know_how_wrong_they_are():
    filtered, smoothed, square, square_s = [], [], [], []
    for seed in range(20):
        flow, truth = simulate(np.random.default_rng(seed), 80)
        for out, squares, states in (
            (filtered, square, flow.stretch),
            (smoothed, square_s, flow.smooth()),
        ):
            e = errors(states[50], truth[50])
            out.append(e @ np.linalg.solve(states[50].covariance, e))
            squares.append(e * e)
    # 20 independent runs of 12 degrees of freedom: two-sided 99.9 % interval of the mean
    for nees in (filtered, smoothed):
        assert 12.0 - 3.3 * np.sqrt(24.0 / 20.0) < np.mean(nees) < 12.0 + 3.5 * np.sqrt(24.0 / 20.0)
    assert (np.mean(square_s, axis=0) < np.mean(square, axis=0)).sum() >= 11


def test_the_transition_is_the_derivative_of_the_motion():
    p, q = np.array([1.0, 2.0, 0.5]), rot.exp([0.3, -0.2, 0.9])
    v, w, dt, h = np.array([0.3, 0.1, -0.1]), np.array([0.1, 0.2, 0.4]), 0.05, 1e-6
    _, _, _, f = tw._predict(p, q, v, w, np.eye(12), dt, 1e-4, 1e-4)

    def moved(dx):
        return tw._coasted(p + dx[:3], rot.multiply(q, rot.exp(dx[3:6])), v + dx[6:9], w + dx[9:], dt)

    p0, q0 = moved(np.zeros(12))
    for k, axis in enumerate(np.eye(12)):
        p1, q1 = moved(h * axis)
        change = np.concatenate([p1 - p0, rot.log(rot.multiply(rot.conjugate(q0), q1))]) / h
        # first order in dt: what is left out is of its square
        np.testing.assert_allclose(change, f[:6, k], atol=dt**2)


def test_coasting_at_a_constant_twist_is_a_circle():
    state = tw.TwistState(
        0.0, np.zeros(3), rot.exp(np.zeros(3)), np.array([0.4, 0, 0]), np.array([0, 0, 0.2]), np.eye(12)
    )
    p, q = tw.coast(state, 7.0)
    np.testing.assert_allclose(p, [2.0 * np.sin(1.4), 2.0 * (1.0 - np.cos(1.4)), 0.0], atol=1e-4)
    assert rot.yaw_of(q) == pytest.approx(1.4)


def on_circle(t, speed=0.3, radius=2.0, side=1.0):
    """State on a circle; ``side`` -1 turns the other way."""
    a = speed / radius * t
    p = np.array([radius * np.sin(a), side * radius * (1.0 - np.cos(a)), 0.0])
    w = np.array([0.0, 0.0, side * speed / radius])
    return p, rot.from_yaw(side * a), np.array([speed, 0.0, 0.0]), w


def stretch(start, end, clock=0.0, **motion):
    t = np.arange(start, end, 0.1)
    return [tw.TwistState(x + clock, *on_circle(x, **motion), np.eye(12)) for x in t]


LAP = 2.0 * np.pi * 2.0 / 0.3


def test_before_anything_was_seen_twice_replay_is_the_coordinated_turn():
    replay = Replay(ReplaySettings())
    seen = stretch(0.0, 15.0)
    replay.add(seen)
    (future,) = replay.futures(12.0)
    np.testing.assert_allclose(future.p, tw.coast(seen[-1], 12.0)[0], atol=1e-12)


def test_an_earlier_passage_is_followed_also_where_the_twist_says_otherwise():
    replay = Replay(ReplaySettings())
    replay.add(stretch(0.0, LAP + 10.0))
    # the last state's twist is wrong: the record, not the twist, carries on
    last = replay._stretch[-1]
    replay._stretch[-1] = tw.TwistState(last.t_s, last.p, last.q, last.v_body, np.zeros(3), last.covariance)
    (future,) = replay.futures(15.0)
    np.testing.assert_allclose(future.p, on_circle(last.t_s + 15.0)[0], atol=0.02)
    assert future.weight == 1.0


def test_a_target_in_motion_does_not_stop_where_it_once_rested():
    still = [
        tw.TwistState(x, *on_circle(0.0)[:2], np.zeros(3), np.zeros(3), np.eye(12))
        for x in np.arange(0, 10, 0.1)
    ]
    replay = Replay(ReplaySettings())
    replay.add(still + stretch(0.0, LAP - 3.0, clock=10.0))
    (future,) = replay.futures(10.0)
    assert np.linalg.norm(future.p - on_circle(LAP + 7.0)[0]) < 0.2


def test_a_fork_gives_two_futures_and_a_bridge_closes_a_gap():
    replay = Replay(ReplaySettings())
    replay.add(stretch(0.0, 14.0))
    replay.add(stretch(-6.0, 14.0, clock=40.0, side=-1.0))
    replay.add(stretch(-6.0, 0.1, clock=80.0))
    futures = replay.futures(12.0)
    ends = [on_circle(12.0)[0], on_circle(12.0, side=-1.0)[0]]
    assert len(futures) == 2
    assert sum(f.weight for f in futures) == pytest.approx(1.0)
    for end in ends:
        assert min(np.linalg.norm(f.p - end) for f in futures) < 0.05
    record = replay.record
    assert not record.seen[(record.t_s > 14.0) & (record.t_s < 33.9)].any()
    assert np.max(np.diff(record.t_s)) < 0.25


def test_a_bridge_over_a_steady_turn_is_that_turn():
    record = PoseRecord(0.1)
    record.add(stretch(0.0, 5.0))
    record.add(stretch(17.0, 20.0))
    for t in (8.0, 11.0, 14.0):
        p, seen = record.at(t)
        assert not seen
        np.testing.assert_allclose(p, on_circle(t)[0], atol=0.01)


def test_a_target_known_to_change_its_pace_is_followed_at_its_present_one():
    replay = Replay(ReplaySettings())
    clock = 0.0
    for speed in (0.3, 0.24, 0.36, 0.25, 0.33):
        lap = 2.0 * np.pi * 2.0 / speed
        replay.add(stretch(0.0, lap - 1.0, clock=clock, speed=speed))
        clock += lap
    replay.add(stretch(0.0, 20.0, clock=clock, speed=0.24))
    best = replay.futures(15.0)[0]
    assert np.linalg.norm(best.p - on_circle(20.0 + 15.0, speed=0.24)[0]) < 0.25


def test_too_few_points_teach_nothing_and_are_refused():
    odometry = Odometry(np.array([0.0, 1.0]), np.zeros((2, 3)), np.zeros((2, 3)))
    with pytest.raises(DataError, match="two images must see four points"):
        learn_at_rest(np.array([0.0, 1.0]), np.zeros((2, 3, 2)), 1e-3, odometry, OdometryErrors(), 0.01)
