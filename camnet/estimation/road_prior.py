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

A place beyond the width of the widest road is on none, so that each cell of a grid over the roads lists the few
segments that can matter there.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from camnet.compiled import cached_njit
from camnet.errors import ConfigError
from camnet.geometry.roads import Polyline
from camnet.geometry.settings import Road
from camnet.types import Array, IntArray

__all__ = ["NO_ROADS", "RoadMap", "map_of", "offset_of", "steer", "turning_rate"]

#: cells of the grid over the roads, at most
_MOST_CELLS = 250_000
#: borrows what it is given: nothing is made here, so that no references need to be counted
_OPTIONS: dict[str, Any] = {"nogil": True, "error_model": "numpy", "_nrt": False}
_borrowing = cached_njit(**_OPTIONS)


class RoadMap(NamedTuple):
    """R roads of S segments in all, and a grid of ``nx`` x ``ny`` cells over them.

    Attributes
    ----------
    segments : (S, 7) start x, y; unit direction x, y; length; arc length of the start, m; road
    roads : (R, 4) first segment, one after the last, whether closed (1 or 0), width in m
    cells : (nx ny + 1 + ..,) where in this array the list of each cell's segments begins; then those lists
    corner : x, y of the grid, m
    per_m : cells per metre
    nx, ny : number of cells; 0 without roads
    widest : width of the widest road, m
    """

    segments: Array
    roads: Array
    cells: IntArray
    corner: tuple[float, float]
    per_m: float
    nx: int
    ny: int
    widest: float

    @classmethod
    def of(cls, roads: Sequence[Road]) -> RoadMap:
        """Arrays of a world's roads.

        Raises
        ------
        ConfigError
            If there are none.
        """
        if not roads:
            raise ConfigError("a map of roads: the world has no roads")
        lines = [Polyline.from_settings(road) for road in roads]
        steps = [np.diff(line.points, axis=0) for line in lines]
        lengths = [np.hypot(*step.T) for step in steps]
        segments = np.concatenate(
            [
                np.column_stack(
                    (line.points[:-1], step / length[:, None], length, line.arc[:-1], np.full(len(step), r))
                )
                for r, (line, step, length) in enumerate(zip(lines, steps, lengths, strict=True))
            ]
        )
        ends = np.cumsum([0, *(len(step) for step in steps)])
        widths = np.array([road.width_m for road in roads])
        about = np.column_stack((ends[:-1], ends[1:], [road.closed for road in roads], widths)).astype(float)
        return cls(segments, about, *_grid(segments, float(widths.max())))


def _grid(segments: Array, widest: float) -> tuple[IntArray, tuple[float, float], float, int, int, float]:
    """Cells, corner, cells per metre, numbers of cells and ``widest``."""
    ends = segments[:, 0:2] + segments[:, 4:5] * segments[:, 2:4]
    low = np.minimum(segments[:, 0:2], ends).min(axis=0) - widest
    high = np.maximum(segments[:, 0:2], ends).max(axis=0) + widest
    cell = max(widest, math.sqrt(float(np.prod(high - low)) / _MOST_CELLS))
    nx, ny = (np.floor((high - low) / cell).astype(int) + 1).tolist()
    lists: list[list[int]] = [[] for _ in range(nx * ny)]
    for i, segment in enumerate(segments):
        both = np.stack((segment[0:2], ends[i]))
        a = np.maximum(np.floor((both.min(axis=0) - widest - low) / cell).astype(int), 0)
        b = np.minimum(np.floor((both.max(axis=0) + widest - low) / cell).astype(int), (nx - 1, ny - 1))
        columns, rows = np.meshgrid(np.arange(a[0], b[0] + 1), np.arange(a[1], b[1] + 1), indexing="ij")
        d = np.stack((columns, rows), axis=-1) * cell + low + 0.5 * cell - segment[0:2]
        t = np.clip(d @ segment[2:4], 0.0, segment[4])
        near = np.hypot(*np.moveaxis(d - t[..., None] * segment[2:4], -1, 0)) <= widest + 0.708 * cell
        for place in (columns[near] * ny + rows[near]).tolist():
            lists[place].append(i)
    first = np.cumsum([nx * ny + 1, *(len(one) for one in lists)])
    cells = np.concatenate((first, [i for one in lists for i in one])).astype(np.int64)
    return cells, (float(low[0]), float(low[1])), 1.0 / cell, nx, ny, widest


#: a map on which every place is off the roads
NO_ROADS = RoadMap(
    np.zeros((0, 7)), np.zeros((0, 4)), np.zeros(0, dtype=np.int64), (0.0, 0.0), 1.0, 0, 0, 0.0
)


@lru_cache(maxsize=8)
def _cached(roads: tuple[Road, ...]) -> RoadMap:
    return RoadMap.of(roads)


