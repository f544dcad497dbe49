"""Constant-velocity extended Kalman filter of a pose: the baseline of parikh2018 (section VII).

| symbol | name | shape | unit |
| --- | --- | --- | --- |
| p, v | position and velocity in the world frame | (3,) | m, m/s |
| q, w | orientation and body rate, both assumed constant but for white acceleration | (4,), (3,) | -, rad/s |
| dtheta | error of q, body frame: ``q_true = q exp(dtheta)`` | (3,) | rad |
| P_p | covariance of (p, v) on one axis; the three axes are alike and uncorrelated | (2, 2) | m, m/s |
| P_q | covariance of (dtheta, dw) | (6, 6) | rad, rad/s |

Process noise is the exact integral of white acceleration of density rho: ``rho [dt^3/3, dt^2/2; dt^2/2, dt]``.
The class runs the compiled ``ekf_step``; the functions here are its readable form.
"""

from __future__ import annotations

import math

import numpy as np

from camnet.errors import ConfigError
from camnet.estimation.ekf_step import correct_state, predict_state
from camnet.estimation.observation import LOST_PERIODS, measured_world_pose
from camnet.estimation.protocol import Rollout
from camnet.estimation.settings import EkfSettings
from camnet.geometry.rotations_compiled import conjugate, exp, log, multiply, normalise, to_matrix
from camnet.types import Array, PoseMeasurement, TargetEstimate

__all__ = ["ConstantVelocityEKF", "coast", "predict_covariances", "update_orientation", "update_position"]

#: uncertainty of the velocities at the first measurement
START_SPEED_MPS = 1.0
START_RATE_RADPS = 2.0
_EYE = np.eye(3)
#: blocks of the process noise of (dtheta, dw): dt^3/3, dt^2/2 and dt multiply them
_NOISE_0 = np.kron([[1.0, 0.0], [0.0, 0.0]], _EYE)
_NOISE_1 = np.kron([[0.0, 1.0], [1.0, 0.0]], _EYE)
_NOISE_2 = np.kron([[0.0, 0.0], [0.0, 1.0]], _EYE)


def predict_covariances(
    cov_p: Array, cov_q: Array, w: Array, dt: float, rho_p: float, rho_q: float
) -> tuple[Array, Array]:
    """Covariances (2, 2) and (6, 6) after ``dt`` seconds without measurement."""
    a, b, c = cov_p[0, 0], cov_p[0, 1], cov_p[1, 1]
    n0, n1 = dt**3 / 3.0, dt**2 / 2.0
    b_next = b + dt * c + rho_p * n1
    cov_p_next = np.array([[a + 2.0 * dt * b + dt * dt * c + rho_p * n0, b_next], [b_next, c + rho_p * dt]])
    f = np.eye(6)
    f[0:3, 0:3] = to_matrix(exp(-dt * w))
    f[0:3, 3:6] = dt * _EYE
    noise = n0 * _NOISE_0 + n1 * _NOISE_1 + dt * _NOISE_2
    return cov_p_next, f @ cov_q @ f.T + rho_q * noise


def update_position(
    p: Array, v: Array, cov: Array, measured: Array, variance: float
) -> tuple[Array, Array, Array]:
    """Kalman update of (p, v) with a measured position (3,)."""
    s = cov[0, 0] + variance
    k0, k1 = cov[0, 0] / s, cov[1, 0] / s
    e = measured - p
    after = np.array([[(1.0 - k0) * cov[0, 0], (1.0 - k0) * cov[0, 1]], [0.0, cov[1, 1] - k1 * cov[0, 1]]])
    after[1, 0] = after[0, 1]
    return p + k0 * e, v + k1 * e, after


def update_orientation(
    q: Array, w: Array, cov: Array, measured: Array, variance: float
) -> tuple[Array, Array, Array]:
    """Kalman update of (q, w) with a measured orientation (4,)."""
    e = log(multiply(conjugate(q), measured))
    gain = np.linalg.solve(cov[0:3, 0:3] + variance * _EYE, cov[0:3, :]).T
    left = np.eye(6)
    left[:, 0:3] -= gain
    step = gain @ e
    after = left @ cov @ left.T + variance * gain @ gain.T
    return normalise(multiply(q, exp(step[0:3]))), w + step[3:6], after


def coast(
    t_s: float, p: Array, q: Array, v: Array, w: Array, horizon_s: float, dt_s: float
) -> tuple[Array, Array, Array]:
    """Return times (K,), positions (K, 3) and orientations (K, 4) at constant velocity and constant body rate.

    Raises
    ------
    ConfigError
        If horizon or step are not positive.
    """
    if not (horizon_s > 0.0 and dt_s > 0.0):
        raise ConfigError(f"rollout: horizon_s {horizon_s}, dt_s {dt_s}: both must be positive")
    count = max(1, round(horizon_s / dt_s))
    tau = dt_s * np.arange(1, count + 1, dtype=float)
    rate = float(np.linalg.norm(w))
    half = 0.5 * rate * tau
    turn = np.column_stack((np.cos(half), np.outer(np.sin(half) / rate if rate > 1e-12 else 0.5 * tau, w)))
    left = np.array(
        [
            [q[0], -q[1], -q[2], -q[3]],
            [q[1], q[0], -q[3], q[2]],
            [q[2], q[3], q[0], -q[1]],
            [q[3], -q[2], q[1], q[0]],
        ]
    )
    return t_s + tau, p + np.outer(tau, v), turn @ left.T


