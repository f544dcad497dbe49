"""Targets on roads: `camnet.motion.road` and `camnet.motion.road_network`, one step of one target."""

from __future__ import annotations

import math

from camnet.batch.compiled import inner
from camnet.batch.random import Streams, normal, uniform
from camnet.batch.target_field import set_planar, wrapped
from camnet.batch.target_laws import Targets
from camnet.types import Array

__all__ = ["LEASH_STEPS", "on_road", "step_road", "way_on"]

#: as in `camnet.motion.road`
_WANDER_S, LEASH_STEPS = 10.0, 4


@inner
def _wander(inner: Array, e: int, m: int, dt: float, streams: Streams, row: int) -> None:
    """Advance the four wander states of a vehicle: `camnet.motion.road._wandered`."""
    keep = math.exp(-dt / _WANDER_S)
    kick = math.sqrt(1.0 - keep * keep)
    for k in (4, 6):
        rough, smooth = inner[e, m, k], inner[e, m, k + 1]
        inner[e, m, k + 1] = smooth + (1.0 - keep) * (rough - smooth)
        inner[e, m, k] = keep * rough + kick * normal(streams, row)


@inner
def on_road(t: Targets, road: int, forward: bool, arc: float, offset: float) -> tuple[float, float]:
    """Place on a road, ``offset`` to the left of the way along it."""
    begin, n = t.line_first[road], t.line_first[road + 1] - t.line_first[road]
    low, high = 0, n  # bisect_right
    while low < high:
        middle = (low + high) // 2
        if arc < t.lines[begin + middle, 2]:
            high = middle
        else:
            low = middle + 1
    k = begin + min(max(low - 1, 0), n - 2)
    f = (arc - t.lines[k, 2]) / (t.lines[k + 1, 2] - t.lines[k, 2])
    dx, dy = t.lines[k + 1, 0] - t.lines[k, 0], t.lines[k + 1, 1] - t.lines[k, 1]
    length = math.sqrt(dx * dx + dy * dy)
    side = (offset if forward else -offset) / length
    return t.lines[k, 0] + f * dx - side * dy, t.lines[k, 1] + f * dy + side * dx


@inner
def way_on(t: Targets, road: int, forward: bool, draw: float) -> tuple[int, bool]:
    """Road and direction taken at the end of a road: `RoadNetwork.after`."""
    if t.ends[road, 0] == 1:
        return road, forward
    here = t.ends[road, 2] if forward else t.ends[road, 1]
    first, last = t.exit_first[here], t.exit_first[here + 1]
    ways = 0
    for k in range(first, last):
        if not (t.exits[k, 0] == road and (t.exits[k, 1] == 1) != forward):
            ways += 1
    if ways == 0:
        return road, not forward
    chosen = int(draw * ways)
    for k in range(first, last):
        if not (t.exits[k, 0] == road and (t.exits[k, 1] == 1) != forward):
            if chosen == 0:
                return t.exits[k, 0], t.exits[k, 1] == 1
            chosen -= 1
    return road, not forward


@inner
def _run_ahead(
    t: Targets, road: int, forward: bool, arc: float, distance: float, streams: Streams, row: int
) -> tuple[int, bool, float]:
    """Move the point ahead along the roads: `RoadMotion._advance`."""
    while True:
        length = t.lines[t.line_first[road + 1] - 1, 2]
        left = length - arc if forward else arc
        if distance < left:
            return road, forward, arc + distance if forward else arc - distance
        distance -= left
        road, forward = way_on(t, road, forward, uniform(streams, row))
        arc = 0.0 if forward else t.lines[t.line_first[road + 1] - 1, 2]


@inner
def step_road(
    t: Targets, m: int, now: Array, inner: Array, e: int, dt: float, streams: Streams, row: int
) -> None:
    """`RoadMotion.step`."""
    x, y, theta = now[e, m, 0], now[e, m, 1], inner[e, m, 0]
    road, forward, arc = int(inner[e, m, 1]), inner[e, m, 2] > 0.0, inner[e, m, 3]
    _wander(inner, e, m, dt, streams, row)
    slow, fast, leash = t.shape[m, 0], t.shape[m, 1], t.shape[m, 7]
    v = 0.5 * (slow + fast) + 0.5 * (fast - slow) * math.tanh(math.sqrt(2.0) * inner[e, m, 5])
    offset = t.shape[m, 8] * math.sqrt(2.0) * inner[e, m, 7]
    for _ in range(LEASH_STEPS):
        goal_x, goal_y = on_road(t, road, forward, arc, offset)
        slack = leash - math.sqrt((goal_x - x) ** 2 + (goal_y - y) ** 2)
        if slack <= 1e-9:
            break
        road, forward, arc = _run_ahead(t, road, forward, arc, slack, streams, row)
    goal_x, goal_y = on_road(t, road, forward, arc, offset)
    bearing = wrapped(math.atan2(goal_y - y, goal_x - x) - theta)
    sharp = math.copysign(t.shape[m, 6], bearing)  # behind: turn as sharply as allowed
    w = sharp if abs(bearing) > 0.5 * math.pi else 2.0 * v * math.sin(bearing) / leash
    theta_mid = theta + 0.5 * dt * w
    theta += dt * w
    set_planar(
        now, e, m, x + dt * v * math.cos(theta_mid), y + dt * v * math.sin(theta_mid), 0.0, theta, v, w
    )
    inner[e, m, 0], inner[e, m, 1], inner[e, m, 2], inner[e, m, 3] = theta, road, 1.0 if forward else 0.0, arc
