"""Where an agent among obstacles can wait and still see: setpoints moved to free space with sight of what they are for.

`camnet.control.setpoints` asks for the place right above a target or an entry. That place may lie in an obstacle, or an
obstacle may stand between it and what is to be seen. Here the nearest place is taken that keeps the margins and from
which the sight line is clear. An agent with nothing to do waits where it sees the most of the roads in its region.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from camnet.compiled import cached_njit
from camnet.control.planner.distance_kernel import segment_clearance, signed_distance
from camnet.control.planner.obstacles import Obstacle, pack
from camnet.control.setpoints import Setpoint, at_ease, half_angle, loiter
from camnet.control.settings import ControllerSettings
from camnet.geometry.regions import Region
from camnet.geometry.rotations import gaze_angles
from camnet.geometry.settings import CameraModel
from camnet.types import Array

__all__ = ["Viewpoints"]

#: what a sight line keeps from obstacles, and a waiting place beyond the margin, m
_SIGHT_M, _RESERVE_M = 0.05, 0.1
_RADII_M = (0.3, 0.6, 0.9, 1.2, 1.6, 2.0, 2.5, 3.0)
_DIRECTIONS, _ROAD_STEP_M, _GRID_M = 16, 0.25, 0.5


def _offsets() -> Array:
    """Places to try about a wanted one, (K,3), nearest first."""
    angle = 2.0 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    ring = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(_DIRECTIONS)])
    return np.concatenate([np.zeros((1, 3)), *(r * ring for r in _RADII_M)])


_OFFSETS = _offsets()


@cached_njit(error_model="numpy")
def _first(places: Array, point: Array, rows: Array, least: float, sight: float) -> int:
    """Return the first of ``places`` (K,3) that is free and sees ``point`` (3,), else the first free one, else -1."""
    normal, free = np.empty(3), -1
    for k in range(places.shape[0]):
        good = True
        for row in rows:
            if signed_distance(row, places[k], 0.0, normal) < least:
                good = False
                break
        if not good:
            continue
        if free < 0:
            free = k
        for row in rows:
            if segment_clearance(row, places[k], point, 0.0) < sight:
                good = False
                break
        if good:
            return k
    return free


class Viewpoints:
    """Setpoints of one agent among ``obstacles`` in its region.

    Parameters
    ----------
    settings, region, camera : of the agent
    obstacles : solids that block flight and sight
    roads : polylines (k,2) or (k,3) where targets go, m; where the agent waits with nothing else to do
    """

    def __init__(
        self,
        settings: ControllerSettings,
        region: Region,
        camera: CameraModel,
        obstacles: Sequence[Obstacle],
        roads: Sequence[Array] = (),
    ) -> None:
        self._settings, self._region, self._camera = settings, region, camera
        self._rows = pack(obstacles)
        self._least = settings.obstacle_margin_m + _RESERVE_M + 0.1  # what a pilot asks of a goal
        self.rest = self._resting_place(roads)

    def seeing(self, wanted: Setpoint, point: Array, camera_p: Array | None = None) -> Setpoint:
        """Nearest setpoint to ``wanted`` that is free and sees ``point`` (3,); ``wanted`` itself where there is none.

        The gaze is right at the setpoint, or at ``camera_p`` (3,) where that is given.
        """
        if self._is_free(wanted.p_world) and self._sees(wanted.p_world, point):
            return wanted
        places = wanted.p_world + _OFFSETS
        inside = self._region.signed_distance(places) <= -self._settings.region_margin_m + 1e-9
        places = np.ascontiguousarray(places[inside])
        k = _first(places, point, self._rows, self._least, _SIGHT_M) if len(places) else -1
        if k < 0:
            return wanted
        return Setpoint(places[k], self._gaze(places[k] if camera_p is None else camera_p, point))

    def _is_free(self, place: Array) -> bool:
        normal = np.empty(3)
        return all(signed_distance(row, place, 0.0, normal) >= self._least for row in self._rows)

    def on_the_way(self, goal: Setpoint, camera_p: Array, within_s: float = math.inf) -> Setpoint:
        """Go to ``goal`` at ease where the straight way is free; else hand out the goal itself, to be planned to."""
        least = self._settings.obstacle_margin_m
        if all(segment_clearance(row, camera_p, goal.p_world, 0.0) >= least for row in self._rows):
            return at_ease(goal, camera_p, self._settings, within_s)
        return goal

    def _sees(self, place: Array, point: Array) -> bool:
        return all(segment_clearance(row, place, point, 0.0) >= _SIGHT_M for row in self._rows)

    def _gaze(self, place: Array, point: Array) -> Array:
        pan, tilt = gaze_angles(point - place)
        limit = self._settings.gaze_max_rad
        return np.asarray(np.clip(np.array([float(pan), float(tilt)]), -limit, limit))

    def _resting_place(self, roads: Sequence[Array]) -> Setpoint:
        """Free place, as high as `setpoints.loiter` goes, that sees most of the roads; else one near the middle."""
        middle = loiter(self._region, self._camera, self._settings)
        samples = _samples(roads, self._region)
        (x0, y0, _), (x1, y1, _) = self._region.bounds
        xs, ys = np.arange(x0, x1 + _GRID_M, _GRID_M), np.arange(y0, y1 + _GRID_M, _GRID_M)
        places = np.array([(x, y, middle.p_world[2]) for x in xs for y in ys])
        places = places[self._region.signed_distance(places) <= -self._settings.region_margin_m]
        away = np.linalg.norm(places - middle.p_world, axis=1)
        best, found = -math.inf, middle
        for place, distance in zip(places, away, strict=True):
            if not self._is_free(place):
                continue
            score = self._road_seen(place, samples) - 0.1 * float(distance)
            if score > best:
                best, found = score, Setpoint(place, np.zeros(2))
        return found

    def _road_seen(self, place: Array, samples: Array) -> float:
        """Length of road, m, in the cone that a camera at ``place`` sees straight below."""
        if not len(samples):
            return 0.0
        reach = (place[2] - samples[:, 2]) * math.tan(half_angle(self._camera))
        under = samples[np.linalg.norm(samples[:, :2] - place[:2], axis=1) <= reach]
        return _ROAD_STEP_M * sum(self._sees(place, point) for point in under)


def _samples(roads: Sequence[Array], region: Region) -> Array:
    """Points (K,3) along roads, a little above the ground, that lie in a region."""
    out = [np.zeros((0, 3))]
    for road in roads:
        p = np.asarray(road, dtype=float)[:, :2]
        s = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(p, axis=0), axis=1))])
        t = np.arange(0.0, s[-1], _ROAD_STEP_M)
        out.append(
            np.column_stack([np.interp(t, s, p[:, 0]), np.interp(t, s, p[:, 1]), np.full(len(t), 0.1)])
        )
    points = np.concatenate(out)
    return np.asarray(points[region.contains(points)]) if len(points) else points
