"""Constant-velocity unscented Kalman filter of a pose, with the interface of ``TargetFilter``.

Position and velocity go through ``UnscentedKalmanFilter``; orientation q and body rate w through sigma points on the
manifold: deviations (dtheta, dw) (6,) from the mean, ``q exp(dtheta)``, ``w + dw`` (Kraft 2003).

| symbol | name | shape | unit |
| --- | --- | --- | --- |
| P | ``_cov``: covariance of (dtheta, dw) | (6, 6) | rad, rad/s |
| X_i | sigma points: 0 and the columns of +-sqrt(n P) | (2n, 6) | rad, rad/s |
| R | measurement noise of the orientation | (3, 3) | rad^2 |

The sigma points have equal weights 1 / 2n (no centre point), so every covariance stays positive definite.
"""

from __future__ import annotations

import math

import numpy as np

from camnet.compiled import cached_njit
from camnet.estimation.ekf import coast
from camnet.estimation.kalman import UnscentedKalmanFilter, constant_velocity
from camnet.estimation.observation import LOST_PERIODS, measured_world_pose
from camnet.estimation.protocol import Rollout
from camnet.estimation.settings import EkfSettings
from camnet.geometry.rotations_compiled import conjugate, exp, log, multiply, normalise
from camnet.types import Array, PoseMeasurement, TargetEstimate

__all__ = ["ConstantVelocityUKF"]

_N = 6
_NO_OBSERVATION = np.zeros((0, 3))
_NO_COVARIANCE = np.zeros((0, 3, 3))
#: uncertainty of the body rate at the first measurement, rad/s
_START_RATE_RADPS = 2.0


@cached_njit
def _propagate(q: Array, w: Array, cov: Array, noise: Array, dt: float) -> tuple[Array, Array]:
    """Orientation (4,) and covariance (6, 6) after ``dt``; the body rate stays."""
    root = np.linalg.cholesky(_N * cov)
    mean = normalise(multiply(q, exp(dt * w)))
    back = conjugate(mean)
    deviations = np.empty((2 * _N, _N))
    for i in range(2 * _N):
        for j in range(_N):
            deviations[i, j] = root[j, i] if i < _N else -root[j, i - _N]
        moved = multiply(multiply(q, exp(deviations[i, :3].copy())), exp(dt * (w + deviations[i, 3:])))
        deviations[i, :3] = log(multiply(back, moved))
    centre = np.zeros(3)  # one step of the intrinsic mean; the points lie close together
    for i in range(2 * _N):
        centre += deviations[i, :3] / (2 * _N)
    for i in range(2 * _N):
        deviations[i, :3] -= centre
    spread = np.zeros((_N, _N))
    for i in range(2 * _N):
        for a in range(_N):
            for b in range(_N):
                spread[a, b] += deviations[i, a] * deviations[i, b] / (2 * _N)
    return normalise(multiply(mean, exp(centre))), spread + noise


@cached_njit
def _take(q: Array, w: Array, cov: Array, q_measured: Array, variance: float) -> tuple[Array, Array, Array]:
    """Kalman update, in Joseph form, with a measured orientation; it is linear in the deviations."""
    error = log(multiply(conjugate(q), q_measured))
    spread = cov[:3, :3].copy()
    for i in range(3):
        spread[i, i] += variance
    gain = np.linalg.solve(spread, cov[:3].copy()).T.copy()
    step = gain @ error
    left = np.eye(_N)
    left[:, :3] -= gain
    after = left @ cov @ left.T + variance * (gain @ gain.T)
    return normalise(multiply(q, exp(step[:3]))), w + step[3:], after


class ConstantVelocityUKF:
    """See the module's head; it steps at the fixed sensing rate.

    Parameters
    ----------
    settings : noise of process and measurement, as for the extended filter
    rate_hz : sensing rate
    name : shown in results
    """

    def __init__(self, settings: EkfSettings, rate_hz: float, name: str = "ukf") -> None:
        self.name = name
        self._dt = 1.0 / rate_hz
        self._position = UnscentedKalmanFilter(
            constant_velocity(self._dt, settings.accel_psd_m2ps3), self._dt, lag=0
        )
        self._r_p = settings.position_noise_m**2 * np.eye(3)[None]
        self._variance = settings.orientation_noise_rad**2
        d, eye = self._dt, np.eye(3)
        self._noise = settings.angular_accel_psd_rad2ps3 * np.block(
            [[d**3 / 3.0 * eye, d**2 / 2.0 * eye], [d**2 / 2.0 * eye, d * eye]]
        )
        self._q, self._w = np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3)
        self._cov = np.diag([settings.orientation_noise_rad**2] * 3 + [_START_RATE_RADPS**2] * 3)
        self._t = self._last_seen = -math.inf
        self._seen, self._region = False, -1

    @property
    def estimate(self) -> TargetEstimate:
        """See ``TargetFilter.estimate``; the radius is three standard deviations on the worst axis."""
        started = math.isfinite(self._t)
        state = self._position.causal_state if started else np.full(6, np.nan)
        worst = float(self._position.covariance.diagonal()[:3].max())
        return TargetEstimate(
            self._t,
            state[:3],
            self._q.copy(),
            state[3:6],
            self._w.copy(),
            self._seen,
            self._last_seen,
            self._region,
            3.0 * math.sqrt(worst) if started else math.inf,
        )

    def correct(self, measurement: PoseMeasurement, region: int) -> None:
        """See ``TargetFilter.correct``."""
        p, q = measured_world_pose(measurement)
        if math.isfinite(self._t):
            self._turn_to(measurement.t_s)
            self._q, self._w, self._cov = _take(self._q, self._w, self._cov, q, self._variance)
        else:
            self._q = q
        self._position.update(p[None], self._r_p)
        self._t = self._last_seen = measurement.t_s
        self._seen, self._region = True, region

    def predict(self, t_s: float) -> None:
        """See ``TargetFilter.predict``: one step a sensing period."""
        if not math.isfinite(self._t) or t_s <= self._t:
            return
        self._turn_to(t_s)
        for _ in range(max(1, round((t_s - self._t) / self._dt))):
            self._position.update(_NO_OBSERVATION, _NO_COVARIANCE)
        self._t = t_s
        self._seen = t_s - self._last_seen <= LOST_PERIODS * self._dt

    def _turn_to(self, t_s: float) -> None:
        """Propagate sigma points of the orientation by whole sensing periods."""
        for _ in range(max(1, round((t_s - self._t) / self._dt))):
            self._q, self._cov = _propagate(self._q, self._w, self._cov, self._noise, self._dt)

    def rollout(self, horizon_s: float, dt_s: float) -> Rollout:
        """See ``TargetFilter.rollout``."""
        e = self.estimate
        t, p, q = coast(e.t_s, e.p_world, e.q_world, e.v_world, e.w_body, horizon_s, dt_s)
        return Rollout(t, p, q, np.full(len(t), e.radius_m))

    def diagnostics(self) -> dict[str, float]:
        """Return standard deviations of position and orientation on one axis."""
        return {
            "position_std_m": math.sqrt(float(self._position.covariance[0, 0])),
            "orientation_std_rad": math.sqrt(float(self._cov[2, 2])),
        }