def map_of(prior: str, roads: Sequence[Road]) -> RoadMap:
    """Return the map that ``prior`` of `GapSettings` goes by: that of the roads for ``road``, else an empty one."""
    return _cached(tuple(roads)) if prior == "road" and roads else NO_ROADS


@_borrowing
def _nearest(x: float, y: float, m: RoadMap) -> tuple[int, float, float, float]:
    """Segment nearest to (x, y), arc length there, square of the distance, and a number whose sign is that of its side.

    The segment is -1 beyond the width of the widest road; on the left the last number is positive.
    """
    i, j = math.floor((x - m.corner[0]) * m.per_m), math.floor((y - m.corner[1]) * m.per_m)
    segment, s, across = -1, 0.0, 0.0
    if not (0 <= i < m.nx and 0 <= j < m.ny):
        return segment, s, 0.0, across
    best, cell = m.widest * m.widest, i * m.ny + j
    for k in range(m.cells[cell], m.cells[cell + 1]):
        one = m.cells[k]
        dx, dy = x - m.segments[one, 0], y - m.segments[one, 1]
        ux, uy = m.segments[one, 2], m.segments[one, 3]
        t = min(m.segments[one, 4], max(0.0, dx * ux + dy * uy))
        rx, ry = dx - t * ux, dy - t * uy
        d2 = rx * rx + ry * ry
        if d2 < best:
            best, segment, s, across = d2, one, m.segments[one, 5] + t, ux * dy - uy * dx
    return segment, s, best, across


@_borrowing
def _goal(segment: int, s: float, lateral: float, m: RoadMap) -> tuple[float, float]:
    """Point at arc length ``s`` of the road of ``segment``, moved aside; straight on beyond the ends of an open one."""
    road = int(m.segments[segment, 6])
    first, last = int(m.roads[road, 0]), int(m.roads[road, 1]) - 1
    length = m.segments[last, 5] + m.segments[last, 4]
    i = segment
    if m.roads[road, 2] > 0.0 and not 0.0 <= s < length:
        i = first if s > 0.0 else last
        s -= length * math.floor(s / length)
    while i < last and m.segments[i + 1, 5] < s:
        i += 1
    while i > first and m.segments[i, 5] >= s:
        i -= 1
    ux, uy, t = m.segments[i, 2], m.segments[i, 3], s - m.segments[i, 5]
    return m.segments[i, 0] + t * ux - lateral * uy, m.segments[i, 1] + t * uy + lateral * ux


@_borrowing
def _way(segment: int, vx: float, vy: float, m: RoadMap) -> float:
    """1 where the velocity goes along the road's arc length, else -1."""
    return 1.0 if m.segments[segment, 2] * vx + m.segments[segment, 3] * vy >= 0.0 else -1.0


@_borrowing
def offset_of(x: float, y: float, vx: float, vy: float, m: RoadMap) -> float:
    """How far left of its way on the nearest road (x, y) lies, m; at most half the road's width, 0 off the roads."""
    segment, _, square, across = _nearest(x, y, m)
    if segment < 0:
        return 0.0
    lateral = math.copysign(math.sqrt(square), across)
    width = m.roads[int(m.segments[segment, 6]), 3]
    if abs(lateral) > width:
        return 0.0
    half = 0.5 * width
    offset: float = _way(segment, vx, vy, m) * min(half, max(-half, lateral))
    return offset


@_borrowing
def turning_rate(x: float, y: float, vx: float, vy: float, offset: float, m: RoadMap) -> tuple[bool, float]:
    """Whether (x, y) is on a road, and the rate, rad/s, at which the velocity has to turn to follow it."""
    segment, s, away, _ = _nearest(x, y, m)
    square = vx * vx + vy * vy
    if segment < 0 or square < 1e-12:
        return False, 0.0
    ahead = m.roads[int(m.segments[segment, 6]), 3]
    if away > ahead * ahead:
        return False, 0.0
    way = _way(segment, vx, vy, m)
    gx, gy = _goal(segment, s + way * ahead, way * offset, m)
    dx, dy = gx - x, gy - y
    reach = max(dx * dx + dy * dy, 1e-18)  # L^2, and norm(v) L sin(alpha)
    across = vx * dy - vy * dx
    if vx * dx + vy * dy < 0.0:  # behind: as sharply as pursuit turns
        across = math.copysign(math.sqrt(square * reach), across)
    return True, 2.0 * across / reach


@_borrowing
def steer(x: float, y: float, prior: Array, offset: float, m: RoadMap) -> None:
    """Write the turning rate that follows the nearest road to the ``prior`` mean (6,); nothing where there is none."""
    on_road, rate = turning_rate(x, y, prior[0], prior[1], offset, m)
    if on_road:
        prior[3], prior[4], prior[5] = 0.0, 0.0, rate
