"""An agent's estimate of its own pose from a velocity source, with fixes of an external pose while there are any."""

from camnet.estimation.own_pose.considered import SIGMAS, ConsideredFilter
from camnet.estimation.own_pose.dead_reckoning import (
    OwnErrors,
    OwnModel,
    advance_own,
    draw_errors,
    fix_own,
    own_model,
    start_own,
)
from camnet.estimation.own_pose.spread import own_spread

__all__ = [
    "SIGMAS",
    "ConsideredFilter",
    "OwnErrors",
    "OwnModel",
    "advance_own",
    "draw_errors",
    "fix_own",
    "own_model",
    "own_spread",
    "start_own",
]
