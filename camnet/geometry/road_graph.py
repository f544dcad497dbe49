"""Road networks: lines that meet at their ends, shortest ways, and where a vehicle can have got to.

A *heading* is a pair ``(edge, forward)``: an edge and the direction in which it is travelled. Vehicles do not turn
round on the way; at the end of a dead-end road they may.
"""

from __future__ import annotations

import heapq
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components, dijkstra
from scipy.spatial import cKDTree

from camnet.errors import WorldError
from camnet.geometry.roads import Polyline
from camnet.geometry.settings import Road
from camnet.types import Array, IntArray

__all__ = ["Heading", "RoadGraph", "Stretch"]

Heading = tuple[int, bool]


@dataclass(frozen=True, slots=True)
class Stretch:
    """Part of an edge: arc lengths ``s_lo`` to ``s_hi`` in m. A route's stretch runs backwards where s_hi < s_lo."""

    edge: int
    s_lo: float
    s_hi: float

    @property
    def length(self) -> float:
        """Length in m."""
        return abs(self.s_hi - self.s_lo)


class RoadGraph:
    """Roads joined where their ends meet.

    Parameters
    ----------
    edges : the roads' lines; a closed one is joined to others, if at all, at its first point
    tolerance_m : ends closer than this are one node
    one_way : which edges may only be travelled from their first point to their last; one value or one for each

    Attributes
    ----------
    nodes : (K, 2) mean of the ends that meet, m
    ends : (E, 2) first and last node of each edge
    """

    def __init__(
        self, edges: Sequence[Polyline], tolerance_m: float = 1e-3, one_way: bool | Sequence[bool] = False
    ) -> None:
        if not edges:
            raise WorldError("road graph: no roads; give at least one")
        self.edges = tuple(edges)
        self.one_way = (one_way,) * len(edges) if isinstance(one_way, bool) else tuple(one_way)
        if len(self.one_way) != len(edges):
            raise WorldError(f"road graph: {len(self.one_way)} values of one_way for {len(edges)} roads")
        tips = np.array([p for e in edges for p in (e.points[0], e.points[-1])])
        pairs = cKDTree(tips).query_pairs(tolerance_m, output_type="ndarray")
        links = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(tips), len(tips)))
        count, label = connected_components(links, directed=False)
        self.ends: IntArray = label.astype(np.int64).reshape(-1, 2)
        self.nodes: Array = np.array([tips[label == k].mean(axis=0) for k in range(count)])
        self.lengths: Array = np.array([e.length for e in edges])
        self._leaving: list[list[Heading]] = [[] for _ in range(count)]
        for e, (a, b) in enumerate(self.ends.tolist()):
            self._leaving[a].append((e, True))
            if not self.one_way[e]:
                self._leaving[b].append((e, False))
        self._links = self._shortest_links()
        pairs_of_nodes = np.array(list(self._links), dtype=np.int64).reshape(-1, 2)
        weights = np.array([self.lengths[e] for e, _ in self._links.values()])
        self._graph = coo_array((weights, tuple(pairs_of_nodes.T)), shape=(count, count)).tocsr()

    @classmethod
    def from_settings(cls, roads: Sequence[Road], tolerance_m: float = 1e-3) -> RoadGraph:
        """Graph of a world's roads."""
        return cls([Polyline.from_settings(road) for road in roads], tolerance_m)

    def end_node(self, heading: Heading) -> int:
        """Node that a heading leads to."""
        edge, forward = heading
        return int(self.ends[edge, 1 if forward else 0])

    def leaving(self, node: int) -> list[Heading]:
        """All headings that start at a node."""
        return list(self._leaving[node])

    def successors(self, heading: Heading) -> list[Heading]:
        """Headings that can follow one: every way on, or back where there is no other."""
        edge, forward = heading
        ways = self._leaving[self.end_node(heading)]
        onward = [way for way in ways if way != (edge, not forward)]
        return onward or list(ways)

    def locate(self, point: ArrayLike) -> tuple[int, float, float]:
        """Edge, arc length and lateral offset of the nearest place on any road to a point (2,)."""
        p = np.asarray(point, dtype=np.float64)
        best = (0, 0.0, np.inf)
        for e, line in enumerate(self.edges):
            s, lateral = line.project(p)
            if abs(float(lateral)) < abs(best[2]):
                best = (e, float(s), float(lateral))
        return best

    def shortest_path(self, start: tuple[int, float], goal: tuple[int, float]) -> tuple[float, list[Stretch]]:
        """Shortest way between two places, each an edge and an arc length; the first step may go either way.

        Returns
        -------
        length, stretches
            Length in m (inf with no stretches when there is no way) and the parts of edges in order of travel.
        """
        (e0, s0), (e1, s1) = start, goal
        best, route = np.inf, list[Stretch]()
        if e0 == e1 and (s1 >= s0 or not self.one_way[e0]):
            best, route = abs(s1 - s0), [Stretch(e0, s0, s1)]
        for out in self._directions(e0):
            source = self.end_node((e0, out))
            distance, previous = dijkstra(self._graph, indices=[source], return_predecessors=True)
            leave = Stretch(e0, s0, float(self.lengths[e0]) if out else 0.0)
            for into in self._directions(e1):
                goal_node = self.end_node((e1, not into))
                enter = Stretch(e1, 0.0 if into else float(self.lengths[e1]), s1)
                total = leave.length + float(distance[0, goal_node]) + enter.length
                if total < best:
                    best, route = total, [leave, *self._trace(previous[0], source, goal_node), enter]
        return float(best), [part for part in route if part.length > 0.0]

    def _directions(self, edge: int) -> tuple[bool, ...]:
        return (True,) if self.one_way[edge] else (True, False)

    def _shortest_links(self) -> dict[tuple[int, int], Heading]:
        """For every pair of joined nodes the shortest heading from one to the other."""
        out: dict[tuple[int, int], Heading] = {}
        for node, ways in enumerate(self._leaving):
            for way in ways:
                key = (node, self.end_node(way))
                if key[0] != key[1] and (key not in out or self.lengths[way[0]] < self.lengths[out[key][0]]):
                    out[key] = way
        return out

    def _trace(self, previous: NDArray[np.int32], source: int, node: int) -> list[Stretch]:
        out: list[Stretch] = []
        while node != source:
            before = int(previous[node])
            edge, forward = self._links[before, node]
            length = float(self.lengths[edge])
            out.append(Stretch(edge, 0.0, length) if forward else Stretch(edge, length, 0.0))
            node = before
        return out[::-1]

    def reachable(
        self,
        edge: int,
        s: float,
        d_lo: float,
        d_hi: float,
        forward: bool | None = None,
        resolution_m: float = 0.01,
    ) -> list[Stretch]:
        """Every place that some way of length between ``d_lo`` and ``d_hi`` from a place on an edge leads to.

        Parameters
        ----------
        edge, s : where the vehicle is
        d_lo, d_hi : shortest and longest distance travelled, m
        forward : direction of travel at the start; both if None
        resolution_m : ways that reach a road within this distance of each other are treated as a continuum. The
            result is then a little larger than exact, never smaller, and the work is bounded.

        Returns
        -------
        list of Stretch
            Disjoint, sorted by edge and arc length, each with s_lo <= s_hi.
        """
        if not 0.0 <= d_lo <= d_hi:
            raise ValueError(f"d_lo = {d_lo}, d_hi = {d_hi}: 0 <= d_lo <= d_hi is expected")
        found: list[Stretch] = []
        # entry distance of a heading: the distance travelled where it begins (negative on the first edge)
        queue: list[tuple[float, float, Heading]] = []
        for out in self._directions(edge):
            if forward is None or forward == out:
                entry = -s if out else s - float(self.lengths[edge])
                queue.append((entry, entry, (edge, out)))
        heapq.heapify(queue)
        entered: dict[Heading, list[tuple[float, float]]] = {}
        while queue:
            lo, hi, heading = heapq.heappop(queue)
            if lo > d_hi:
                break
            merged = _merge(entered.setdefault(heading, []), lo, hi, resolution_m) if lo >= 0.0 else (lo, hi)
            if merged is None:
                continue
            found += self._covered(heading, *merged, d_lo, d_hi)
            length = float(self.lengths[heading[0]])
            for way in self.successors(heading):
                heapq.heappush(queue, (merged[0] + length, merged[1] + length, way))
        return _union(found)

    def _covered(self, heading: Heading, lo: float, hi: float, d_lo: float, d_hi: float) -> list[Stretch]:
        edge, forward = heading
        length = float(self.lengths[edge])
        first, last = max(0.0, -lo, d_lo - hi), min(length, d_hi - lo)
        if first > last:
            return []
        return [Stretch(edge, first, last) if forward else Stretch(edge, length - last, length - first)]


def _merge(known: list[tuple[float, float]], lo: float, hi: float, gap: float) -> tuple[float, float] | None:
    """Add an interval to sorted ones that come in order of ``lo``; what is new of it, or None.

    An interval within ``gap`` of the last one is joined to it, over at least ``gap``, so that only a bounded number of
    intervals is ever new.
    """
    if known:
        last_lo, last_hi = known[-1]
        if last_lo <= lo and hi <= last_hi:
            return None
        if lo <= last_hi + gap:
            hi = max(hi, last_hi + gap)
            known[-1] = (min(last_lo, lo), hi)
            return min(lo, last_hi), hi
    known.append((lo, hi))
    return lo, hi


def _union(stretches: list[Stretch]) -> list[Stretch]:
    out: list[Stretch] = []
    for part in sorted(stretches, key=lambda p: (p.edge, p.s_lo)):
        if out and out[-1].edge == part.edge and part.s_lo <= out[-1].s_hi + 1e-9:
            out[-1] = Stretch(part.edge, out[-1].s_lo, max(out[-1].s_hi, part.s_hi))
        else:
            out.append(part)
    return out
