"""AdaTE as predictor of the network (li2019): the interface of ``TargetFilter`` about `AdaptiveTrajectoryEstimator`.

The smoother takes one step every ``step_s``; the measurements of a step are carried to its end along the present
velocity and averaged. Between its steps, and over gaps, its state is carried by the model (cubature rule), with a
Kalman update for each measurement of the step under way. After a gap longer than ``restart_s`` a new track begins, with
the densities learnt so far: nothing in the old window says anything about the new one.

| symbol | name | shape | unit |
| --- | --- | --- | --- |
| s = [x, v, p, c] | ``_mean``: position, velocity, power, turn rate | (10,) | m, m/s, m^2/s^3, rad/s |
| P | ``_cov`` | (10, 10) | |
| r | error radius, ``inflation`` standard deviations of x on the worst axis | | m |

**Radius.** The covariance is the model's own opinion of a random turn rate. How many standard deviations a target was
really off is noted at each re-sighting; the radius holds the largest of the last few, times a margin. It is a record of
what happened (empirical), not a certificate.

**Orientation** is not in the model: it is measured, filtered at constant rate while seen, and turned with the path's
heading over a gap.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from camnet.errors import ConfigError
from camnet.estimation.adate import AdaptiveTrajectoryEstimator, AdateSettings
from camnet.estimation.adate.settings import AdaptationSettings, StartSettings, TruncationSettings
from camnet.estimation.ekf import ConstantVelocityEKF
from camnet.estimation.observation import LOST_PERIODS, measured_world_pose
from camnet.estimation.pls import PowerLimitedSteering
from camnet.estimation.protocol import Rollout
from camnet.estimation.settings import AdateFilterSettings, EkfSettings
from camnet.geometry.rotations import multiply
from camnet.types import Array, PoseMeasurement, TargetEstimate

__all__ = ["AdateFilter"]

#: gaps remembered, margin on the largest of them, and the factor before there was any
_GAPS, _MARGIN, _START = 8, 1.5, 3.0
_LEAST, _MOST = 1.0, 30.0
#: steps of a new track before its smoothed state is taken for the present one
_SETTLED = 4
_NOTHING = np.zeros((0, 3)), np.zeros((0, 3, 3))
_SAME_S = 1e-9


class AdateFilter:
    """Adaptive trajectory estimation with the power-limited steering model, for one target.

    Parameters
    ----------
    settings : model, step, noise
    ekf : noise of the filter that follows the orientation
    rate_hz : sensing rate
    name : shown in results

    Raises
    ------
    ConfigError
        The sensing rate is not positive.
    """

    def __init__(
        self, settings: AdateFilterSettings, ekf: EkfSettings, rate_hz: float, name: str = "adate"
    ) -> None:
        if not rate_hz > 0.0:
            raise ConfigError(f"rate_hz {rate_hz}: must be positive")
        self.name = name
        self._settings, self._dt = settings, 1.0 / rate_hz
        self._model = PowerLimitedSteering(
            alpha=settings.alpha_per_s,
            beta=settings.beta_mps2,
            power_density=settings.power_density,
            steering_density=settings.steering_density,
            rest_density=settings.rest_density,
            rest_speed=settings.rest_speed_mps,
        )
        self._attitude = ConstantVelocityEKF(ekf, rate_hz)
        self._track = self._new_track()
        self._t = self._last_seen = self._step_t = -math.inf
        self._region, self._seen, self._tracks = -1, False, 0
        self._mean: Array = np.full(10, np.nan)
        self._cov: Array = np.eye(10)
        self._bucket: list[tuple[float, Array]] = []
        self._left = (0.0, np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3))  # heading, q, w when last seen
        self._ratios: deque[float] = deque(maxlen=_GAPS)

    def _new_track(self) -> AdaptiveTrajectoryEstimator:
        s = self._settings
        return AdaptiveTrajectoryEstimator(
            self._model,
            s.step_s,
            AdateSettings(
                start=StartSettings(turn_sd_rad_s=s.turn_sd_radps),
                adaptation=AdaptationSettings(process_gain=s.process_gain),
                truncation=TruncationSettings(keep=s.keep, limit=s.limit),
            ),
        )

    # --- results -----------------------------------------------------------------------------------------------------

    @property
    def inflation(self) -> float:
        """How many standard deviations the radius is."""
        if not self._ratios:
            return _START
        return min(max(_MARGIN * max(self._ratios), _LEAST), _MOST)

    @property
    def estimate(self) -> TargetEstimate:
        """See ``TargetFilter.estimate``; the radius is `inflation` standard deviations on the worst axis."""
        q, w = self._orientation(self._mean)
        started = self._region >= 0
        return TargetEstimate(
            self._t,
            self._mean[:3].copy(),
            q,
            self._mean[3:6].copy() if started else np.zeros(3),
            w,
            self._seen,
            self._last_seen,
            self._region,
            self.inflation * _worst(self._cov) if started else math.inf,
        )

    def _orientation(self, mean: Array) -> tuple[Array, Array]:
        """Orientation (4,) and body rate (3,): as filtered while seen, turned with the heading since then."""
        if self._seen or self._region < 0:
            now = self._attitude.estimate
            return now.q_world, now.w_body
        heading, q, w = self._left
        turned = 0.5 * (_heading(mean) - heading)
        spin = np.array([math.cos(turned), 0.0, 0.0, math.sin(turned)])
        return multiply(spin, q), w

    def rollout(self, horizon_s: float, dt_s: float) -> Rollout:
        """See ``TargetFilter.rollout``."""
        if not (horizon_s > 0.0 and dt_s > 0.0):
            raise ConfigError(f"rollout: horizon_s {horizon_s}, dt_s {dt_s}: both must be positive")
        count = max(1, round(horizon_s / dt_s))
        times = self._t + dt_s * np.arange(1, count + 1, dtype=np.float64)
        p, q, radius = np.empty((count, 3)), np.empty((count, 4)), np.full(count, math.inf)
        mean, cov, factor = self._mean.copy(), self._cov.copy(), self.inflation
        q0, _ = self._orientation(mean)
        first = _heading(mean)
        for k in range(count):
            if self._region >= 0:
                self._track.carry(mean, cov, dt_s)
                radius[k] = factor * _worst(cov)
            half = 0.5 * (_heading(mean) - first)
            p[k] = mean[:3]
            q[k] = multiply(np.array([math.cos(half), 0.0, 0.0, math.sin(half)]), q0)
        return Rollout(times, p, q, radius)

    def diagnostics(self) -> dict[str, float]:
        """Return steps, tracks, restarts, learnt factors of the densities, and the radius in standard deviations."""
        track = self._track
        return {
            "steps": float(track.steps),
            "tracks": float(self._tracks),
            "restarts": float(track.restarts),
            "power_scale": track.power_scale,
            "steering_scale": track.steering_scale,
            "inflation": self.inflation,
            "position_std_m": _worst(self._cov) if self._region >= 0 else math.inf,
        }

    # --- advancing ---------------------------------------------------------------------------------------------------

    def correct(self, measurement: PoseMeasurement, region: int) -> None:
        """See ``TargetFilter.correct``; a measurement older than the state is moved along the present velocity."""
        p, _ = measured_world_pose(measurement)
        t = measurement.t_s
        self._attitude.correct(measurement, region)
        if self._region < 0:
            self._begin(t, p)
        else:
            if t < self._t:
                p, t = p + (self._t - t) * self._mean[3:6], self._t
            self._advance(t)
            if not self._seen:
                self._resight(t, p)
            self._take(p)
        self._bucket.append((t, p))
        self._region, self._seen, self._last_seen = region, True, t

    def predict(self, t_s: float) -> None:
        """See ``TargetFilter.predict``."""
        if self._region < 0 or t_s <= self._t:
            return
        self._attitude.predict(t_s)
        self._advance(t_s)
        lost = t_s - self._last_seen > LOST_PERIODS * self._dt
        if lost and self._seen:
            now = self._attitude.estimate
            self._left = (_heading(self._mean), now.q_world, now.w_body)
            self._seen = False

    def _begin(self, t_s: float, p: Array) -> None:
        """Begin a track at a measured position (3,), with a wide velocity."""
        s = self._settings
        variances = [s.position_noise_m**2] * 3 + [4.0] * 3 + [0.04] + [s.turn_sd_radps**2] * 3
        self._mean, self._cov = np.zeros(10), np.diag(variances)
        self._mean[:3] = p
        self._t, self._step_t = t_s, t_s
        self._tracks += 1

    def _resight(self, t_s: float, p: Array) -> None:
        """Note how wrong the prediction was; after a long gap begin a new track with what was learnt."""
        worst = _worst(self._cov)
        self._ratios.append(float(np.linalg.norm(p - self._mean[:3])) / max(worst, 1e-6))
        if t_s - self._last_seen > self._settings.restart_s:
            old, self._track = self._track, self._new_track()
            self._track.inherit(old)
            self._bucket, self._step_t = [], t_s
            self._begin(t_s, p)

    def _advance(self, t_s: float) -> None:
        """Carry the present state to ``t_s``; the smoother takes the steps that end on the way."""
        step = self._settings.step_s
        while self._step_t + step <= t_s + _SAME_S:
            end = self._step_t + step
            self._carry(end)
            if end - self._last_seen <= self._settings.restart_s:
                self._smooth(end)
            self._step_t = end
        self._carry(t_s)

    def _carry(self, t_s: float) -> None:
        if t_s > self._t + _SAME_S:
            self._track.carry(self._mean, self._cov, t_s - self._t)
            self._t = t_s

    def _smooth(self, end_s: float) -> None:
        """One step of the smoother at ``end_s``, and its result in place of the present state."""
        bucket, self._bucket = self._bucket, []
        if bucket:
            v = self._mean[3:6]
            here = np.mean([p + (end_s - t) * v for t, p in bucket], axis=0)
            variance = self._settings.position_noise_m**2 / len(bucket)
            self._track.update(here[None], variance * np.eye(3)[None])
        elif self._track.steps:
            self._track.update(*_NOTHING)
        if self._track.steps >= _SETTLED:
            self._mean, self._cov = self._track.causal_state, self._track.covariance

    def _take(self, p: Array) -> None:
        """Kalman update, in Joseph form, of the present state with a measured position (3,)."""
        r = self._settings.position_noise_m**2 * np.eye(3)
        gain = np.linalg.solve(self._cov[:3, :3] + r, self._cov[:3]).T
        left = np.eye(10)
        left[:, :3] -= gain
        self._mean = self._mean + gain @ (p - self._mean[:3])
        cov = left @ self._cov @ left.T + gain @ r @ gain.T
        self._cov = 0.5 * (cov + cov.T)


def _worst(cov: Array) -> float:
    """Largest standard deviation of the position, m."""
    return math.sqrt(max(float(np.linalg.eigvalsh(cov[:3, :3])[-1]), 0.0))


def _heading(mean: Array) -> float:
    return math.atan2(mean[4], mean[3])
