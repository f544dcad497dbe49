"""The laws on simulated systems with known W, where V can be computed, against the bounds of the analysis."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pytest

from camnet.certification.constants import EstimatorBounds, sound
from camnet.estimation.basis import RbfBasis
from camnet.estimation.concurrent_learning import LAYER_SHARE, MotionModel
from camnet.estimation.placement import grid_centres
from camnet.estimation.settings import EstimatorSettings, StackSettings

BASIS = RbfBasis.create(grid_centres(np.full(2, -1.0), np.full(2, 1.0), 1.0), 0.6)
Q0 = np.array([1.0, 0.0, 0.0, 0.0])
DT = 2e-3
GAMMA = 1.5
WINDOW_S = 0.5


@dataclass
class Run:
    """V over time, norm of the weights, and when excitation held."""

    t: np.ndarray
    v: np.ndarray
    weight_norm: np.ndarray
    weight_error: np.ndarray
    excited_s: float
    bounds: EstimatorBounds


def _path(t: float) -> np.ndarray:
    """A path that fills the square: the true motion is its velocity, a function of place plus a remainder."""
    return np.array([math.sin(0.9 * t), math.sin(1.31 * t + 0.7), 0.0])


def _simulate(eps_bar: float, weight_bound: float, start: float, seconds: float = 40.0, seed: int = 0) -> Run:
    """Position part of (3-8), (3-10) with exact measurements of a system p' = W^T sigma(y) + eps.

    The regressor is driven by a given path y(t), so that W can be chosen freely; p is integrated with it.
    """
    rng = np.random.default_rng(seed)
    settings = EstimatorSettings(
        k1_per_s=2.0, kcl=2.0, gamma=GAMMA, leakage=0.0, weight_bound=weight_bound,
        stack=StackSettings(size=60, window_s=WINDOW_S, rule="lambda_min", excitation_threshold=2e-3),
    )  # fmt: skip
    model = MotionModel(settings, BASIS.size, DT)
    w = np.zeros((BASIS.size, 8))
    w[:, :3] = rng.standard_normal((BASIS.size, 3))
    w *= 0.8 * weight_bound / (1 + LAYER_SHARE) / np.linalg.norm(w)
    model.weights = start * rng.standard_normal(w.shape) * (np.arange(8) < 3)
    p, p_hat = np.zeros(3), np.array([0.6, -0.4, 0.2])
    k1, steps = settings.k1_per_s, round(seconds / DT)
    row, increment = np.zeros(BASIS.size), np.zeros(8)
    t, v, norm, off, seen_rate = (np.zeros(steps) for _ in range(5))
    for n in range(steps):
        now = n * DT
        sigma = BASIS(_path(now), Q0)
        eps = eps_bar / math.sqrt(3.0) * np.sin(now * np.array([7.0, 5.0, 3.0]))
        rate = (w[:, :3].T @ sigma) + eps
        error = p - p_hat
        til = w - model.weights
        t[n], off[n], norm[n] = now, np.linalg.norm(til), np.linalg.norm(model.weights)
        v[n] = 0.5 * error @ error + 0.5 * off[n] ** 2 / GAMMA
        seen_rate[n] = np.linalg.norm(rate)
        # k2 sgn(eta_til) with a gain of sqrt(3) eps_bar dominates eps in every component
        p_hat = p_hat + DT * (model.weights[:, :3].T @ sigma + k1 * error + eps_bar * np.sign(error))
        model.step(sigma, np.concatenate((error, np.zeros(5))))
        p = p + DT * rate
        row += DT * sigma
        increment[:3] += DT * rate
        if (n + 1) % round(WINDOW_S / DT) == 0:
            model.learn_window(now, row.copy(), increment.copy())
            row[:], increment[:] = 0.0, 0.0
    stack = model.integral
    bounds = EstimatorBounds(
        k=k1, kcl=settings.kcl, gamma_inv_min=1 / GAMMA, gamma_inv_max=1 / GAMMA, alpha=1.0, window_s=WINDOW_S,
        stack_size=settings.stack.size, eps_bar=eps_bar, etadot_max=float(seen_rate.max()),
        sigma_bar=float(np.sqrt(BASIS.size)), weight_bound=weight_bound * (1 + LAYER_SHARE),
        lambda_min_psi=settings.stack.excitation_threshold,
    )  # fmt: skip
    return Run(t, v, norm, off, stack.excited_s, bounds)


@pytest.fixture(scope="module")
def exact() -> Run:
    return _simulate(0.0, 4.0, 0.3)


@pytest.fixture(scope="module")
def disturbed() -> Run:
    return _simulate(0.05, 4.0, 0.3)


def test_lyapunov_function_never_rises_without_residual(exact: Run) -> None:
    """V' <= 0 from the start, excited or not, when the model is exact (the integration's own error apart)."""
    assert np.diff(exact.v).max() <= 2.0 * DT**2 * exact.v[0] * 10
    assert exact.v[-1] < 0.05 * exact.v[0]


def test_excitation_is_reached_and_holds_the_rate_of_decrease(exact: Run) -> None:
    """(3-26), (3-27): after T, V falls at least at lambda_DT, computed with lambda_lo."""
    assert 1.0 < exact.excited_s < 20.0
    c = sound(exact.bounds)
    after = exact.t >= exact.excited_s
    t, v = exact.t[after], exact.v[after]
    assert c.lambda_dt > 0.0
    assert (v <= v[0] * np.exp(-c.lambda_dt * (t - t[0])) + 1e-9).all()
    # and the weights with it: |W_til|^2 <= 2 gamma V
    assert (exact.weight_error[after] ** 2 <= 2 * GAMMA * v + 1e-12).all()


def test_with_a_residual_v_stays_below_its_envelopes(disturbed: Run) -> None:
    """(3-24) from the start, (3-27) after excitation, with the repaired constants and the known residual."""
    c = sound(disturbed.bounds)
    t, v = disturbed.t, disturbed.v
    assert (v <= v[0] * np.exp(-c.lambda_d * t) + c.beta1).all()
    after = t >= disturbed.excited_s
    envelope = v[after][0] * np.exp(-c.lambda_dt * (t[after] - disturbed.excited_s)) + c.c_ub
    assert (v[after] <= envelope).all()


def test_projection_bounds_the_weights_when_the_data_lie() -> None:
    """Windows of a system ten times as fast as the ball allows: the weights stop at its rim, W_bar + layer."""
    settings = EstimatorSettings(kcl=50.0, leakage=0.0, weight_bound=2.0)
    model = MotionModel(settings, BASIS.size, 1 / 30)
    rng = np.random.default_rng(1)
    for _ in range(40):
        row = WINDOW_S * BASIS(rng.uniform(-1, 1, 3), Q0)
        model.learn_window(0.0, row, 20.0 * row[:1] * np.ones(8))
    largest = 0.0
    for _ in range(400):
        model.step()
        largest = max(largest, float(np.linalg.norm(model.weights[:, :6])))
    assert 2.0 < largest <= 2.0 * (1 + LAYER_SHARE) + 1e-9
