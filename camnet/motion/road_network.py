"""Roads as a network to drive on: centre lines that meet where they share an end."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from camnet.geometry.settings import Road

__all__ = ["CenterLine", "RoadNetwork"]

#: ends closer than this (m) are one junction
_JOIN_M = 1e-3


@dataclass(frozen=True, slots=True)
class CenterLine:
    """One road: corner points and the arc length at each; lists, because single look-ups dominate.

    ``start`` and ``end`` number the junctions at its ends (the same one if the road is closed).
    """

    x: list[float]
    y: list[float]
    arc: list[float]
    closed: bool
    start: int
    end: int

    @property
    def length_m(self) -> float:
        """Length, m."""
        return self.arc[-1]

    def at(self, arc_m: float) -> tuple[float, float, float]:
        """Return x, y (m) and the direction of growing arc length (rad) at ``arc_m``."""
        k = min(max(bisect_right(self.arc, arc_m) - 1, 0), len(self.arc) - 2)
        f = (arc_m - self.arc[k]) / (self.arc[k + 1] - self.arc[k])
        dx, dy = self.x[k + 1] - self.x[k], self.y[k + 1] - self.y[k]
        return self.x[k] + f * dx, self.y[k] + f * dy, math.atan2(dy, dx)


@dataclass(frozen=True, slots=True)
class RoadNetwork:
    """All roads, and at each junction the roads that leave it as (road, whether along its arc length)."""

    lines: tuple[CenterLine, ...]
    exits: tuple[tuple[tuple[int, bool], ...], ...]

    @classmethod
    def of(cls, roads: Sequence[Road]) -> RoadNetwork:
        """Join roads at the ends that they share."""
        junctions: dict[tuple[int, int], int] = {}
        lines = tuple(_line(road, junctions) for road in roads)
        exits: list[list[tuple[int, bool]]] = [[] for _ in junctions]
        for k, line in enumerate(lines):
            exits[line.start].append((k, True))
            exits[line.end].append((k, False))
        return cls(lines, tuple(tuple(each) for each in exits))

    def after(self, road: int, forward: bool, draw: float) -> tuple[int, bool]:
        """Choose the road taken at the end of ``road``, by ``draw`` in [0, 1); back again where there is no other.

        A closed road goes on around.
        """
        line = self.lines[road]
        if line.closed:
            return road, forward
        here = self.exits[line.end if forward else line.start]
        ways = [way for way in here if way != (road, not forward)]
        return ways[int(draw * len(ways))] if ways else (road, not forward)


def _line(road: Road, junctions: dict[tuple[int, int], int]) -> CenterLine:
    points = np.array([*road.points_m, road.points_m[0]] if road.closed else road.points_m, dtype=np.float64)
    keep = np.concatenate([[True], np.any(np.diff(points, axis=0) != 0, axis=1)])
    points = points[keep]
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    start, end = (
        junctions.setdefault((round(x / _JOIN_M), round(y / _JOIN_M)), len(junctions))
        for x, y in (points[0].tolist(), points[-1].tolist())
    )
    return CenterLine(points[:, 0].tolist(), points[:, 1].tolist(), arc.tolist(), road.closed, start, end)
