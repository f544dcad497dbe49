"""Trajectories around obstacles: the most probable one of the power-limited steering model (li2019, section V-B).

Read `plan` (what a plan is) and `planner`, then `objective` (what is minimised), `solver` (how), `starts` (from
where), `curve` and `distance_kernel` (what is checked).
"""

from camnet.control.planner.curve import Curve
from camnet.control.planner.obstacles import Obstacle, box, cylinder, ellipsoid, from_shape, sphere
from camnet.control.planner.plan import Plan, Waypoint
from camnet.control.planner.planner import Planner
from camnet.control.planner.settings import PlannerSettings

__all__ = [
    "Curve",
    "Obstacle",
    "Plan",
    "Planner",
    "PlannerSettings",
    "Waypoint",
    "box",
    "cylinder",
    "ellipsoid",
    "from_shape",
    "sphere",
]
