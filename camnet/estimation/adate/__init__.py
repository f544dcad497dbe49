"""Adaptive trajectory estimation: sparse MAP over a sliding window that learns its own covariances."""

from camnet.estimation.adate.estimator import AdaptiveTrajectoryEstimator
from camnet.estimation.adate.settings import AdateSettings

__all__ = ["AdaptiveTrajectoryEstimator", "AdateSettings"]
