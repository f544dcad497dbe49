"""What every estimator of one target offers: the learning estimator, the Kalman filter and the ideal predictor alike.

A caller feeds ``correct`` with each pose measurement and calls ``predict`` at the times without one; results are in the
world frame. The change from seen to unseen is the filter's own business: a target is unseen once no measurement has
come for more than `camnet.estimation.observation.LOST_PERIODS` sensing periods.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from camnet.types import Array, PoseMeasurement, TargetEstimate

__all__ = ["Learns", "Rollout", "TargetFilter"]


@dataclass(frozen=True, eq=False, slots=True)
class Rollout:
    """A predicted path, K instants after the present one (the present is not repeated).

    Attributes
    ----------
    t_s : (K,) times, s
    p_world, q_world : (K, 3), (K, 4) predicted pose, m and unit quaternions (body to world)
    radius_m : (K,) empirical error radius of the position, m (inf when unknown)
    """

    t_s: Array
    p_world: Array
    q_world: Array
    radius_m: Array


@runtime_checkable
class TargetFilter(Protocol):
    """Estimator and predictor of one target."""

    name: str

    @property
    def estimate(self) -> TargetEstimate:
        """What is believed now; before the first measurement the position is NaN and ``region`` is -1."""

    def correct(self, measurement: PoseMeasurement, region: int) -> None:
        """Advance to ``measurement.t_s`` with the measurement in force; the first call initialises.

        ``region`` is the index of the operating region in which the target was seen.
        """

    def predict(self, t_s: float) -> None:
        """Advance to ``t_s`` without a measurement; nothing happens before the first one."""

    def rollout(self, horizon_s: float, dt_s: float) -> Rollout:
        """Future path if no measurement came any more; no side effects."""

    def diagnostics(self) -> dict[str, float]:
        """Figures about the inner state (sizes, eigenvalues, norms), for logs."""


@runtime_checkable
class Learns(Protocol):
    """An estimator that learns, and can say how far certificates may rely on it (harris2020, Assumption 4.7)."""

    def excitation(self, region: int) -> tuple[float, float]:
        """Since when, s, a region's model holds a stack of full rank, and excites the places visited (inf: not)."""

    def weight_norm(self, region: int) -> float:
        """Norm of the weights of a region's model that are bounded by its projection."""
