"""An estimator that believes a target to be where it was seen last."""

from __future__ import annotations

import math

import numpy as np

from camnet.estimation.observation import measured_world_pose
from camnet.estimation.protocol import Rollout
from camnet.simulation.network import Network
from camnet.types import PoseMeasurement, TargetEstimate

__all__ = ["Steady", "steady"]


def steady(network: Network, target: int) -> Steady:
    """Return the estimator of one target, which may move as fast as its settings say."""
    return Steady(network.scenario.targets[target].v_max_mps)


class Steady:
    """Holds the last measured pose; its radius grows with the target's top speed.

    Parameters
    ----------
    v_max_mps : top speed of the target, m/s
    """

    name = "steady"

    def __init__(self, v_max_mps: float) -> None:
        self._v_max = v_max_mps
        self._p, self._q = np.full(3, np.nan), np.array([1.0, 0.0, 0.0, 0.0])
        self._t, self._last_seen, self._region = -math.inf, -math.inf, -1

    @property
    def estimate(self) -> TargetEstimate:
        """What is believed now."""
        still, seen = np.zeros(3), self._t == self._last_seen
        radius = self._v_max * (self._t - self._last_seen) if math.isfinite(self._t) else math.inf
        return TargetEstimate(
            self._t, self._p, self._q, still, still, seen, self._last_seen, self._region, radius
        )

    def correct(self, measurement: PoseMeasurement, region: int) -> None:
        """Take the measured pose as it is."""
        self._p, self._q = measured_world_pose(measurement)
        self._t = self._last_seen = measurement.t_s
        self._region = region

    def predict(self, t_s: float) -> None:
        """Let time pass."""
        if math.isfinite(self._last_seen):
            self._t = t_s

    def rollout(self, horizon_s: float, dt_s: float) -> Rollout:
        """Return the future path: it stands."""
        ahead = dt_s * np.arange(1, round(horizon_s / dt_s) + 1)
        n, radius = len(ahead), self.estimate.radius_m
        return Rollout(
            self._t + ahead, np.tile(self._p, (n, 1)), np.tile(self._q, (n, 1)), radius + self._v_max * ahead
        )

    def diagnostics(self) -> dict[str, float]:
        """Return the time since the last measurement, s."""
        return {"unseen_s": self._t - self._last_seen}
