"""Where an agent should fly and look: track a target, loiter, or wait where one is predicted to enter.

All setpoints are admissible: inside the region shrunk by the margin. The references of `camnet.control.references`
fly there.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from camnet.control.settings import ControllerSettings
from camnet.geometry.regions import Region
from camnet.geometry.settings import CameraModel
from camnet.types import Array, TargetEstimate

__all__ = [
    "CLIMB_MPS",
    "LEAD_S",
    "LEAST_SPEED_MPS",
    "PUNCTUAL",
    "REPOSE_S",
    "SWAY_M",
    "SWAY_S",
    "Setpoint",
    "at_ease",
    "half_angle",
    "intercept",
    "loiter",
    "sway",
    "track",
    "working_height",
]

#: share of the time until an entry in which the camera gets there; time in which it goes to its waiting place, s
PUNCTUAL, REPOSE_S = 0.5, 15.0
#: never slower than this on the way, m/s: the last steps would take for ever
LEAST_SPEED_MPS = 0.1
#: speed of climbing or sinking to the working height while the target is in view, m/s
CLIMB_MPS = 0.15
_HALF_ANGLES_KEPT = 256
#: circle about a target of unknown size, m, and time for it, s
SWAY_M, SWAY_S = 0.8, 7.0
#: how far ahead of a tracked target the camera is sent, s: about the lag of the references
LEAD_S = 0.5


class Setpoint(NamedTuple):
    """Desired camera position (3,) in the world, m, and gaze (2,): pan and tilt towards world x and y, rad."""

    p_world: Array
    gaze: Array


#: half-angles by the identity of the camera model, which is kept so that the identity stays taken
_HALF_ANGLES: dict[int, tuple[CameraModel, float]] = {}


def half_angle(camera: CameraModel) -> float:
    """Smallest half-angle of the field of view, rad: from the principal point to the nearest image border."""
    known = _HALF_ANGLES.get(id(camera))
    if known is None:
        if len(_HALF_ANGLES) >= _HALF_ANGLES_KEPT:
            _HALF_ANGLES.clear()
        known = _HALF_ANGLES[id(camera)] = (camera, _smallest_half_angle(camera))
    return known[1]


def _smallest_half_angle(camera: CameraModel) -> float:
    k = camera.intrinsics
    slopes = (
        (k.cx_px + 0.5) / k.fx_px,
        (k.width_px - 0.5 - k.cx_px) / k.fx_px,
        (k.cy_px + 0.5) / k.fy_px,
        (k.height_px - 0.5 - k.cy_px) / k.fy_px,
    )
    return math.atan(max(min(slopes), 1e-3))


def working_height(camera: CameraModel, radius_m: float, settings: ControllerSettings) -> float:
    """Height above a target from which a ball of ``radius_m`` about it fills ``image_fill`` of the view.

    A ball of radius r at distance d touches a cone of half-angle psi when ``r = d sin psi`` (bell2019); here psi is
    ``image_fill`` of the smallest half-angle. Never below ``min_height_m``, never beyond the far range less the ball.
    """
    psi = max(settings.image_fill, 1e-3) * half_angle(camera)
    highest = max(camera.far_m - radius_m, settings.min_height_m)
    return min(max(radius_m / math.sin(psi), settings.min_height_m, camera.near_m + radius_m), highest)


def _look_from(p_world: Array, point_world: Array, settings: ControllerSettings) -> Array:
    """Pan and tilt (2,) of `camnet.geometry.rotations.gaze_angles`, limited."""
    (x, y, z), limit = (point_world - p_world).tolist(), settings.gaze_max_rad
    down = max(-z, 0.0)
    pan, tilt = math.atan2(x, down), math.atan2(y, down)
    return np.array([min(max(pan, -limit), limit), min(max(tilt, -limit), limit)])


def _above(point: Array, height: float, region: Region | None, margin_m: float) -> Array:
    wanted = point + np.array([0.0, 0.0, height])
    return wanted if region is None else region.project(wanted, margin_m)


def _view_radius(target_extent_m: float, radius_m: float) -> float:
    """Radius of the ball to keep in view; an unknown error radius counts as none."""
    return target_extent_m + (radius_m if math.isfinite(radius_m) else 0.0)


def track(
    estimate: TargetEstimate,
    region: Region | None,
    camera: CameraModel,
    settings: ControllerSettings,
    camera_p: Array | None = None,
) -> Setpoint:
    """Hover above a target, gaze on it.

    Parameters
    ----------
    estimate : of the target; its ``radius_m`` plus the target's extent is the ball kept in view
    camera_p : (3,) where the camera is now, so that the gaze is right on the way (default: the setpoint)
    """
    height = working_height(camera, _view_radius(settings.target_extent_m, estimate.radius_m), settings)
    ahead = estimate.p_world + LEAD_S * estimate.v_world
    p = _above(ahead, height, region, settings.region_margin_m)
    if camera_p is None:
        return Setpoint(p, _look_from(p, estimate.p_world, settings))
    if estimate.seen:  # the right height can wait while the target is in view
        step = CLIMB_MPS / settings.reference_position_gain_per_s
        p = np.array([p[0], p[1], camera_p[2] + min(max(p[2] - camera_p[2], -step), step)])
    return Setpoint(p, _look_from(camera_p, estimate.p_world, settings))


def sway(setpoint: Setpoint, t_s: float, region: Region | None, settings: ControllerSettings) -> Setpoint:
    """Go round a setpoint, ``SWAY_M`` away, once in ``SWAY_S``: a camera that moves otherwise than its target.

    Who moves as the target does learns nothing of its size. The gaze stays on the target.
    """
    a = 2.0 * math.pi * t_s / SWAY_S
    p = setpoint.p_world + SWAY_M * np.array([math.cos(a), math.sin(a), 0.0])
    return Setpoint(p if region is None else region.project(p, settings.region_margin_m), setpoint.gaze)


def loiter(region: Region, camera: CameraModel, settings: ControllerSettings) -> Setpoint:
    """Wait in the middle of the region, looking straight down, as high as the far range lets the ground be seen."""
    low, high = region.bounds[:, 2]
    z = min(high - settings.region_margin_m, max(camera.far_m, low))
    middle = np.array([region.center[0], region.center[1], z])
    return Setpoint(region.project(middle, settings.region_margin_m), np.zeros(2))


def intercept(
    entry_p: Array,
    entry_v: Array,
    radius_m: float,
    region: Region | None,
    camera: CameraModel,
    settings: ControllerSettings,
    late_s: float = 0.0,
) -> Setpoint:
    """Wait at the predicted entry (3,), high enough for the uncertainty ball ``radius_m`` to be in view.

    The camera looks at where the target enters. A target that is late by ``late_s`` is expected on its way in with
    ``entry_v`` (3,), at most a ball's radius beyond the entry. When the region's ceiling is too low for the ball, the
    camera goes as high as it may.
    """
    ball = _view_radius(settings.target_extent_m, radius_m)
    speed = math.sqrt(float(entry_v @ entry_v))
    ahead = entry_v * min(max(late_s, 0.0), ball / speed) if speed > 1e-9 else np.zeros(3)
    p = _above(entry_p + ahead, working_height(camera, ball, settings), region, settings.region_margin_m)
    return Setpoint(p, _look_from(p, entry_p + ahead, settings))


def at_ease(
    goal: Setpoint, camera_p: Array, settings: ControllerSettings, within_s: float = math.inf
) -> Setpoint:
    """Setpoint on the way to ``goal``, so near that the references go no faster than need be.

    Effort grows with the square of the speed, and a camera that has time gains nothing by haste. References pull
    towards a setpoint at distance d with speed ``gain d``, so a setpoint ``v / gain`` ahead makes them go at v. The
    gaze is turned to where it is wanted at once.

    Parameters
    ----------
    camera_p : (3,) where the camera is now, m
    within_s : time until the target enters there (default: nobody is expected, and the camera takes its time)
    """
    way = goal.p_world - camera_p
    distance = math.sqrt(float(way @ way))
    allowed = PUNCTUAL * within_s if math.isfinite(within_s) else REPOSE_S
    speed = max(distance / max(allowed, 1e-3), LEAST_SPEED_MPS)
    step = speed / settings.reference_position_gain_per_s
    if step >= distance or speed >= 0.5 * settings.reference_v_max_mps:
        return goal
    return Setpoint(camera_p + way * (step / distance), goal.gaze)
