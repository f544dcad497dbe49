"""Power-limited steering model: where a body with limited power and a slowly changing turn rate will be.

Read `model` (the object), then `speed` (exact speed transition), `flow` (state and derivative), `noise` (covariance)
and `reference` (the plain SciPy version that the compiled kernels are tested against).
"""

from camnet.estimation.pls.flow import linear_form
from camnet.estimation.pls.model import ConstantTurn, PowerLimitedSteering, SteeringModel
from camnet.estimation.pls.speed import compensation, equilibrium_speed, speed_transition

__all__ = [
    "ConstantTurn",
    "PowerLimitedSteering",
    "SteeringModel",
    "compensation",
    "equilibrium_speed",
    "linear_form",
    "speed_transition",
]
