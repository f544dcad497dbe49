"""History stack: books kept by rank-one updates against brute force, both rules, excitation, windows."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad_vec

from camnet.estimation.basis import RbfBasis
from camnet.estimation.learner import OutlierGate
from camnet.estimation.selection import DOptimalRule, SmallestEigenvalueRule, rank_one, replacement_gains
from camnet.estimation.stack import HistoryStack
from camnet.estimation.windows import WindowCollector, increment_of
from camnet.geometry import rotations


def _rows(rng: np.random.Generator, n: int, p: int) -> np.ndarray:
    return rng.standard_normal((n, p)) * rng.uniform(0.2, 2.0, (n, 1))


def _filled(rule: object, rng: np.random.Generator, capacity: int, p: int) -> HistoryStack:
    stack = HistoryStack(capacity, p, 3, rule, 1e-3)  # type: ignore[arg-type]
    for y in _rows(rng, capacity, p):
        stack.offer(0.0, y, rng.standard_normal(3))
    return stack


@given(seed=st.integers(0, 10_000))
def test_d_optimal_gains_are_ratios_of_determinants(seed: int) -> None:
    rng = np.random.default_rng(seed)
    rows, y, delta = _rows(rng, 9, 4), _rows(rng, 1, 4)[0], 0.05
    a = rows.T @ rows + delta * np.eye(4)
    inverse = np.linalg.inv(a)
    gains = replacement_gains(inverse, np.einsum("ij,jk,ik->i", rows, inverse, rows), rows, y)
    brute = [np.linalg.det(a + np.outer(y, y) - np.outer(r, r)) / np.linalg.det(a) for r in rows]
    np.testing.assert_allclose(gains, brute, rtol=1e-8)


@given(seed=st.integers(0, 10_000))
def test_d_optimal_choices_over_a_sequence_match_brute_force(seed: int) -> None:
    rng = np.random.default_rng(seed)
    stack = _filled(DOptimalRule(8, 4, 0.05), rng, 8, 4)
    for y in _rows(rng, 30, 4):
        a = stack.rows.T @ stack.rows + 0.05 * np.eye(4)
        logdet = np.array([np.linalg.slogdet(a + np.outer(y, y) - np.outer(r, r))[1] for r in stack.rows])
        best = int(np.argmax(logdet)) if logdet.max() > np.linalg.slogdet(a)[1] else -1
        before = stack.rows.copy()
        stack.offer(0.0, y, np.zeros(3))
        changed = np.flatnonzero((stack.rows != before).any(axis=1))
        assert changed.tolist() == ([] if best < 0 else [best])


@given(seed=st.integers(0, 10_000))
def test_eigenvalue_rule_over_a_sequence_matches_brute_force(seed: int) -> None:
    rng = np.random.default_rng(seed)
    stack = _filled(SmallestEigenvalueRule(), rng, 6, 3)
    lowest = stack.lambda_min()
    for y in _rows(rng, 10, 3):
        s = stack.rows.T @ stack.rows
        values = [np.linalg.svd(np.vstack((np.delete(stack.rows, j, 0), y)))[1][-1] ** 2 for j in range(6)]
        best = int(np.argmax(values)) if max(values) > np.linalg.eigvalsh(s)[0] else -1
        before = stack.rows.copy()
        stack.offer(0.0, y, np.zeros(3))
        assert np.flatnonzero((stack.rows != before).any(axis=1)).tolist() == ([] if best < 0 else [best])
        assert stack.lambda_min() >= lowest - 1e-12  # never falls: that is what the rule is for
        lowest = stack.lambda_min()


@pytest.mark.parametrize("rule", [SmallestEigenvalueRule(), DOptimalRule(7, 4, 1e-2)])
def test_sums_follow_every_change(rule: object) -> None:
    rng = np.random.default_rng(3)
    stack = HistoryStack(7, 4, 3, rule, 1e-3)  # type: ignore[arg-type]
    for y in _rows(rng, 60, 4):
        stack.offer(0.0, y, rng.standard_normal(3), rng.uniform(0.1, 1.0))
    np.testing.assert_allclose(stack.gram, stack.rows.T @ stack.rows, atol=1e-10)
    np.testing.assert_allclose(stack.moment, stack.rows.T @ stack.increments, atol=1e-10)
    assert stack.count == 7


def test_a_weighted_window_counts_by_its_inverse_variance() -> None:
    stack = HistoryStack(4, 2, 3, SmallestEigenvalueRule(), 1e-3)
    y, d = np.array([1.0, 2.0]), np.array([3.0, 4.0, 5.0])
    stack.offer(0.0, y, d, 0.25)
    np.testing.assert_allclose(stack.gram, 0.25 * np.outer(y, y))
    np.testing.assert_allclose(stack.moment, 0.25 * np.outer(y, d))


def test_excitation_time_is_when_the_smallest_eigenvalue_first_passes() -> None:
    rng = np.random.default_rng(0)
    stack = HistoryStack(50, 4, 3, DOptimalRule(50, 4, 1e-3), 0.7)
    first = math.inf
    for k, y in enumerate(0.3 * rng.standard_normal((50, 4))):
        stack.offer(0.1 * k, y, np.zeros(3))
        if np.linalg.svd(stack.rows)[1].min() ** 2 >= 0.7 and stack.count >= 4:
            first = min(first, 0.1 * k)
    assert math.isfinite(first)
    assert stack.excited_s == first


@given(seed=st.integers(0, 10_000), sign=st.sampled_from([1.0, -1.0]))
def test_rank_one_inverse(seed: int, sign: float) -> None:
    rng = np.random.default_rng(seed)
    a = _rows(rng, 12, 5)
    m = a.T @ a + np.eye(5)
    inverse = np.linalg.inv(m)
    rank_one(inverse, a[0], sign)
    np.testing.assert_allclose(inverse, np.linalg.inv(m + sign * np.outer(a[0], a[0])), atol=1e-9)


def _smooth_pose(t: float) -> tuple[np.ndarray, np.ndarray]:
    yaw = 0.4 * t
    return np.array([math.cos(yaw), math.sin(yaw), 0.1 * t]), rotations.from_yaw(yaw)


@pytest.mark.parametrize("average", [1, 4])
@pytest.mark.parametrize("stacked", [False, True])
def test_windows_satisfy_the_integral_equation(average: int, stacked: bool) -> None:
    """For a motion that the model can express exactly, Deta = Y W, whatever the averaging."""
    dt = 0.01
    collector = WindowCollector(3, 0.4, dt, average, stacked)

    def sigma(t: float) -> np.ndarray:
        return np.array([1.0, math.cos(0.4 * t), math.sin(0.4 * t)])

    # p' and w in terms of sigma; for the stacked form q' is not a function of sigma: only its position is checked
    w = np.zeros((3, 8))
    w[2, 0], w[1, 1], w[0, 2], w[0, 5], w[0, 7] = -0.4, 0.4, 0.1, 0.4, 1.0
    columns = [0, 1, 2, 7] if stacked else list(range(8))
    windows = []
    for k in range(200):
        p, q = _smooth_pose(k * dt)
        out = collector.push(k * dt, p, q if k % 3 else -q, sigma(k * dt))
        if out is not None:
            windows.append(out)
            np.testing.assert_allclose(out[0] @ w[:, columns], out[1][columns], atol=1e-5)
    # spaced by the window, not overlapping
    assert len(windows) == (200 - average) // 40


def test_averaging_divides_the_noise_of_the_ends() -> None:
    rng = np.random.default_rng(0)

    def spread(average: int) -> float:
        collector = WindowCollector(1, 0.5, 0.02, average, False)
        q = np.array([1.0, 0.0, 0.0, 0.0])
        out = [collector.push(0.02 * k, rng.standard_normal(3), q, np.ones(1)) for k in range(20_000)]
        return float(np.std([o[1][:3] for o in out if o is not None]))

    assert spread(1) == pytest.approx(math.sqrt(2), rel=0.06)
    assert spread(9) == pytest.approx(math.sqrt(2) / 3, rel=0.06)


def test_window_regressor_is_the_integral_of_sigma() -> None:
    basis = RbfBasis.create(np.array([[1.0, 0.0], [0.5, 0.5]]), 0.2)
    collector = WindowCollector(2, 0.5, 0.01, 1, False)
    out = None
    for k in range(51):
        p, q = _smooth_pose(0.01 * k)
        out = collector.push(0.01 * k, p, q, basis(p, q)) or out
    assert out is not None
    exact = quad_vec(lambda t: basis(*_smooth_pose(t)), 0.0, 0.5)[0]
    np.testing.assert_allclose(out[0], exact, rtol=1e-4)


def test_stacked_increment_is_blind_to_the_sign_of_a_measured_quaternion() -> None:
    q0, q1 = rotations.from_yaw(3.1), rotations.from_yaw(3.2)
    p = np.zeros(3)
    np.testing.assert_allclose(
        increment_of(p, q0, p, q1, 1.0, True), increment_of(p, q0, p, -q1, 1.0, True), atol=1e-15
    )


def test_outliers_are_refused_until_they_become_the_rule() -> None:
    rng = np.random.default_rng(1)
    gate = OutlierGate(5.0)
    weights = np.zeros((1, 8))
    weights[0, 0], weights[0, 7] = 1.0, 1.0
    row = np.array([0.4])

    def window(v: float) -> np.ndarray:
        out = 0.4 * np.array([v, 0, 0, 0, 0, 0, 0, 1.0])
        out[:6] += 0.01 * rng.standard_normal(6)
        return out

    assert all(gate.passes(row, window(1.0), weights) for _ in range(50))
    assert not gate.passes(row, window(3.0), weights)
    assert gate.passes(row, window(1.0), weights)
    answers = [gate.passes(row, window(3.0), weights) for _ in range(6)]
    assert answers == [False] * 5 + [True]
