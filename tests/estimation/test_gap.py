"""The path across a gap: against a smoother, against known motions, and its windows."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import CubicHermiteSpline

from camnet.estimation.basis import RbfBasis
from camnet.estimation.gap import (
    EndState,
    PoseHistory,
    bridge_path,
    bridge_velocity_variance,
    fit_motion,
    gap_windows,
)
from camnet.estimation.settings import GapSettings
from camnet.geometry import rotations


def _arc(t: float, speed: float = 0.4, rate: float = 0.2) -> EndState:
    """Constant turn."""
    yaw = rate * t
    p = speed / rate * np.array([math.sin(yaw), 1 - math.cos(yaw), 0.0])
    v = speed * np.array([math.cos(yaw), math.sin(yaw), 0.0])
    return EndState(t, p, rotations.from_yaw(yaw), v, np.array([0.0, 0.0, rate]))


def test_regression_is_exact_for_a_constant_turn_at_any_time() -> None:
    t = np.linspace(0, 0.6, 20)
    states = [_arc(s) for s in t]
    p, q = np.array([s.p for s in states]), np.array([s.q for s in states])
    q[::3] *= -1
    for t_eval in (0.0, 0.3, 0.6, 0.9):
        got = EndState(t_eval, *fit_motion(t, p, q, t_eval))
        want = _arc(t_eval)
        np.testing.assert_allclose(got.p, want.p, atol=1e-3)
        np.testing.assert_allclose(got.v, want.v, atol=2e-3)
        np.testing.assert_allclose(got.w, want.w, atol=1e-9)
        assert abs(got.q @ want.q) == pytest.approx(1.0, abs=1e-9)


def test_history_keeps_the_latest_poses() -> None:
    history = PoseHistory(5)
    assert history.fit(0.0) is None
    for k in range(12):
        s = _arc(0.1 * k)
        history.push(s.t_s, s.p, s.q)
    assert history.count == 5
    assert history.middle_s == pytest.approx(0.9)
    state = history.fit(1.1)
    assert state is not None
    np.testing.assert_allclose(state.v, _arc(1.1).v, atol=2e-3)


def test_velocity_variance_of_the_bridge_against_a_fixed_interval_smoother() -> None:
    """Discrete Kalman smoother of a white-acceleration particle pinned at both ends."""
    duration, psd, n = 4.0, 0.3, 400
    dt = duration / n
    f = np.array([[1, dt], [0, 1]])
    noise = psd * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
    cov = [np.zeros((2, 2))]
    for _ in range(n):
        cov.append(f @ cov[-1] @ f.T + noise)
    after = np.zeros((2, 2))  # the end is known exactly
    smoothed = {n: after}
    for k in range(n - 1, 0, -1):
        gain = np.linalg.solve(cov[k + 1], f @ cov[k]).T
        after = cov[k] + gain @ (after - cov[k + 1]) @ gain.T
        smoothed[k] = after
    for k in (60, 200, 333):
        got = bridge_velocity_variance(np.array(k / n), duration, psd)
        assert got == pytest.approx(smoothed[k][1, 1], rel=1e-3)


def test_path_is_the_cubic_through_both_ends_and_turns_at_the_given_rates() -> None:
    a, b = _arc(0.0), _arc(6.0)
    s = np.linspace(0, 1, 61)
    p, q = bridge_path(a, b, s)
    np.testing.assert_allclose(p, CubicHermiteSpline([0, 6], [a.p, b.p], [a.v, b.v])(6 * s), atol=1e-12)
    np.testing.assert_allclose(p, [_arc(6 * x).p for x in s], atol=0.01)
    for x, got in zip(s, q, strict=True):
        assert abs(got @ _arc(6 * x).q) == pytest.approx(1.0, abs=1e-9)


@given(rate=st.floats(0.01, 1.4), sign=st.sampled_from([-1.0, 1.0]), duration=st.floats(0.5, 12.0))
def test_turns_beyond_half_a_revolution_are_counted(rate: float, sign: float, duration: float) -> None:
    rate *= sign
    a, b = _arc(0.0, rate=rate), _arc(duration, rate=rate)
    s = np.linspace(0, 1, 40)
    _, q = bridge_path(a, b, s)
    for x, got in zip(s, q, strict=True):
        assert abs(got @ _arc(duration * x, rate=rate).q) == pytest.approx(1.0, abs=1e-6)


def test_rotation_path_has_the_entry_rate_when_axes_differ() -> None:
    q0 = rotations.exp([0.1, 0.2, 0.3])
    q1 = rotations.multiply(q0, rotations.exp([0.5, -0.4, 0.8]))
    w0, w1 = np.array([0.2, -0.1, 0.3]), np.array([0.1, -0.3, 0.2])
    zero = np.zeros(3)
    _, q = bridge_path(
        EndState(0, zero, q0, zero, w0), EndState(2, zero, q1, zero, w1), np.linspace(0, 1, 20_001)
    )
    for k, w in ((1, w0), (20_000, w1)):
        rate = rotations.log(rotations.multiply(rotations.conjugate(q[k - 1]), q[k])) / 1e-4
        np.testing.assert_allclose(rate, w, atol=1e-3)


def _unit_basis() -> RbfBasis:
    return RbfBasis.create(np.column_stack((np.linspace(-1, 4, 11), np.zeros(11))), 0.25)


@pytest.mark.parametrize("stacked", [False, True])
def test_windows_tile_the_gap(stacked: bool) -> None:
    a, b = _arc(0.0), _arc(6.0)
    windows = gap_windows(a, b, _unit_basis(), 0.4, stacked, GapSettings())
    assert len(windows) == 15
    total = sum(increment for _, increment, _ in windows)
    np.testing.assert_allclose(total[:3], b.p - a.p, atol=1e-12)
    assert total[7] == pytest.approx(6.0)
    if stacked:
        np.testing.assert_allclose(total[3:7], rotations.align_sign(b.q, a.q) - a.q, atol=1e-12)
    else:
        assert total[5] == pytest.approx(1.2)


def test_windows_of_a_contradicted_gap_count_little() -> None:
    a, b = _arc(0.0), _arc(6.0)
    stopped = EndState(26.0, b.p, b.q, b.v, b.w)  # the same place, twenty seconds late
    steady = np.mean([w for _, _, w in gap_windows(a, b, _unit_basis(), 0.4, False, GapSettings())])
    doubtful = np.mean([w for _, _, w in gap_windows(a, stopped, _unit_basis(), 0.4, False, GapSettings())])
    assert steady > 0.7
    assert doubtful < 0.5 * steady
    assert gap_windows(a, EndState(99.0, b.p, b.q, b.v, b.w), _unit_basis(), 0.4, False, GapSettings()) == []


def test_poses_of_one_instant_tell_no_velocity() -> None:
    """Several cameras, or late measurements, can give many poses at the same time."""
    history, motion = PoseHistory(5), np.full(6, 7.0)
    for _ in range(8):
        history.push_and_fit(1.0, np.ones(3), np.array([1.0, 0, 0, 0]), motion)
    assert history.fit(1.0) is None
    np.testing.assert_array_equal(motion, np.full(6, 7.0))
    history.push_and_fit(1.5, np.array([2.0, 1, 1]), np.array([1.0, 0, 0, 0]), motion)
    np.testing.assert_allclose(motion, [2.0, 0, 0, 0, 0, 0], atol=1e-12)
