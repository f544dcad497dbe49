"""Which robot the quadrotor follows, and where it looks when the robot is not where the model puts it.

The published policy (parikh2018, VII-B): after the first 300 s follow whichever target is nearest an intersection,
stay with it until it has chosen its way and left, then go to the other. The paper does not say what happens when a
target turned unobserved and is not where it was predicted; something must, and here it is the roads: a target last seen
at one place, at its last speed, can be at one place of each way on since then. Places that are looked at and found
empty are struck out, and the quadrotor flies to the likeliest that is left.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from camnet.geometry.frustum import Frustum
from camnet.geometry.road_graph import Heading, RoadGraph
from camnet.geometry.settings import Road
from camnet.motion.road_network import CenterLine, RoadNetwork
from camnet.types import Array, TargetEstimate

__all__ = ["NearestIntersection", "RoadBelief"]

#: a robot closer to a junction than this is not left, m
JUNCTION_M = 0.8
#: an estimate farther than this from every place that the roads leave is wrong, m
ASTRAY_M = 1.0
#: how far inside the view a place must be for its emptiness to count, m
INSIDE_M = 0.3
#: spacing of the places where a robot of which nothing is known may be, m
ANYWHERE_M = 1.0


@dataclass(slots=True)
class _Place:
    """One place where a robot may be: road and direction, arc length, probability."""

    heading: Heading
    s: float
    weight: float


class RoadBelief:
    """Places on the roads where one unseen robot may be.

    Parameters
    ----------
    graph : the roads
    lines : the same roads, for single look-ups
    speed_mps : of a robot of which nothing is known
    """

    def __init__(self, graph: RoadGraph, lines: Sequence[CenterLine], speed_mps: float) -> None:
        self._graph, self._lines, self._speed = graph, lines, speed_mps
        self.places: list[_Place] = []
        self._anywhere()

    def seen(self, p_world: Array, v_world: Array) -> None:
        """Collapse to where the robot is; which way it goes is read from its velocity."""
        vx, vy = float(v_world[0]), float(v_world[1])
        speed = math.hypot(vx, vy)
        best, heading, s_best = np.inf, (0, True), 0.0
        for e, edge in enumerate(self._graph.edges):
            s, lateral = (float(value) for value in edge.project(p_world[:2]))
            _, _, direction = self._lines[e].at(s)
            along = (vx * math.cos(direction) + vy * math.sin(direction)) / max(speed, 1e-9)
            cost = abs(lateral) + 0.5 * (1.0 - abs(along))
            if cost < best:
                best, heading, s_best = cost, (e, along >= 0.0), s
        self._speed = speed if speed > 0.05 else self._speed
        self.places = [_Place(heading, s_best, 1.0)]

    def advance(self, dt_s: float) -> None:
        """Move every place on; at a junction it goes every way on."""
        moved: list[_Place] = []
        queue = [(place, self._speed * dt_s) for place in self.places]
        while queue:
            place, left = queue.pop()
            edge, forward = place.heading
            ahead = self._lines[edge].length_m - place.s if forward else place.s
            if left <= ahead:
                moved.append(_Place(place.heading, place.s + (left if forward else -left), place.weight))
                continue
            ways = self._graph.successors(place.heading)
            for way in ways:
                start = 0.0 if way[1] else self._lines[way[0]].length_m
                queue.append((_Place(way, start, place.weight / len(ways)), left - ahead))
        self.places = moved

    def exclude(self, view: Frustum) -> None:
        """Strike out the places in view; when none is left, the robot may be anywhere."""
        hidden = view.signed_distance(self.points()) > -INSIDE_M
        self.places = [place for place, keep in zip(self.places, hidden.tolist(), strict=True) if keep]
        if not self.places:
            self._anywhere()

    def points(self) -> Array:
        """Return the places (n, 3) on the ground, m."""
        at = [self._lines[place.heading[0]].at(place.s) for place in self.places]
        return np.array([(x, y, 0.0) for x, y, _ in at])

    def likeliest(self, near: Array) -> Array:
        """Likeliest place (3,); of equal ones that nearest to ``near`` (3,)."""
        points = self.points()
        weights = np.array([place.weight for place in self.places])
        distance = np.linalg.norm(points[:, :2] - near[:2], axis=1)
        return np.asarray(points[np.lexsort((distance, -np.round(weights, 9)))[0]])

    def _anywhere(self) -> None:
        self.places = [
            _Place((e, forward), float(s), 1.0)
            for e, line in enumerate(self._lines)
            for s in np.arange(0.5 * ANYWHERE_M, line.length_m, ANYWHERE_M)
            for forward in (True, False)
        ]


class NearestIntersection:
    """Follows the first robot, then whichever is nearest an intersection.

    Parameters
    ----------
    roads : the roads
    follow_one_s : until when the first robot is followed
    speed_mps : typical speed
    count : number of robots
    """

    def __init__(self, roads: Sequence[Road], follow_one_s: float, speed_mps: float, count: int) -> None:
        graph, lines = RoadGraph.from_settings(roads), RoadNetwork.of(roads).lines
        junctions = [k for k in range(len(graph.nodes)) if len(graph.leaving(k)) > 2]
        self._junctions = graph.nodes[junctions]
        self._follow_one_s = follow_one_s
        self.beliefs = [RoadBelief(graph, lines, speed_mps) for _ in range(count)]
        self._lost = [False] * count
        self.followed = 0

    def lost(self, m: int) -> bool:
        """Whether robot ``m`` is known not to be where it was predicted (or was never seen)."""
        return self._lost[m]

    def decide(
        self, t_s: float, dt_s: float, estimates: Sequence[TargetEstimate], view: Frustum, camera_p: Array
    ) -> Array:
        """Return the place on the ground (3,) above which to fly.

        Parameters
        ----------
        t_s, dt_s : time, and time since the last decision, s
        estimates : of the robots
        view : what the camera sees now, in the world
        camera_p : (3,) where it is
        """
        places = [self._place(m, estimate, dt_s, view, camera_p) for m, estimate in enumerate(estimates)]
        if t_s < self._follow_one_s:
            return places[0]
        self.followed = self._choose(places, estimates)
        return places[self.followed]

    def _place(self, m: int, estimate: TargetEstimate, dt_s: float, view: Frustum, camera_p: Array) -> Array:
        belief = self.beliefs[m]
        if estimate.seen:
            self._lost[m] = False
            belief.seen(estimate.p_world, estimate.v_world)
            return estimate.p_world
        belief.advance(dt_s)
        belief.exclude(view)
        away = np.linalg.norm(belief.points()[:, :2] - estimate.p_world[:2], axis=1)
        self._lost[m] = estimate.region < 0 or bool(away.min() > ASTRAY_M)
        return belief.likeliest(camera_p) if self._lost[m] else estimate.p_world

    def _choose(self, places: Sequence[Array], estimates: Sequence[TargetEstimate]) -> int:
        distance = np.array([np.linalg.norm(self._junctions - place[:2], axis=1).min() for place in places])
        now = self.followed
        if estimates[now].seen and distance[now] < JUNCTION_M:
            return now
        if self.lost(now) and distance.min() >= JUNCTION_M:
            return now
        for m in range(len(places)):  # a robot that is lost is looked for while nobody is at a junction
            if self.lost(m) and np.delete(distance, m).min() >= 2.0 * JUNCTION_M:
                return m
        known = np.array([not self.lost(m) for m in range(len(places))])
        return int(np.argmin(np.where(known, distance, np.inf))) if known.any() else now