class ConstantVelocityEKF:
    """Baseline filter with the interface of ``TargetFilter``.

    Parameters
    ----------
    settings : noise of process and measurement
    rate_hz : sensing rate
    name : shown in results
    """

    def __init__(self, settings: EkfSettings, rate_hz: float, name: str = "ekf") -> None:
        if not rate_hz > 0.0:
            raise ConfigError(f"rate_hz {rate_hz}: must be positive")
        self.name = name
        self._settings = settings
        self._dt = 1.0 / rate_hz
        self._region = -1
        self._seen = False
        self._t = -math.inf
        self._last_seen = -math.inf
        self._p = np.full(3, np.nan)
        self._q = np.array([1.0, 0.0, 0.0, 0.0])
        self._v, self._w = np.zeros(3), np.zeros(3)
        self._estimate: TargetEstimate | None = None
        self._cov_p = np.diag([settings.position_noise_m**2, START_SPEED_MPS**2])
        self._cov_q = np.diag([settings.orientation_noise_rad**2] * 3 + [START_RATE_RADPS**2] * 3)

    @property
    def estimate(self) -> TargetEstimate:
        """See ``TargetFilter.estimate``; the radius is three standard deviations on the worst axis."""
        if self._estimate is None:
            self._estimate = self._present_estimate()
        return self._estimate

    def _present_estimate(self) -> TargetEstimate:
        radius = 3.0 * math.sqrt(self._cov_p[0, 0]) if self._region >= 0 else math.inf
        return TargetEstimate(
            t_s=self._t,
            p_world=self._p.copy(),
            q_world=self._q.copy(),
            v_world=self._v.copy(),
            w_body=self._w.copy(),
            seen=self._seen,
            last_seen_s=self._last_seen,
            region=self._region,
            radius_m=radius,
        )

    def correct(self, measurement: PoseMeasurement, region: int) -> None:
        """See ``TargetFilter.correct``; a measurement older than the state is moved along the present velocity."""
        p, q = measured_world_pose(measurement)
        t, self._estimate = measurement.t_s, None
        if self._region < 0:
            self._t, self._p, self._q = t, p, q
        else:
            if t < self._t:
                p, t = p + (self._t - t) * self._v, self._t
            self._advance(t)
            s = self._settings
            correct_state(
                self._p,
                self._q,
                self._v,
                self._w,
                self._cov_p,
                self._cov_q,
                p,
                q,
                s.position_noise_m**2,
                s.orientation_noise_rad**2,
            )
        self._region, self._seen, self._last_seen = region, True, t

    def predict(self, t_s: float) -> None:
        """See ``TargetFilter.predict``."""
        if self._region < 0 or t_s <= self._t:
            return
        self._estimate = None
        self._seen = t_s - self._last_seen <= LOST_PERIODS * self._dt
        self._advance(t_s)

    def _advance(self, t: float) -> None:
        s = self._settings
        predict_state(
            self._p,
            self._q,
            self._v,
            self._w,
            self._cov_p,
            self._cov_q,
            t - self._t,
            s.accel_psd_m2ps3,
            s.angular_accel_psd_rad2ps3,
        )
        self._t = t

    def rollout(self, horizon_s: float, dt_s: float) -> Rollout:
        """See ``TargetFilter.rollout``."""
        t, p, q = coast(self._t, self._p, self._q, self._v, self._w, horizon_s, dt_s)
        tau = dt_s * np.arange(1, len(t) + 1, dtype=np.float64)
        c, rho = self._cov_p, self._settings.accel_psd_m2ps3
        variance = c[0, 0] + 2.0 * tau * c[0, 1] + tau**2 * c[1, 1] + rho * tau**3 / 3.0
        radius = 3.0 * np.sqrt(variance) if self._region >= 0 else np.full(len(tau), np.inf)
        return Rollout(t, p, q, radius)

    def diagnostics(self) -> dict[str, float]:
        """Return standard deviations of position, velocity, orientation and body rate on one axis."""
        return {
            "position_std_m": math.sqrt(self._cov_p[0, 0]),
            "velocity_std_mps": math.sqrt(self._cov_p[1, 1]),
            "orientation_std_rad": math.sqrt(self._cov_q[2, 2]),
            "rate_std_radps": math.sqrt(self._cov_q[5, 5]),
        }
