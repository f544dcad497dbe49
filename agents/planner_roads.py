"""Where targets that nobody sees may be on the roads: weighted particles, thinned out where a camera looks in vain.

A particle is a place on a road, a direction and a speed; at a junction it takes any road but the one that it came
from, all alike. One that a camera would see, and does not, loses most of its weight. A target that nobody has met
may be on any road.

| ``particles`` (M, P, 5) | meaning |
| --- | --- |
| 0, 1 | heading (2 road + 1 along it, 2 road against it), arc length, m |
| 2, 3 | speed, m/s; weight (those of a target sum to 1) |
| 4 | time for which it has been in a region, s; -1 outside all |
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from camnet.compiled import cached_njit
from camnet.geometry.road_graph import RoadGraph
from camnet.geometry.settings import Road
from camnet.types import Array, IntArray

__all__ = ["RoadMap", "advance", "nearest_heading", "place", "road_map", "scatter", "thin_out", "uniform"]

Seeds = NDArray[np.uint64]
#: of the seed of xorshift64*
_ODD = np.uint64(2685821657736338717)


class RoadMap(NamedTuple):
    """Roads as arrays; ``points`` is empty where a world has none.

    Attributes
    ----------
    points : (S, 3) x, y and arc length, m
    first : (R + 1,) where each road's points begin
    follows, follow_first : headings that may follow each heading (2 R + 1)
    """

    points: Array
    first: IntArray
    follows: IntArray
    follow_first: IntArray


def road_map(roads: Sequence[Road]) -> RoadMap:
    """Return the roads of a world as arrays."""
    if not roads:
        none = np.zeros(0, dtype=np.int64)
        return RoadMap(np.zeros((0, 3)), np.zeros(1, dtype=np.int64), none, np.zeros(1, dtype=np.int64))
    graph = RoadGraph.from_settings(roads)
    points, first, follows, follow_first = [], [0], [], [0]
    for k, line in enumerate(graph.edges):
        arcs = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line.points[:, :2], axis=0).T))])
        points.append(np.column_stack([line.points[:, :2], arcs]))
        first.append(first[-1] + len(arcs))
        for forward in (False, True):
            ways = [h for h in graph.leaving(graph.end_node((k, forward))) if h != (k, not forward)]
            if roads[k].closed:
                ways = [(k, forward)]
            follows += [2 * road + int(along) for road, along in ways or [(k, not forward)]]
            follow_first.append(len(follows))
    return RoadMap(
        np.concatenate(points),
        np.array(first, dtype=np.int64),
        np.array(follows, dtype=np.int64),
        np.array(follow_first, dtype=np.int64),
    )


@cached_njit
def uniform(seeds: Seeds, e: int) -> float:
    """Draw a number in [0, 1) from the generator of environment ``e`` (xorshift64*, Vigna 2016)."""
    x = seeds[e]
    x ^= x >> np.uint64(12)
    x ^= x << np.uint64(25)
    x ^= x >> np.uint64(27)
    seeds[e] = x
    return float((x * _ODD) >> np.uint64(11)) / 9007199254740992.0


@cached_njit
def place(roads: RoadMap, heading: int, arc: float) -> tuple[float, float]:
    """Return the place at an arc length on the road of a heading, m."""
    low, high = roads.first[heading // 2], roads.first[heading // 2 + 1] - 1
    while high - low > 1:
        middle = (low + high) // 2
        if roads.points[middle, 2] <= arc:
            low = middle
        else:
            high = middle
    length = max(roads.points[high, 2] - roads.points[low, 2], 1e-9)
    f = (arc - roads.points[low, 2]) / length
    x = roads.points[low, 0] + f * (roads.points[high, 0] - roads.points[low, 0])
    return x, roads.points[low, 1] + f * (roads.points[high, 1] - roads.points[low, 1])


@cached_njit
def advance(
    roads: RoadMap, heading: int, arc: float, distance: float, seeds: Seeds, e: int
) -> tuple[int, float]:
    """Go on along the roads, at junctions by lot."""
    for _ in range(64):
        length = roads.points[roads.first[heading // 2 + 1] - 1, 2]
        left = length - arc if heading % 2 == 1 else arc
        if distance < left:
            break
        distance -= left
        first, last = roads.follow_first[heading], roads.follow_first[heading + 1]
        heading = roads.follows[first + int(uniform(seeds, e) * (last - first))]
        arc = 0.0 if heading % 2 == 1 else roads.points[roads.first[heading // 2 + 1] - 1, 2]
    return heading, arc + distance if heading % 2 == 1 else arc - distance


@cached_njit
def nearest_heading(roads: RoadMap, x: float, y: float, vx: float, vy: float) -> tuple[int, float]:
    """Return the heading and arc length of a vehicle at (x, y), m, that goes at (vx, vy): near, and the same way."""
    best, heading, arc = math.inf, 0, 0.0
    speed = max(math.sqrt(vx * vx + vy * vy), 1e-9)
    for road in range(len(roads.first) - 1):
        for k in range(roads.first[road], roads.first[road + 1] - 1):
            dx, dy = roads.points[k + 1, 0] - roads.points[k, 0], roads.points[k + 1, 1] - roads.points[k, 1]
            length = max(math.sqrt(dx * dx + dy * dy), 1e-9)
            s = ((x - roads.points[k, 0]) * dx + (y - roads.points[k, 1]) * dy) / length
            s = min(max(s, 0.0), length)
            away = (roads.points[k, 0] + s * dx / length - x) ** 2 + (
                roads.points[k, 1] + s * dy / length - y
            ) ** 2
            along = (vx * dx + vy * dy) / (speed * length)
            cost = away + 1.0 - abs(along)
            if cost < best:
                best, heading = cost, 2 * road + (1 if along >= 0.0 else 0)
                arc = roads.points[k, 2] + s
    return heading, arc


@cached_njit
def scatter(roads: RoadMap, fastest: float, particles: Array, seeds: Seeds, e: int) -> None:
    """Put the particles (P, 5) of one target anywhere on the roads, at 0.4 to 1 of its top speed."""
    total = 0.0
    for road in range(len(roads.first) - 1):
        total += roads.points[roads.first[road + 1] - 1, 2]
    count = particles.shape[0]
    for p in range(count):
        left, road = total * (p + uniform(seeds, e)) / count, 0
        while road < len(roads.first) - 2 and left > roads.points[roads.first[road + 1] - 1, 2]:
            left -= roads.points[roads.first[road + 1] - 1, 2]
            road += 1
        particles[p, 0] = 2 * road + (1 if uniform(seeds, e) < 0.5 else 0)
        particles[p, 1] = min(left, roads.points[roads.first[road + 1] - 1, 2])
        particles[p, 2] = fastest * (0.4 + 0.6 * uniform(seeds, e))
        particles[p, 3], particles[p, 4] = 1.0 / count, 10.0


@cached_njit
def thin_out(roads: RoadMap, fastest: float, particles: Array, seeds: Seeds, e: int) -> None:
    """Bring the weights (P,) to sum 1, and draw anew where few particles carry them (systematic resampling)."""
    count, total, square = particles.shape[0], 0.0, 0.0
    for p in range(count):
        total += particles[p, 3]
    if total < 0.02:
        scatter(roads, fastest, particles, seeds, e)
        return
    for p in range(count):
        particles[p, 3] /= total
        square += particles[p, 3] ** 2
    if square * count < 2.0:
        return
    old, at, reached = particles.copy(), 0, particles[0, 3]
    start = uniform(seeds, e)
    for p in range(count):
        while reached < (p + start) / count and at < count - 1:
            at += 1
            reached += old[at, 3]
        particles[p] = old[at]
        particles[p, 2] = min(old[at, 2] * (0.9 + 0.2 * uniform(seeds, e)), fastest)
        particles[p, 3] = 1.0 / count
