"""Time of one filter step against filterpy and Stone Soup, and of one AdaTE update against its age, in one run.

The peers are optional: those that are not installed are left out. All filters are given the same nine-state constant
acceleration model, one position observation a step, prediction and update; the figures are medians.
"""

from __future__ import annotations

import importlib
import time
from collections.abc import Callable
from datetime import datetime, timedelta
from typing import Any

import numpy as np

from camnet.estimation.kalman import ExtendedKalmanFilter, UnscentedKalmanFilter, constant_acceleration
from camnet.experiments.adate_table import time_update
from camnet.types import Array

__all__ = ["compare_filters"]


def _median_us(step: Callable[[int], object], count: int) -> float:
    for k in range(5):
        step(k)
    times = []
    for k in range(5, count):
        begin = time.perf_counter()
        step(k)
        times.append(time.perf_counter() - begin)
    return 1e6 * float(np.median(times))


def _ours(observations: Array, noise: Array) -> dict[str, float]:
    model, cov = constant_acceleration(1.0, 1e-3), noise[None]
    out = {}
    for name, kind in (("EKF", ExtendedKalmanFilter), ("UKF", UnscentedKalmanFilter)):
        est = kind(model, lag=0, mean=np.zeros(9), covariance=np.eye(9))
        out[name] = _median_us(lambda k, e=est: e.update(observations[k : k + 1], cov), len(observations))  # type: ignore[misc]
    return out


def _filterpy(observations: Array, noise: Array) -> dict[str, float]:
    kalman: Any = importlib.import_module("filterpy.kalman")
    model, h = constant_acceleration(1.0, 1e-3), np.eye(3, 9)
    ekf = kalman.ExtendedKalmanFilter(9, 3)
    ekf.F, ekf.Q, ekf.R, ekf.x, ekf.P = model.transition, model.noise, noise, np.zeros(9), np.eye(9)
    points = kalman.MerweScaledSigmaPoints(9, alpha=1.0, beta=0.1, kappa=0.0)
    ukf = kalman.UnscentedKalmanFilter(9, 3, 1.0, lambda x: x[:3], lambda x, dt: model.transition @ x, points)
    ukf.Q, ukf.R, ukf.x, ukf.P = model.noise, noise, np.zeros(9), np.eye(9)

    def step_ekf(k: int) -> None:
        ekf.predict()
        ekf.update(observations[k], lambda _: h, lambda x: x[:3])

    def step_ukf(k: int) -> None:
        ukf.predict()
        ukf.update(observations[k])

    return {"EKF": _median_us(step_ekf, len(observations)), "UKF": _median_us(step_ukf, len(observations))}


def _stone_soup(observations: Array, noise: Array) -> dict[str, float]:
    def part(name: str) -> Any:  # noqa: ANN401 - an optional library without types
        return importlib.import_module(f"stonesoup.{name}")

    linear = part("models.transition.linear")
    motion = linear.CombinedLinearGaussianTransitionModel([linear.ConstantAcceleration(1e-3)] * 3)
    sensor = part("models.measurement.linear").LinearGaussian(9, [0, 3, 6], noise)
    kalman, update = part("predictor.kalman"), part("updater.kalman")
    types = part("types.detection"), part("types.hypothesis"), part("types.state")
    out = {}
    for name, kind in (("EKF", "Extended"), ("UKF", "Unscented")):
        predictor = getattr(kalman, f"{kind}KalmanPredictor")(motion)
        updater = getattr(update, f"{kind}KalmanUpdater")(sensor)
        now = datetime(2026, 1, 1)
        state = [types[2].GaussianState(np.zeros((9, 1)), np.eye(9), timestamp=now)]

        def step(k: int, predictor: Any = predictor, updater: Any = updater, state: Any = state) -> None:  # noqa: ANN401
            when = state[0].timestamp + timedelta(seconds=1)
            predicted = predictor.predict(state[0], timestamp=when)
            detection = types[0].Detection(observations[k][:, None], timestamp=when, measurement_model=sensor)
            state[0] = updater.update(types[1].SingleHypothesis(predicted, detection))

        out[name] = _median_us(step, min(len(observations), 200))
    return out


def compare_filters(steps: int = 2000, seed: int = 0) -> dict[str, Any]:
    """Time one step, us (median), of this package's EKF and UKF and of the installed peers; give the ratios too."""
    rng = np.random.default_rng(seed)
    observations, noise = rng.normal(size=(steps, 3)), np.diag([1.0, 2.0, 3.0])
    result: dict[str, Any] = {"camnet": _ours(observations, noise)}
    for name, peer in (("filterpy", _filterpy), ("stonesoup", _stone_soup)):
        try:
            result[name] = peer(observations, noise)
        except ModuleNotFoundError:
            continue
    ours = result["camnet"]
    result["ratio"] = {
        peer: {kind: result[peer][kind] / ours[kind] for kind in ours}
        for peer in ("filterpy", "stonesoup")
        if peer in result
    }
    result["adate_update_ms"] = {f"n{n}": time_update(n) for n in (100, 500, 5000)}
    return result
