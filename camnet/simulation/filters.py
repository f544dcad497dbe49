"""Build the estimators that run side by side on the same measurements.

| name | what |
| --- | --- |
| `learned` | learning estimator with the remedies of the gap problem |
| `printed` | the same without them: the predictor as printed in harris2020, (3-7), (4-17) |
| `ekf` | constant-velocity extended Kalman filter |
| `ideal` | the target's true velocities in place of the network |
"""

from __future__ import annotations

from collections.abc import Callable

from camnet.estimation.basis import RbfBasis
from camnet.estimation.ekf import ConstantVelocityEKF
from camnet.estimation.ideal import IdealPredictor
from camnet.estimation.learning_estimator import LearningEstimator
from camnet.estimation.protocol import TargetFilter
from camnet.estimation.settings import EstimatorSettings, GapSettings
from camnet.types import Array, Twist

__all__ = ["FILTERS", "build_filter"]

FILTERS = ("learned", "printed", "ekf", "ideal")


def build_filter(
    name: str,
    settings: EstimatorSettings,
    basis: RbfBasis,
    n_regions: int,
    rate_hz: float,
    bounds: Array,
    true_twist: Callable[[float], Twist],
) -> TargetFilter:
    """Build one estimator of one target.

    Parameters
    ----------
    name : one of `FILTERS`
    n_regions : number of regions, each with its own model
    rate_hz : sensing rate
    bounds : (2, 3) corners of the tracking space, m
    true_twist : the truth at a time, for the ideal predictor alone
    """
    if name == "ekf":
        return ConstantVelocityEKF(settings.ekf, rate_hz)
    if name == "ideal":
        return IdealPredictor(true_twist, settings, rate_hz)
    if name == "printed":
        bare = GapSettings(prior="none", learn_across=False)
        settings = settings.model_copy(update={"gap": bare, "leakage": 0.0})
    return LearningEstimator(settings, basis, n_regions, rate_hz, bounds, name)
