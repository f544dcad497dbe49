"""One target's track from observations of several observers: AdaTE beside Kalman filters, causal and smoothed.

| estimator | what |
| --- | --- |
| adate | adaptive trajectory estimation (li2019) with free time steps; observers that drift or err are found |
| ekf | Kalman filter of constant acceleration with smoothing; its noise is the likeliest of a grid |
| ukf | unscented Kalman filter with the power-limited steering model |
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from camnet.errors import ConfigError
from camnet.estimation.adate import AdaptiveTrajectoryEstimator
from camnet.estimation.followed_track import Followed
from camnet.estimation.kalman import (
    ExtendedKalmanFilter,
    KalmanFilter,
    UnscentedKalmanFilter,
    constant_acceleration,
)
from camnet.estimation.pls import PowerLimitedSteering
from camnet.importers.observations import Observations
from camnet.types import Array

__all__ = ["ESTIMATORS", "follow_observations", "summary"]

ESTIMATORS = ("adate", "ekf", "ukf")
_NOTHING = np.zeros((0, 3)), np.zeros((0, 3, 3))
#: densities of the jerk, (m/s^3)^2 s, among which the likeliest is taken, and the share of the track that decides
_JERK, _DECIDES = (1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 1e-1, 1.0), 300
#: steps that Kalman smoothers go back
_LAG = 50


def follow_observations(
    name: str, data: Observations, progress: Callable[[float], None] | None = None
) -> Followed:
    """Run one estimator of `ESTIMATORS` over the observations.

    Raises
    ------
    ConfigError
        There is no such estimator.
    """
    if name == "adate":
        return _adate(data, progress)
    dt_s = float(np.median(np.diff(data.times_s)))
    if name == "ekf":
        density = _likeliest(data)
        return _kalman(
            ExtendedKalmanFilter(lambda tau: constant_acceleration(tau, density), dt_s, _LAG), data, progress
        )
    if name == "ukf":
        return _kalman(UnscentedKalmanFilter(PowerLimitedSteering(), dt_s, _LAG), data, progress)
    raise ConfigError(f"--estimators {name!r}: known are {', '.join(ESTIMATORS)}")


def _at(data: Observations, k: int) -> tuple[np.ndarray, Array, Array]:
    rows = np.arange(*np.searchsorted(data.step, [k, k + 1]))
    return (rows, data.position[rows], data.covariance[rows]) if len(rows) else (rows, *_NOTHING)


def _first(data: Observations) -> int:
    """Return the first step with an observation: estimators begin there."""
    return int(data.step[0])


def _adate(data: Observations, progress: Callable[[float], None] | None) -> Followed:
    n, begin = len(data.times_s), _first(data)
    dt_s = float(np.median(np.diff(data.times_s)))
    estimator = AdaptiveTrajectoryEstimator(PowerLimitedSteering(), dt_s)
    causal, covariance = np.full((n, 3), np.nan), np.full((n, 3, 3), np.nan)
    outlying, drifting = np.zeros(len(data.step), dtype=bool), np.zeros(len(data.step), dtype=bool)
    for k in range(begin, n):
        rows, position, given = _at(data, k)
        elapsed = None if k == begin else float(data.times_s[k] - data.times_s[k - 1])
        observers = data.observer[rows]
        causal[k] = estimator.update(position, given, observers, elapsed)[:3]
        covariance[k] = estimator.covariance[:3, :3]
        far, drifts = estimator.outlying(), estimator.drifting()
        outlying[rows] = [far[int(j)] for j in observers]
        drifting[rows] = [drifts[int(j)] for j in observers]
        if progress is not None:
            progress((k + 1) / n)
    smoothed, spread = np.full((n, 3), np.nan), np.full((n, 3, 3), np.nan)
    smoothed[begin:] = estimator.trajectory[:, :3]
    spread[begin:] = estimator.smoothed_covariances()[:, :3, :3]
    return Followed(causal, smoothed, covariance, spread, outlying, drifting)


def _kalman(filter_: KalmanFilter, data: Observations, progress: Callable[[float], None] | None) -> Followed:
    n, begin = len(data.times_s), _first(data)
    causal, covariance = np.full((n, 3), np.nan), np.full((n, 3, 3), np.nan)
    for k in range(begin, n):
        _, position, given = _at(data, k)
        elapsed = None if k == begin else float(data.times_s[k] - data.times_s[k - 1])
        causal[k] = filter_.update(position, given, elapsed)[:3]
        covariance[k] = filter_.covariance[:3, :3]
        if progress is not None:
            progress((k + 1) / n)
    smoothed = np.full((n, 3), np.nan)
    smoothed[begin:] = filter_.trajectory[:, :3]
    return Followed(causal, smoothed, covariance, None)


def _likeliest(data: Observations) -> float:
    """Density of the jerk under which the first observations are likeliest, each given those before it."""
    return min(_JERK, key=lambda density: _surprise(data, density))


def _surprise(data: Observations, density: float) -> float:
    """Mean negative logarithm of the likelihood of the observations that a filter foresees."""
    begin, n = _first(data), min(len(data.times_s), _DECIDES)
    first = float(np.median(np.diff(data.times_s)))
    filter_ = ExtendedKalmanFilter(lambda tau: constant_acceleration(tau, density), first, 0)
    total, count = 0.0, 0
    for k in range(begin, n):
        _, position, given = _at(data, k)
        elapsed = first if k == begin else float(data.times_s[k] - data.times_s[k - 1])
        if k > begin + 5:
            model = constant_acceleration(elapsed, density)
            p = model.transition @ filter_.covariance @ model.transition.T + model.noise
            mean = (model.transition @ filter_.causal_state)[:3]
            for z, r in zip(position, given, strict=True):
                spread = p[:3, :3] + r
                e = z - mean
                total += 0.5 * float(e @ np.linalg.solve(spread, e) + np.linalg.slogdet(spread)[1])
                count += 1
        filter_.update(position, given, elapsed if k > begin else None)
    return total / max(count, 1)


def summary(data: Observations, followed: dict[str, Followed]) -> dict[str, Any]:
    """Figures of a track: what each observer did, and, where the truth is known, everybody's errors, m."""
    adate = followed.get("adate")
    observers = {}
    for j, name in enumerate(data.names):
        mine = data.observer == j
        entry: dict[str, Any] = {"observations": int(mine.sum())}
        if adate is not None and adate.drifting is not None and adate.outlying is not None:
            drifts = data.times_s[data.step[mine & adate.drifting]]
            entry["outliers"] = int(np.count_nonzero(mine & adate.outlying & ~adate.drifting))
            entry["drifting"] = len(drifts)
            entry["drifts_from_s"] = float(drifts[0]) if len(drifts) else None
            entry["drifts_last_s"] = float(drifts[-1]) if len(drifts) else None
        if data.truth is not None:
            entry["rmse_m"] = _rms(data.position[mine] - data.truth[data.step[mine]])
        observers[name] = entry
    estimators: dict[str, Any] = {}
    for name, run in followed.items():
        estimators[name] = {
            "median_sd_m": float(
                np.nanmedian(np.sqrt(np.trace(run.causal_covariance[:, :2, :2], axis1=1, axis2=2)))
            )
        }
        if data.truth is not None:
            estimators[name]["causal_rmse_m"] = _rms(run.causal - data.truth)
            estimators[name]["smoothed_rmse_m"] = _rms(run.smoothed - data.truth)
    gaps = np.diff(data.times_s)
    return {
        "times": len(data.times_s),
        "duration_s": float(data.times_s[-1] - data.times_s[0]),
        "step_s": {"least": float(gaps.min()), "median": float(np.median(gaps)), "most": float(gaps.max())},
        "observers": observers,
        "estimators": estimators,
        "origin": None if data.origin is None else list(data.origin),
    }


def _rms(error: Array) -> float | None:
    whole = np.isfinite(error).all(axis=1)
    return float(np.sqrt(np.mean(np.sum(error[whole] ** 2, axis=1)))) if whole.any() else None
