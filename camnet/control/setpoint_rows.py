"""The rules of `camnet.control.setpoints` for all agents of many networks at once: arrays (..., N, 3), agent by agent.

Agents fly in boxes and upright cylinders here; nothing stands in the way of a view.

| symbol | meaning |
| --- | --- |
| E, N | environments, agents |
| r | radius of the ball that is kept in view, m |
| psi | share ``image_fill`` of the camera's smallest half-angle, rad |
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from camnet.control.setpoints import (
    CLIMB_MPS,
    LEAD_S,
    LEAST_SPEED_MPS,
    PUNCTUAL,
    REPOSE_S,
    half_angle,
    loiter,
)
from camnet.control.settings import ControllerSettings
from camnet.errors import ConfigError
from camnet.geometry.regions import BoxRegion, CylinderRegion, Region
from camnet.geometry.settings import CameraModel
from camnet.types import Array, BoolArray

__all__ = ["SetpointRows"]


class SetpointRows:
    """Setpoints of N agents in E environments.

    Parameters
    ----------
    regions, cameras : of the N agents
    settings : of their controllers

    Raises
    ------
    ConfigError
        A region is neither a box nor a cylinder.
    """

    def __init__(
        self, regions: Sequence[Region], cameras: Sequence[CameraModel], settings: ControllerSettings
    ) -> None:
        for region in regions:
            if not isinstance(region, BoxRegion | CylinderRegion):
                raise ConfigError(
                    f"region {region.name!r} is a {type(region).__name__}: many environments at once fly in boxes and "
                    "cylinders"
                )
        self._settings, margin = settings, settings.region_margin_m
        bounds = np.stack([region.bounds for region in regions])
        self._low, self._high = bounds[:, 0] + margin, bounds[:, 1] - margin
        self._round = np.array([isinstance(region, CylinderRegion) for region in regions])
        self._middle = np.stack([region.center[:2] for region in regions])
        self._radius = np.array([getattr(region, "radius_m", math.inf) for region in regions]) - margin
        self._sin_psi = np.sin([max(settings.image_fill, 1e-3) * half_angle(camera) for camera in cameras])
        self._near = np.array([camera.near_m for camera in cameras])
        self._far = np.array([camera.far_m for camera in cameras])
        waits = [loiter(r, c, settings) for r, c in zip(regions, cameras, strict=True)]
        #: where the agents loiter (N,3), looking straight down
        self.rest_p_world = np.stack([wait.p_world for wait in waits])

    def project(self, p_world: Array) -> Array:
        """Nearest points (..., N, 3) at least the margin inside the agents' regions."""
        inside = np.minimum(np.maximum(p_world, self._low), self._high)
        if self._round.any():
            way = p_world[..., :2] - self._middle
            length = np.sqrt(way[..., 0] ** 2 + way[..., 1] ** 2)
            scale = np.minimum(1.0, self._radius / np.maximum(length, 1e-300))
            on_disc = self._middle + way * scale[..., None]
            inside[..., :2] = np.where(self._round[:, None], on_disc, inside[..., :2])
        return inside

    def height(self, radius_m: Array) -> Array:
        """Heights (..., N) above a target from which balls of ``radius_m`` (..., N) fill the view."""
        s = self._settings
        least = np.maximum(np.maximum(radius_m / self._sin_psi, s.min_height_m), self._near + radius_m)
        return np.minimum(least, np.maximum(self._far - radius_m, s.min_height_m))

    def look(self, p_world: Array, point_world: Array) -> Array:
        """Pan and tilt (..., N, 2) from ``p_world`` to points (..., N, 3), limited."""
        way, limit = point_world - p_world, self._settings.gaze_max_rad
        down = np.maximum(-way[..., 2:], 0.0)
        return np.clip(np.arctan2(way[..., :2], down), -limit, limit)

    def _ball(self, radius_m: Array) -> Array:
        return self._settings.target_extent_m + np.where(np.isfinite(radius_m), radius_m, 0.0)

    def track(
        self, p_world: Array, v_world: Array, radius_m: Array, seen: BoolArray, camera_p: Array
    ) -> tuple[Array, Array]:
        """Hover above targets, gaze on them: positions (..., N, 3) and gaze (..., N, 2)."""
        goal = p_world + LEAD_S * v_world
        goal[..., 2] += self.height(self._ball(radius_m))
        goal = self.project(goal)
        step = CLIMB_MPS / self._settings.reference_position_gain_per_s
        own = camera_p[..., 2]
        slow = own + np.clip(goal[..., 2] - own, -step, step)  # the right height can wait while it is in view
        goal[..., 2] = np.where(seen, slow, goal[..., 2])
        return goal, self.look(camera_p, p_world)

    def intercept(
        self, entry_p: Array, entry_v: Array, radius_m: Array, late_s: Array | float = 0.0
    ) -> tuple[Array, Array]:
        """Wait at predicted entries (..., N, 3), high enough for their balls to be in view."""
        ball = self._ball(radius_m)
        speed = np.sqrt((entry_v**2).sum(axis=-1))
        moves = speed > 1e-9
        ahead_s = np.minimum(np.maximum(late_s, 0.0), ball / np.where(moves, speed, 1.0))
        met = entry_p + entry_v * np.where(moves, ahead_s, 0.0)[..., None]
        goal = met.copy()
        goal[..., 2] += self.height(ball)
        goal = self.project(goal)
        return goal, self.look(goal, met)

    def ease(self, goal_p: Array, camera_p: Array, within_s: Array | float = math.inf) -> Array:
        """Positions (..., N, 3) on the way to ``goal_p``, so near that nobody hastes; see `at_ease`."""
        s, way = self._settings, goal_p - camera_p
        distance = np.sqrt((way**2).sum(axis=-1))
        allowed = np.where(np.isfinite(within_s), PUNCTUAL * np.asarray(within_s), REPOSE_S)
        speed = np.maximum(distance / np.maximum(allowed, 1e-3), LEAST_SPEED_MPS)
        step = speed / s.reference_position_gain_per_s
        there = (step >= distance) | (speed >= 0.5 * s.reference_v_max_mps)
        share = np.where(there, 1.0, step / np.maximum(distance, 1e-300))
        return np.where(there[..., None], goal_p, camera_p + way * share[..., None])
