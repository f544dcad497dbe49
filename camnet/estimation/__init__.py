"""Estimators and predictors of a target's pose, and the motion model they learn.

Every estimator of one target is a ``TargetFilter`` (``protocol``): ``LearningEstimator`` learns the motion per region
and predicts across gaps, ``ConstantVelocityEKF`` is the baseline, ``IdealPredictor`` knows the true velocities.

Read next: ``learning_estimator`` for the whole, then ``concurrent_learning`` (update laws), ``propagate`` (predictor),
``stack`` and ``selection`` (what data is kept), ``gap`` (learning where nothing was measured), ``placement`` (kernels).
"""

from camnet.estimation.basis import RbfBasis
from camnet.estimation.ekf import ConstantVelocityEKF
from camnet.estimation.ideal import IdealPredictor
from camnet.estimation.learning_estimator import LearningEstimator
from camnet.estimation.placement import place_basis
from camnet.estimation.protocol import Rollout, TargetFilter
from camnet.estimation.settings import EstimatorSettings

__all__ = [
    "ConstantVelocityEKF",
    "EstimatorSettings",
    "IdealPredictor",
    "LearningEstimator",
    "RbfBasis",
    "Rollout",
    "TargetFilter",
    "place_basis",
]
