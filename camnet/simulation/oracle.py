"""The oracle: the truth now, and the target's true future for a rollout. What any estimator could reach at best."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from camnet.errors import ConfigError
from camnet.estimation.observation import LOST_PERIODS
from camnet.estimation.protocol import Rollout
from camnet.types import Array, Pose, PoseMeasurement, TargetEstimate, Twist

__all__ = ["Oracle"]


class Oracle:
    """Knows where the target is and will be; reads nothing of a measurement but when it came, and from where.

    Before the first measurement it says nothing, as every estimator, so that rows stay comparable.

    Parameters
    ----------
    pose, twist : the truth at the time of asking
    future : times (K,), s, to true poses (K, 3), (K, 4)
    rate_hz : sensing rate
    """

    def __init__(
        self,
        pose: Callable[[], Pose],
        twist: Callable[[float], Twist],
        future: Callable[[Array], tuple[Array, Array]],
        rate_hz: float,
        name: str = "oracle",
    ) -> None:
        self.name = name
        self._pose, self._twist, self._future, self._dt = pose, twist, future, 1.0 / rate_hz
        self._t = self._last_seen = -math.inf
        self._region, self._seen = -1, False

    @property
    def estimate(self) -> TargetEstimate:
        """See ``TargetFilter.estimate``; the radius is zero."""
        if self._region < 0:
            nowhere, at_rest = np.full(3, np.nan), np.zeros(3)
            level = np.array([1.0, 0.0, 0.0, 0.0])
            return TargetEstimate(-math.inf, nowhere, level, at_rest, at_rest, False, -math.inf, -1, math.inf)
        pose, twist = self._pose(), self._twist(self._t)
        return TargetEstimate(
            self._t,
            pose.p.copy(),
            pose.q.copy(),
            twist.v.copy(),
            twist.w.copy(),
            self._seen,
            self._last_seen,
            self._region,
            0.0,
        )

    def correct(self, measurement: PoseMeasurement, region: int) -> None:
        """See ``TargetFilter.correct``."""
        self._t = max(self._t, measurement.t_s)
        self._last_seen, self._region, self._seen = self._t, region, True

    def predict(self, t_s: float) -> None:
        """See ``TargetFilter.predict``."""
        if self._region < 0 or t_s <= self._t:
            return
        self._t = t_s
        self._seen = t_s - self._last_seen <= LOST_PERIODS * self._dt

    def rollout(self, horizon_s: float, dt_s: float) -> Rollout:
        """See ``TargetFilter.rollout``; the true path."""
        if not (horizon_s > 0.0 and dt_s > 0.0):
            raise ConfigError(f"rollout: horizon_s {horizon_s}, dt_s {dt_s}: both must be positive")
        t = self._t + dt_s * np.arange(1, max(1, round(horizon_s / dt_s)) + 1, dtype=float)
        if self._region < 0:
            k = len(t)
            return Rollout(
                t, np.full((k, 3), np.nan), np.tile([1.0, 0.0, 0.0, 0.0], (k, 1)), np.full(k, np.inf)
            )
        p, q = self._future(t)
        return Rollout(t, p, q, np.zeros(len(t)))

    def diagnostics(self) -> dict[str, float]:
        """Nothing is learned."""
        return {}
