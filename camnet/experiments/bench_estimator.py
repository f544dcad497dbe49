"""Microseconds of the estimators' updates, beside plain NumPy and the Kalman filter."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from camnet.estimation.basis import RbfBasis, evaluate_reference
from camnet.estimation.ekf import ConstantVelocityEKF
from camnet.estimation.learning_estimator import LearningEstimator
from camnet.estimation.placement import grid_centres
from camnet.estimation.protocol import TargetFilter
from camnet.estimation.settings import EstimatorSettings, GapSettings
from camnet.geometry import rotations
from camnet.types import CameraMotion, PoseMeasurement

__all__ = ["run"]

RATE_HZ = 30.0
SIDES = (9, 13)
SPACING_M = 0.3
VARIANCE_M2 = 0.3
WARM_UP_S = 60.0
REPEATS = 300
#: of the measured times; the machine's other work only adds to them
QUANTILE = 0.1
ROLLOUT_STEPS = 200


def run(seed: int = 0, progress: Callable[[float], None] | None = None) -> dict[str, Any]:
    """Time a measured and a predicted update with all p kernels touched (p = 81 and 169), and a rollout.

    A measured update is all that a measured pose sets off except the choice of stack entries: windows that are complete
    do not count (one in twelve updates). ``numpy_us`` is the same update written out in NumPy.
    """
    cases = []
    for number, side in enumerate(SIDES):
        cases.append(_case(side, np.random.default_rng([seed, number])))
        if progress is not None:
            progress((number + 1) / len(SIDES))
    return {"cases": cases}


def _case(side: int, rng: np.random.Generator) -> dict[str, Any]:
    extent = SPACING_M * (side - 1)
    basis = RbfBasis.create(grid_centres(np.zeros(2), np.full(2, extent - 1e-9), SPACING_M), VARIANCE_M2)
    bounds = np.array([[-2.0, -2.0, -1.0], [extent + 2.0, extent + 2.0, 1.0]])
    learned = LearningEstimator(EstimatorSettings(), basis, 1, RATE_HZ, bounds)
    ekf = ConstantVelocityEKF(EstimatorSettings().ekf, RATE_HZ)
    for filter_ in (learned, ekf):
        for k in range(round(WARM_UP_S * RATE_HZ)):
            filter_.correct(_measurement(k, extent, rng), 0)
    measured, window = _measured_us(learned, extent, rng)
    ekf_measured, _ = _measured_us(ekf, extent, rng)
    start, rollout = time.perf_counter, []
    for _ in range(20):
        before = start()
        learned.rollout(0.1 * ROLLOUT_STEPS, 0.1)
        rollout.append(start() - before)
    plain = _numpy_us(basis, learned, rng)
    return {
        "p": basis.size,
        "measured_us": measured,
        "measured_with_selection_us": window,
        "predicted_us": _predicted_us(learned),
        "numpy_us": plain,
        "numpy_over_measured": plain / measured,
        "ekf_measured_us": ekf_measured,
        "ekf_predicted_us": _predicted_us(ekf),
        "rollout_200_ms": 1e3 * float(np.quantile(rollout, QUANTILE)),
    }


def _measurement(k: int, extent: float, rng: np.random.Generator) -> PoseMeasurement:
    """Pose number ``k`` on a figure that fills the square, from a camera at the origin."""
    t = k / RATE_HZ
    p = 0.5 * extent * (1.0 + np.array([math.sin(0.31 * t), math.sin(0.23 * t + 0.5), -1.0]))
    heading = math.atan2(0.23 * math.cos(0.23 * t + 0.5), 0.31 * math.cos(0.31 * t))
    still = CameraMotion(np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3), np.zeros(3))
    return PoseMeasurement(t, 0, 0, p + 0.01 * rng.standard_normal(3), rotations.from_yaw(heading), still)


def _measured_us(filter_: TargetFilter, extent: float, rng: np.random.Generator) -> tuple[float, float]:
    """Time of an update without and with a completed window."""
    first = round(filter_.estimate.t_s * RATE_HZ) + 1
    times = []
    for k in range(first, first + REPEATS):
        z = _measurement(k, extent, rng)
        before = time.perf_counter()
        filter_.correct(z, 0)
        times.append(1e6 * (time.perf_counter() - before))
    by_phase = [times[phase::12] for phase in range(12)]
    usual = sorted(float(np.quantile(part, QUANTILE)) for part in by_phase)
    return float(np.median(usual)), usual[-1]


def _predicted_us(filter_: TargetFilter) -> float:
    """Time of an update without a measurement."""
    t, times = filter_.estimate.t_s, []
    for k in range(REPEATS):
        before = time.perf_counter()
        filter_.predict(t + (k + 1) / RATE_HZ)
        times.append(1e6 * (time.perf_counter() - before))
    return float(np.quantile(times[10:], QUANTILE))


def _numpy_us(basis: RbfBasis, learned: LearningEstimator, rng: np.random.Generator) -> float:
    """Time of the same measured update in NumPy: the readable form of the compiled one."""
    s, model = EstimatorSettings(gap=GapSettings(prior="none")), learned.model(0)
    moment, dt = model.integral.moment, 1.0 / RATE_HZ
    inverse = np.linalg.inv(np.eye(basis.size) + dt * s.kcl * model.psi)
    weights, p, q = model.weights.copy(), np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])
    recent_t = np.arange(s.regression_samples) * dt
    recent = rng.standard_normal((s.regression_samples, 6))
    times = []
    for _ in range(REPEATS):
        pm, qm = rng.standard_normal(3), rotations.from_yaw(0.1)
        before = time.perf_counter()
        sigma = evaluate_reference(basis, pm, qm)
        twist = weights.T @ sigma
        q = rotations.normalise(q + dt * 0.5 * rotations.kinematic_matrix(q) @ twist[3:6])
        e = np.concatenate((pm - p - dt * twist[:3], rotations.align_sign(qm, q) - q))
        step = -math.expm1(-s.k1_per_s * dt) * e + dt * s.k2 * np.tanh(e / s.boundary_layer)
        p, q = p + dt * twist[:3] + step[:3], rotations.normalise(q + step[3:])
        error = np.concatenate((e[:3], 0.5 * rotations.kinematic_matrix(q).T @ e[3:], np.zeros(2)))
        weights = inverse @ (weights + dt * s.gamma * (np.outer(sigma, error) + s.kcl * moment))
        np.polyfit(recent_t, recent, 1)
        times.append(1e6 * (time.perf_counter() - before))
    return float(np.quantile(times, QUANTILE))
