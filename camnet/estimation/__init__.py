"""Estimators and predictors of a target's pose, and the motion model they learn.

Every estimator of one target is a ``TargetFilter`` (``protocol``): ``LearningEstimator`` learns the motion per region
and predicts across gaps, ``ConstantVelocityEKF`` is the baseline, ``IdealPredictor`` knows the true velocities.

Read next: ``learning_estimator`` for the whole, then ``concurrent_learning`` (update laws), ``propagate`` (predictor),
``stack``, ``selection`` and ``selection_secular`` (what data is kept), ``learner`` (outliers and changes of behaviour),
``gap`` (learning where nothing was measured), ``pace`` (speed as a state), ``excitation`` (what the analysis supports),
``placement`` (kernels), ``persistence`` (models on disk, merged). ``measured_step``, ``weight_step`` and ``ekf_step``
are the compiled forms of the laws.
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
