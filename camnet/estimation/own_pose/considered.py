"""Any filter of one target, with the uncertainty of the cameras' own poses in its error radius.

An agent's error of its own pose is nearly the same in all images of a sighting. To take it for noise of a measurement
would average it away: it is considered beside the filter (Schmidt), as what it adds to the radius from the last
measurement on. Covariances of what the agent knows of its own pose travel with the measurement
(`camnet.types.CameraMotion`), and so with a handoff: whoever waits for the target widens its search by it.
"""

from __future__ import annotations

from dataclasses import replace

from camnet.estimation.own_pose.spread import own_spread
from camnet.estimation.protocol import Rollout, TargetFilter
from camnet.types import PoseMeasurement, TargetEstimate

__all__ = ["SIGMAS", "ConsideredFilter"]

#: standard deviations in an error radius, as in the filters' own
SIGMAS = 3.0


class ConsideredFilter:
    """See the module's head; the interface is the filter's.

    Parameters
    ----------
    inner : the filter
    """

    def __init__(self, inner: TargetFilter) -> None:
        self.name, self.inner = inner.name, inner
        #: what the last measurement's camera adds to the radius, m
        self.own_m = 0.0

    @property
    def estimate(self) -> TargetEstimate:
        """See ``TargetFilter.estimate``."""
        e = self.inner.estimate
        return e if self.own_m == 0.0 else replace(e, radius_m=e.radius_m + self.own_m)

    def correct(self, measurement: PoseMeasurement, region: int) -> None:
        """See ``TargetFilter.correct``."""
        self.own_m = SIGMAS * own_spread(measurement)
        self.inner.correct(measurement, region)

    def predict(self, t_s: float) -> None:
        """See ``TargetFilter.predict``."""
        self.inner.predict(t_s)

    def rollout(self, horizon_s: float, dt_s: float) -> Rollout:
        """See ``TargetFilter.rollout``."""
        r = self.inner.rollout(horizon_s, dt_s)
        return r if self.own_m == 0.0 else replace(r, radius_m=r.radius_m + self.own_m)

    def diagnostics(self) -> dict[str, float]:
        """See ``TargetFilter.diagnostics``; ``own_pose_m`` is what the camera's pose adds to the radius, m."""
        return {**self.inner.diagnostics(), "own_pose_m": self.own_m}
