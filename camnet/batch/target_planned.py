"""Targets that follow a plan: `camnet.motion.planned`, one step of one target.

A plan is a row of numbers, so that environments of one network may each have their own.

| column of a plan | meaning |
| --- | --- |
| 0 | roads: offset to the left of the way, m |
| 1 | length of a piece of the time, s |
| 2, 3 | when it stops, and for how long, s |
| 4 | fields: speed at the share 1, over the field's own |
| 5, 6 | number of turns and of speeds |
| ``TURNS``, ``SPEEDS`` | draws at junctions; shares of the speed interval, one for each piece |
"""

from __future__ import annotations

import math

import numpy as np

from camnet.batch.compiled import inner
from camnet.batch.target_field import PACE, set_planar, step_field, wrapped
from camnet.batch.target_laws import Targets
from camnet.batch.target_road import LEASH_STEPS, on_road, way_on
from camnet.errors import ConfigError
from camnet.motion.planned import SPEED_LAG_S, PlannedField, PlannedRoad
from camnet.motion.protocol import TargetMotion
from camnet.types import Array

__all__ = ["PLAN", "pack_plan", "step_planned_field", "step_planned_road"]

_MOST_TURNS, _MOST_SPEEDS = 16, 16
TURNS = 7
SPEEDS = TURNS + _MOST_TURNS
#: numbers of a plan
PLAN = SPEEDS + _MOST_SPEEDS


def pack_plan(motion: TargetMotion) -> Array:
    """Pack the plan (PLAN,) of a target; zeros where it has none.

    Raises
    ------
    ConfigError
        It decides on more turns or speeds than a row holds.
    """
    out = np.zeros(PLAN)
    if not isinstance(motion, PlannedRoad | PlannedField):
        return out
    plan = motion.plan
    turns, speeds = len(plan.turns), len(plan.speeds)
    if turns > _MOST_TURNS or speeds > _MOST_SPEEDS:
        raise ConfigError(
            f"batch back end: a plan of {turns} turns and {speeds} speeds: at most {_MOST_TURNS} and {_MOST_SPEEDS}"
        )
    offset = plan.lateral * motion.widest_m if isinstance(motion, PlannedRoad) else 0.0
    out[:TURNS] = offset, plan.piece_s, plan.stop_at_s, plan.stop_s, plan.pace, turns, speeds
    out[TURNS : TURNS + turns], out[SPEEDS : SPEEDS + speeds] = plan.turns, plan.speeds
    return out


@inner
def _share(plan: Array, t_s: float) -> float:
    """Share of the speed interval in the piece of the time that ``t_s`` is in."""
    return float(plan[SPEEDS + int(t_s / plan[1]) % int(plan[6])])


@inner
def step_planned_field(
    t: Targets, m: int, now: Array, inner: Array, e: int, t_s: float, dt: float, plan: Array
) -> None:
    """`PlannedField.step`."""
    inner[e, m, PACE] = 1.0 + (plan[4] - 1.0) * _share(plan, t_s)
    step_field(t, m, now, inner, e, dt)


@inner
def _run_ahead(
    t: Targets, road: int, forward: bool, arc: float, distance: float, plan: Array, taken: int
) -> tuple[int, bool, float, int]:
    """Move the point ahead along the roads, turning as the plan says; the last number counts the turns."""
    while True:
        length = t.lines[t.line_first[road + 1] - 1, 2]
        left = length - arc if forward else arc
        if distance < left:
            return road, forward, arc + distance if forward else arc - distance, taken
        distance -= left
        road, forward = way_on(t, road, forward, plan[TURNS + taken % int(plan[5])])
        taken += 1
        arc = 0.0 if forward else t.lines[t.line_first[road + 1] - 1, 2]


@inner
def step_planned_road(
    t: Targets, m: int, now: Array, inner: Array, e: int, t_s: float, dt: float, plan: Array
) -> None:
    """`PlannedRoad.step`; ``inner`` holds heading, the point ahead (road, direction, arc), speed and turns taken."""
    x, y, theta = now[e, m, 0], now[e, m, 1], inner[e, m, 0]
    road, forward, arc = int(inner[e, m, 1]), inner[e, m, 2] > 0.0, inner[e, m, 3]
    v, taken = inner[e, m, 4], int(inner[e, m, 5])
    slow, fast, leash = t.shape[m, 0], t.shape[m, 1], t.shape[m, 7]
    v += (1.0 - math.exp(-dt / SPEED_LAG_S)) * (slow + (fast - slow) * _share(plan, t_s) - v)
    inner[e, m, 4] = v
    if plan[2] <= t_s < plan[2] + plan[3]:
        set_planar(now, e, m, x, y, 0.0, theta, 0.0, 0.0)
        return
    for _ in range(LEASH_STEPS):
        goal_x, goal_y = on_road(t, road, forward, arc, plan[0])
        slack = leash - math.sqrt((goal_x - x) ** 2 + (goal_y - y) ** 2)
        if slack <= 1e-9:
            break
        road, forward, arc, taken = _run_ahead(t, road, forward, arc, slack, plan, taken)
    goal_x, goal_y = on_road(t, road, forward, arc, plan[0])
    bearing = wrapped(math.atan2(goal_y - y, goal_x - x) - theta)
    sharp = math.copysign(t.shape[m, 6], bearing)  # behind: turn as sharply as allowed
    w = sharp if abs(bearing) > 0.5 * math.pi else 2.0 * v * math.sin(bearing) / leash
    middle = theta + 0.5 * dt * w
    theta += dt * w
    set_planar(now, e, m, x + dt * v * math.cos(middle), y + dt * v * math.sin(middle), 0.0, theta, v, w)
    inner[e, m, 0], inner[e, m, 1], inner[e, m, 2], inner[e, m, 3] = theta, road, 1.0 if forward else 0.0, arc
    inner[e, m, 5] = taken
