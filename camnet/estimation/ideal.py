"""The ideal predictor: the estimator's feedback, but true velocities in place of the learned model (parikh2018, VII).

It says what the learning estimator could reach at best with a perfect motion model, and is for comparison only: the
velocities come from the truth through a callable.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from camnet.errors import ConfigError
from camnet.estimation.concurrent_learning import SWITCHING, correct_pose
from camnet.estimation.ekf import coast
from camnet.estimation.observation import LOST_PERIODS, measured_world_pose
from camnet.estimation.protocol import Rollout
from camnet.estimation.radius import ErrorRadius
from camnet.estimation.settings import EstimatorSettings
from camnet.geometry.rotations_compiled import align_sign, exp, multiply, normalise
from camnet.types import Array, PoseMeasurement, TargetEstimate, Twist

__all__ = ["IdealPredictor"]


class IdealPredictor:
    """Integrates the true twist; filters measurements with the gains of the learning estimator.

    Parameters
    ----------
    twist_source : time in s to the true twist then (v in the world frame, w in the body frame); it is asked only for
        the time to which the predictor is being advanced, and each step uses the mean of its two ends
    settings : gains
    rate_hz : sensing rate
    name : shown in results
    """

    def __init__(
        self,
        twist_source: Callable[[float], Twist],
        settings: EstimatorSettings,
        rate_hz: float,
        name: str = "ideal",
    ) -> None:
        if not rate_hz > 0.0:
            raise ConfigError(f"rate_hz {rate_hz}: must be positive")
        self.name = name
        self._source = twist_source
        self._settings = settings
        self._switch = SWITCHING[settings.switching]
        self._dt = 1.0 / rate_hz
        self._radius = ErrorRadius()
        self._region = -1
        self._seen = False
        self._t = -math.inf
        self._last_seen = -math.inf
        self._p = np.full(3, np.nan)
        self._q = np.array([1.0, 0.0, 0.0, 0.0])
        self._twist = np.zeros(6)

    @property
    def estimate(self) -> TargetEstimate:
        """See ``TargetFilter.estimate``."""
        return TargetEstimate(
            t_s=self._t,
            p_world=self._p.copy(),
            q_world=self._q.copy(),
            v_world=self._twist[0:3].copy(),
            w_body=self._twist[3:6].copy(),
            seen=self._seen,
            last_seen_s=self._last_seen,
            region=self._region,
            radius_m=self._radius.base() if self._region >= 0 else math.inf,
        )

    def correct(self, measurement: PoseMeasurement, region: int) -> None:
        """See ``TargetFilter.correct``; a measurement older than the state is moved along the present velocity."""
        p, q = measured_world_pose(measurement)
        t = measurement.t_s
        if self._region < 0:
            self._t, self._p, self._q, self._twist = t, p, q, self._true_twist(t)
        else:
            if t < self._t:
                p, t = p + (self._t - t) * self._twist[0:3], self._t
            duration = t - self._t
            self._advance(t)
            s = self._settings
            self._p, self._q, error = correct_pose(
                self._p,
                self._q,
                p,
                align_sign(q, self._q),
                s.k1_per_s,
                s.k2,
                self._switch,
                s.boundary_layer,
                duration,
            )
            self._radius.seen(float(np.linalg.norm(error[0:3])))
        self._region, self._seen, self._last_seen = region, True, t

    def predict(self, t_s: float) -> None:
        """See ``TargetFilter.predict``."""
        if self._region < 0 or t_s <= self._t:
            return
        self._seen = t_s - self._last_seen <= LOST_PERIODS * self._dt
        self._advance(t_s)

    def _true_twist(self, t_s: float) -> Array:
        twist = self._source(t_s)
        return np.concatenate((twist.v, twist.w))

    def _advance(self, t: float) -> None:
        """Trapezoid rule over the step."""
        dt = t - self._t
        new = self._true_twist(t)
        mean = 0.5 * (self._twist + new)
        self._p = self._p + dt * mean[0:3]
        self._q = normalise(multiply(self._q, exp(dt * mean[3:6])))
        self._twist, self._t = new, t

    def rollout(self, horizon_s: float, dt_s: float) -> Rollout:
        """At the present true twist: the future twist is nobody's to know."""
        t, p, q = coast(self._t, self._p, self._q, self._twist[0:3], self._twist[3:6], horizon_s, dt_s)
        radius = self._radius.base() if self._region >= 0 else math.inf
        return Rollout(t, p, q, np.full(len(t), radius))

    def diagnostics(self) -> dict[str, float]:
        """Nothing is learned."""
        return {}
