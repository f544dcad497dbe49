"""Prior mean along known roads: the target goes on as fast as it left, the way the road goes.

| symbol | name | unit |
| --- | --- | --- |
| p, v | position and prior velocity in the ground plane | m, m/s |
| s | arc length of the place on the nearest road | m |
| d | ``offset``: how far left of its way the target was at its exit | m |
| g | goal: the point a road's width ahead of s in the direction of v, moved aside by d | m |
| L, alpha | length of g - p, angle from v to it | m, rad |
| w = 2 norm(v) sin(alpha) / L | turning rate of the prior: the circular arc to g (pure pursuit, Coulter 1992) | rad/s |

The prior thus keeps its speed in the arc length and its place in the lateral offset, the coordinates of the road.
What a prior by constant turn knows of one bend, this knows of every bend of the map. Beyond the end of a road the goal
lies straight ahead, so that at a junction the road that lies most nearly ahead is taken; which way a target turns there
is not known. Off the roads (beyond their width) nothing is steered and the turn fades as it does without them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit

from camnet.errors import ConfigError
from camnet.estimation.propagate import advance
from camnet.geometry.roads import Polyline
from camnet.geometry.settings import Road
from camnet.types import Array, IntArray

__all__ = ["RoadMap", "offset_of", "roll_out_on_roads", "steer"]


@dataclass(frozen=True, eq=False, slots=True)
class RoadMap:
    """Roads as arrays: R polylines of V vertices in all.

    Attributes
    ----------
    points : (V, 2) vertices, m; the first of a closed road is repeated at its end
    arc : (V,) arc length at the vertices of each road, m
    first : (R + 1,) index of each road's first vertex, and V
    closed, width : (R,) whether a road is closed (1 or 0), and its width, m
    """

    points: Array
    arc: Array
    first: IntArray
    closed: IntArray
    width: Array

    @classmethod
    def of(cls, roads: Sequence[Road]) -> RoadMap:
        """Arrays of a world's roads.

        Raises
        ------
        ConfigError
            If there are none.
        """
        if not roads:
            raise ConfigError("estimator.gap.prior 'road': the world has no roads; use 'constant_turn'")
        lines = [Polyline.from_settings(road) for road in roads]
        return cls(
            np.concatenate([line.points for line in lines]),
            np.concatenate([line.arc for line in lines]),
            np.cumsum([0, *(len(line.points) for line in lines)]).astype(np.int64),
            np.array([int(road.closed) for road in roads]),
            np.array([road.width_m for road in roads]),
        )


@njit(cache=True)
def _nearest(x: float, y: float, points: Array, arc: Array, first: IntArray) -> tuple[int, int, float, float]:
    """Road, segment, arc length and lateral offset of the place nearest to (x, y)."""
    best, road, segment, s, lateral = math.inf, 0, 0, 0.0, 0.0
    for r in range(len(first) - 1):
        for i in range(first[r], first[r + 1] - 1):
            ex, ey = points[i + 1, 0] - points[i, 0], points[i + 1, 1] - points[i, 1]
            length = arc[i + 1] - arc[i]
            dx, dy = x - points[i, 0], y - points[i, 1]
            t = min(1.0, max(0.0, (dx * ex + dy * ey) / (length * length)))
            rx, ry = dx - t * ex, dy - t * ey
            d2 = rx * rx + ry * ry
            if d2 < best:
                best, road, segment, s = d2, r, i, arc[i] + t * length
                lateral = math.copysign(math.sqrt(d2), ex * dy - ey * dx)
    return road, segment, s, lateral


@njit(cache=True)
def _goal(
    road: int, s: float, lateral: float, points: Array, arc: Array, first: IntArray, closed: bool
) -> tuple[float, float]:
    """Point at arc length ``s`` of a road, moved aside by ``lateral``; straight on beyond the ends of an open one."""
    a, b = first[road], first[road + 1] - 1
    if closed:
        s -= arc[b] * math.floor(s / arc[b])
    i = a
    while i < b - 1 and arc[i + 1] < s:
        i += 1
    length = arc[i + 1] - arc[i]
    ux, uy = (points[i + 1, 0] - points[i, 0]) / length, (points[i + 1, 1] - points[i, 1]) / length
    t = s - arc[i]
    return points[i, 0] + t * ux - lateral * uy, points[i, 1] + t * uy + lateral * ux


@njit(cache=True)
def _way(segment: int, prior: Array, points: Array) -> float:
    """1 where the prior velocity goes along the road's arc length, else -1."""
    ex = points[segment + 1, 0] - points[segment, 0]
    ey = points[segment + 1, 1] - points[segment, 1]
    return 1.0 if ex * prior[0] + ey * prior[1] >= 0.0 else -1.0


@njit(cache=True)
def offset_of(
    p: Array, prior: Array, points: Array, arc: Array, first: IntArray, closed: IntArray, width: Array
) -> float:
    """How far left of its way on the nearest road p (3,) lies, m; at most half the road's width either way."""
    road, segment, _, lateral = _nearest(p[0], p[1], points, arc, first)
    half = 0.5 * width[road]
    offset: float = _way(segment, prior, points) * min(half, max(-half, lateral))
    return offset


@njit(cache=True)
def steer(
    p: Array,
    prior: Array,
    offset: float,
    points: Array,
    arc: Array,
    first: IntArray,
    closed: IntArray,
    width: Array,
) -> bool:
    """Write the turning rate that follows the nearest road to ``prior`` (6,); False where there is no road."""
    speed = math.hypot(prior[0], prior[1])
    road, segment, s, lateral = _nearest(p[0], p[1], points, arc, first)
    ahead = width[road]
    if abs(lateral) > ahead or speed < 1e-6:
        return False
    way = _way(segment, prior, points)
    gx, gy = _goal(road, s + way * ahead, way * offset, points, arc, first, closed[road] == 1)
    dx, dy = gx - p[0], gy - p[1]
    reach = max(math.hypot(dx, dy), 1e-9)
    sine = (prior[0] * dy - prior[1] * dx) / (speed * reach)
    if prior[0] * dx + prior[1] * dy < 0.0:  # behind: as sharply as pursuit turns
        sine = math.copysign(1.0, sine)
    prior[3] = 0.0
    prior[4] = 0.0
    prior[5] = 2.0 * speed * sine / reach
    return True


@njit(cache=True)
def roll_out_on_roads(
    p: Array,
    q: Array,
    prior: Array,
    dt: float,
    count: int,
    substeps: int,
    turn_memory: float,
    handover: float,
    stacked: bool,
    weights: Array,
    centres: Array,
    precision: Array,
    heading_scale: float,
    low: Array,
    high: Array,
    offset: float,
    points: Array,
    arc: Array,
    first: IntArray,
    closed: IntArray,
    width: Array,
) -> tuple[Array, Array]:
    """`camnet.estimation.propagate.roll_out` with the prior steered along the roads before every sub-step."""
    ps, qs = np.empty((count, 3)), np.empty((count, 4))
    carried, twist = prior.copy(), np.zeros(6)
    for k in range(count):
        for _ in range(substeps):
            steer(p, carried, offset, points, arc, first, closed, width)
            p, q, _ = advance(
                p,
                q,
                carried,
                dt / substeps,
                1,
                2,
                turn_memory,
                handover,
                stacked,
                weights,
                centres,
                precision,
                heading_scale,
                low,
                high,
                twist,
            )
        for i in range(3):
            ps[k, i] = p[i]
        for i in range(4):
            qs[k, i] = q[i]
    return ps, qs
