"""Finite excitation where the target has been: the bound, and what it says of known systems."""

from __future__ import annotations

import itertools
import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from camnet.estimation.basis import RbfBasis
from camnet.estimation.concurrent_learning import MotionModel
from camnet.estimation.excitation import RUN, VisitedExcitation, unexcited_share
from camnet.estimation.placement import grid_centres
from camnet.estimation.settings import EstimatorSettings
from camnet.estimation.stack import HistoryStack

LATTICE = RbfBasis.create(grid_centres(np.array([-1.0, -1.0]), np.array([5.0, 1.0]), 0.5), 0.25)
Q0 = np.array([1.0, 0.0, 0.0, 0.0])


def _window(x: float, dx: float = 0.16) -> np.ndarray:
    """Regressor of 0.4 s along the x axis."""
    ends = [LATTICE(np.array([x + s * dx, 0.0, 0.0]), Q0) for s in (0.0, 0.5, 1.0)]
    return np.asarray(0.4 / 6 * (ends[0] + 4 * ends[1] + ends[2]))


@given(seed=st.integers(0, 10_000), rest=st.floats(0.0, 1.0))
def test_share_bounds_what_lies_outside_the_excited_eigenvectors(seed: int, rest: float) -> None:
    rng = np.random.default_rng(seed)
    rows = rng.standard_normal((int(rng.integers(1, 9)), 6)) * 10.0 ** rng.uniform(-3, 0, 6)
    psi, y = rows.T @ rows, rng.standard_normal(6) * 10.0 ** rng.uniform(-3, 0, 6)
    values, vectors = np.linalg.eigh(psi)
    outside = vectors[:, values < 1e-2].T @ y
    assert (outside @ outside + rest) / (y @ y + rest) <= unexcited_share(psi, y, 1e-2, rest) + 1e-12


def _walk(model: MotionModel, t: float, first: float, last: float) -> float:
    for x in np.arange(first, last, 0.16):
        t += 0.4
        model.learn_window(t, _window(float(x)), 0.4 * np.array([0.4, 0, 0, 0, 0, 0, 0, 1.0]))
    return t


def test_a_road_excites_on_the_second_pass_and_never_by_the_smallest_eigenvalue() -> None:
    model = MotionModel(EstimatorSettings(), LATTICE.size, 1 / 30)
    t = _walk(model, 0.0, 0.0, 4.0)
    assert math.isinf(model.excited_s())
    _walk(model, t, 0.0, 4.0)
    assert t < model.excited_s() <= t + 0.4 * (RUN + 3)
    assert math.isinf(model.integral.excited_s)
    model.forget(_window(2.0), 1e9)
    assert math.isinf(model.excited_s())


def test_news_interrupts_the_run() -> None:
    watch = VisitedExcitation(1e-2, 0.1)
    psi, known, news = np.diag([1e4, 0.0]), np.array([1.0, 0.0]), np.array([1.0, 0.5])
    for k in range(3 * RUN):
        watch.observe(float(k), psi, news if k % RUN == RUN - 1 else known)
    assert math.isinf(watch.since_s)
    for k in range(RUN):
        watch.observe(100.0 + k, psi, known)
    assert watch.since_s == 100.0 + RUN - 1


def test_error_in_the_excited_part_decays_at_the_rate_of_the_analysis() -> None:
    """Known W, singular Psi: |P W_til| falls at kCL lambda_lo or faster, and places visited are predicted."""
    threshold = 1e-2
    settings = EstimatorSettings(leakage=0.0, kcl=20.0)
    model, rng = MotionModel(settings, LATTICE.size, 1 / 30), np.random.default_rng(0)
    w = 0.1 * rng.standard_normal((LATTICE.size, 8))
    for x in np.tile(np.arange(0.0, 4.0, 0.16), 2):
        model.learn_window(0.0, _window(float(x)), _window(float(x)) @ w)
    values, vectors = np.linalg.eigh(model.psi)
    assert values[0] < 1e-9
    excited = vectors[:, values >= threshold]
    norms = []
    for _ in range(1500):
        norms.append(np.linalg.norm(excited.T @ (w - model.weights)))
        model.step()
    rate = 20.0 * threshold / 30.0
    assert all(b <= a / (1 + rate) + 1e-12 for a, b in itertools.pairwise(norms))
    inside = [LATTICE(np.array([x, 0.0, 0.0]), Q0) for x in np.linspace(0.1, 3.9, 20)]
    scale = np.linalg.norm(w)
    for sigma in inside:
        s = np.linalg.norm(sigma - excited @ (excited.T @ sigma))
        assert (
            np.linalg.norm(sigma @ (w - model.weights)) <= np.linalg.norm(sigma) * norms[-1] + 2 * scale * s
        )


def test_windows_outside_end_what_held() -> None:
    """It used to last for ever: 50 windows outside P changed nothing."""
    watch = VisitedExcitation(1e-2, 0.1)
    psi, known, news = np.diag([1e4, 0.0]), np.array([1.0, 0.0]), np.array([0.0, 1.0])
    for k in range(RUN):
        watch.observe(float(k), psi, known)
    assert watch.since_s == RUN - 1
    for k in range(50):
        watch.observe(100.0 + k, psi, news)
        assert math.isinf(watch.since_s)
    for k in range(RUN):
        watch.observe(200.0 + k, psi, known)
    assert watch.since_s == 200.0 + RUN - 1


def test_a_stack_that_loses_its_rank_is_no_longer_excited() -> None:
    class Oldest:
        """Replaces the first entry, whatever it holds."""

        name = "oldest"

        def added(self, *_: object) -> None: ...

        replaced = rebuilt = added

        def choose(self, *_: object) -> int:
            return 0

    stack = HistoryStack(2, 2, 1, Oldest(), 1.0)
    stack.offer(0.0, np.array([2.0, 0.0]), np.zeros(1))
    stack.offer(1.0, np.array([0.0, 2.0]), np.zeros(1))
    assert stack.excited_s == 1.0
    stack.offer(2.0, np.array([0.0, 3.0]), np.zeros(1))
    assert math.isinf(stack.excited_s)
