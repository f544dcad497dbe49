"""Build the estimators that run side by side on the same measurements.

| name | what |
| --- | --- |
| `learned` | learning estimator with the remedies of the gap problem |
| `learned_shared` | the same; all targets' estimators have one memory, so that each learns from all |
| `printed` | `learned` without the remedies: the predictor as printed in harris2020, (3-7), (4-17) |
| `adate` | adaptive trajectory estimation with the power-limited steering model (li2019) |
| `ekf`, `ukf` | constant-velocity extended and unscented Kalman filters |
| `ideal` | the target's true velocities in place of the network |
| `oracle` | the truth now and to come |
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from camnet.errors import ConfigError
from camnet.estimation.basis import RbfBasis
from camnet.estimation.ekf import ConstantVelocityEKF
from camnet.estimation.ideal import IdealPredictor
from camnet.estimation.learner import RegionMemory
from camnet.estimation.learning_estimator import LearningEstimator, shared_memories
from camnet.estimation.protocol import TargetFilter
from camnet.estimation.settings import EstimatorSettings, GapSettings
from camnet.estimation.ukf import ConstantVelocityUKF
from camnet.geometry.settings import Road
from camnet.simulation.oracle import Oracle
from camnet.types import Array, Pose, Twist

__all__ = ["FILTERS", "SHARED", "TargetTruth", "build_filter", "build_filters"]

FILTERS = ("learned", "learned_shared", "printed", "adate", "ekf", "ukf", "ideal", "oracle")
#: filters whose targets learn from each other
SHARED = ("learned_shared",)


@dataclass(frozen=True, eq=False, slots=True)
class TargetTruth:
    """The truth of one target, for the rows that are told it.

    Attributes
    ----------
    twist : time in s to the velocity then; asked for the present alone
    pose : the present pose
    future : times (K,), s, to poses (K, 3), (K, 4)
    """

    twist: Callable[[float], Twist]
    pose: Callable[[], Pose] | None = None
    future: Callable[[Array], tuple[Array, Array]] | None = None


def build_filters(
    name: str,
    settings: EstimatorSettings,
    basis: RbfBasis,
    n_regions: int,
    rate_hz: float,
    bounds: Array,
    truths: Sequence[TargetTruth],
    roads: Sequence[Road] = (),
) -> list[TargetFilter]:
    """Build the estimators ``name`` of all targets, in the targets' order; they have to be advanced in that order.

    Parameters are those of `build_filter`; ``truths`` has one entry a target.
    """
    common = shared_memories(settings, basis, n_regions, rate_hz) if name in SHARED else None
    return [
        build_filter(name, settings, basis, n_regions, rate_hz, bounds, truth, common, roads)
        for truth in truths
    ]


def build_filter(
    name: str,
    settings: EstimatorSettings,
    basis: RbfBasis,
    n_regions: int,
    rate_hz: float,
    bounds: Array,
    truth: TargetTruth,
    memories: Sequence[RegionMemory] | None = None,
    roads: Sequence[Road] = (),
) -> TargetFilter:
    """Build one estimator of one target.

    Parameters
    ----------
    name : one of `FILTERS`
    n_regions : number of regions, each with its own model
    rate_hz : sensing rate
    bounds : (2, 3) corners of the tracking space, m
    truth : for the ideal predictor and the oracle alone
    memories : in common with other targets, for the filters in `SHARED`
    roads : of the world, for ``gap.prior: road``

    Raises
    ------
    ConfigError
        The name is none of `FILTERS`, or the world cannot tell the future that an oracle needs.
    """
    if name == "ekf":
        return ConstantVelocityEKF(settings.ekf, rate_hz)
    if name == "ukf":
        return ConstantVelocityUKF(settings.ekf, rate_hz)
    if name == "adate":
        from camnet.estimation.adate_filter import AdateFilter  # compiled, and needed by this name only

        return AdateFilter(settings.adate, settings.ekf, rate_hz)
    if name == "ideal":
        return IdealPredictor(truth.twist, settings, rate_hz)
    if name == "oracle":
        if truth.pose is None or truth.future is None:
            raise ConfigError("estimator 'oracle': this world cannot tell its targets' future")
        return Oracle(truth.pose, truth.twist, truth.future, rate_hz)
    if name == "printed":
        bare = GapSettings(prior="none", learn_across=False)
        settings = settings.model_copy(update={"gap": bare, "leakage": 0.0})
    elif name not in ("learned", "learned_shared"):
        raise ConfigError(f"estimator {name!r}: expected one of {', '.join(FILTERS)}")
    return LearningEstimator(settings, basis, n_regions, rate_hz, bounds, name, memories, roads)
