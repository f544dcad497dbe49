"""From a target's settings to its motion; what cannot be driven is refused here."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NoReturn

import numpy as np
from shapely.geometry import LinearRing

from camnet.errors import WorldError
from camnet.geometry.settings import Road
from camnet.motion.curve import ClosedCurve
from camnet.motion.field_law import build_law
from camnet.motion.field_motion import build_field
from camnet.motion.fields import LoopField, PlanarField, WaveField
from camnet.motion.protocol import TargetMotion
from camnet.motion.replay import ReplayMotion, TrackPath
from camnet.motion.road import RoadMotion
from camnet.motion.road_network import RoadNetwork
from camnet.motion.settings import FieldTarget, RoadTarget, TargetSettings, TrackTarget, VectorFieldTarget
from camnet.motion.track import Track
from camnet.motion.vector_field import Drive, VectorFieldMotion
from camnet.types import Array

__all__ = ["HORIZON_S", "build_motion"]

_SETTLE_STEPS = 2000
#: certificates follow paths for as long
HORIZON_S = 300.0
#: what a speed can exceed its samples by, generously
_BETWEEN_SAMPLES = 1.001


def build_motion(
    target: TargetSettings, roads: Sequence[Road], track: Track | None = None, horizon_s: float = HORIZON_S
) -> TargetMotion:
    """Make the motion that ``target`` asks for.

    Parameters
    ----------
    target : settings of one target
    roads : all roads of the world
    track : the record, for a target of kind ``track`` (the importers read it)
    horizon_s : for how long the path of a target of kind ``field`` is followed; later it stands

    Raises
    ------
    ConfigError, DataError
        The law of a target of kind ``field`` is none.
    WorldError
        An unknown or unsuitable road, a start that is nowhere, or motion beyond the target's own bounds.
    """
    motion = target.motion
    if isinstance(motion, VectorFieldTarget):
        return _vector_field(target, motion, roads)
    if isinstance(motion, RoadTarget):
        return _road(target, motion, roads)
    if isinstance(motion, FieldTarget):
        return build_field(target, motion, build_law(motion), horizon_s)
    return _replay(target, motion, track)


def _vector_field(
    target: TargetSettings, motion: VectorFieldTarget, roads: Sequence[Road]
) -> VectorFieldMotion:
    fastest = motion.speed_mps * (1.0 + motion.speed_modulation)
    if fastest > target.v_max_mps:
        _refuse(
            target,
            f"motion.speed_mps = {motion.speed_mps} rises to {fastest:g} m/s with its modulation, above v_max_mps = "
            f"{target.v_max_mps}; slow it down or raise v_max_mps",
        )
    field: PlanarField
    if motion.field == "loop":
        field, start_points = _loop(target, motion, roads)
    else:
        field, start_points = _wave(target, motion)
    wheel_max = motion.wheel_speed_max_mps
    if wheel_max is None:
        wheel_max = target.v_max_mps + 0.5 * motion.wheel_base_m * target.w_max_radps
    drive = Drive(target.v_max_mps, target.w_max_radps, motion.wheel_base_m, wheel_max, motion.motor_lag_s)
    built = VectorFieldMotion(
        field, drive, motion.heading_gain_per_s, target.start_m, target.start_heading_rad, start_points
    )
    _check_turns(target, built)
    return built


def _loop(
    target: TargetSettings, motion: VectorFieldTarget, roads: Sequence[Road]
) -> tuple[LoopField, Array]:
    road = _find(target, motion.road, roads)
    points = np.array(road.points_m, dtype=np.float64)
    if len(points) > 1 and np.array_equal(points[0], points[-1]):
        points = points[:-1]
    if not road.closed and len(points) == len(road.points_m):
        _refuse(target, f"motion.road = {road.name!r} is open; a closed road was expected (closed: true)")
    if len(points) < 3:
        _refuse(target, f"motion.road = {road.name!r} has {len(points)} points; at least 3 make a loop")
    steps = np.linalg.norm(np.diff(points, axis=0, append=points[:1]), axis=1)
    if np.any(steps == 0):
        bad = points[int(np.argmin(steps))].tolist()
        _refuse(target, f"motion.road = {road.name!r} has the point {bad} twice in a row; leave one out")
    curve = ClosedCurve.through(points)
    if not LinearRing(curve.samples).is_simple:
        _refuse(
            target,
            f"motion.road = {road.name!r} crosses itself, so one place would have two directions; "
            "a loop without crossings was expected (or kind: road)",
        )
    attraction = motion.attraction_per_s / motion.speed_mps
    return LoopField(curve, motion.speed_mps, attraction, motion.speed_modulation), curve.samples


def _wave(target: TargetSettings, motion: VectorFieldTarget) -> tuple[WaveField, Array]:
    center = np.array(motion.center_m)
    if target.start_m is not None:
        away = float(np.linalg.norm(np.array(target.start_m) - center))
        if not 0.0 < away < motion.scale_m:
            _refuse(
                target,
                f"start_m = {list(target.start_m)} lies {away:g} m from the field's centre {center.tolist()}; "
                f"more than 0 and less than scale_m = {motion.scale_m} was expected",
            )
    angle = np.linspace(0.0, 2.0 * math.pi, 64, endpoint=False)
    ring = center + 0.6 * motion.scale_m * np.column_stack([np.cos(angle), np.sin(angle)])
    return WaveField(motion.center_m, motion.scale_m, motion.speed_mps, motion.speed_modulation), ring


def _check_turns(target: TargetSettings, motion: VectorFieldMotion) -> None:
    """Follow the field itself (without the robot's limits) once it has settled, and compare its turns with w_max."""
    x, y = motion.start_points[0].tolist()
    field, worst, where = motion.field, 0.0, (x, y)
    step_m = _around_m(motion) / _SETTLE_STEPS
    for k in range(3 * _SETTLE_STEPS):
        direction, gx, gy, speed = field.guide(x, y)
        dx, dy = math.cos(direction), math.sin(direction)
        turn = abs(speed * (gx * dx + gy * dy))
        if k >= _SETTLE_STEPS and turn > worst:
            worst, where = turn, (x, y)
        x, y = x + step_m * dx, y + step_m * dy
    if worst > target.w_max_radps:
        _refuse(
            target,
            f"its path turns at {worst:.3g} rad/s near ({where[0]:.2f}, {where[1]:.2f}), above w_max_radps = "
            f"{target.w_max_radps}; slow it down, widen the bend or raise w_max_radps",
        )


def _around_m(motion: VectorFieldMotion) -> float:
    points = motion.start_points
    return float(np.linalg.norm(np.diff(points, axis=0, append=points[:1]), axis=1).sum())


def _road(target: TargetSettings, motion: RoadTarget, roads: Sequence[Road]) -> RoadMotion:
    road = _find(target, motion.road, roads)
    slow, fast = motion.speed_mps
    if not 0.0 < slow <= fast <= target.v_max_mps:
        _refuse(
            target,
            f"motion.speed_mps = {list(motion.speed_mps)}; 0 < slowest <= fastest <= v_max_mps = "
            f"{target.v_max_mps} was expected",
        )
    if target.start_m is not None:
        _refuse(
            target,
            f"start_m = {list(target.start_m)} is not used by a target on roads; "
            "give motion.start_arc_m, the distance from the start of its road",
        )
    network = RoadNetwork.of(roads)
    index = list(roads).index(road)
    length = network.lines[index].length_m
    if motion.start_arc_m is not None and motion.start_arc_m > length:
        _refuse(target, f"motion.start_arc_m = {motion.start_arc_m}; road {road.name!r} is {length:g} m long")
    leash = max(2.0 * fast / target.w_max_radps, road.width_m / 2.0)
    return RoadMotion(
        network,
        motion.speed_mps,
        target.v_max_mps,
        target.w_max_radps,
        leash,
        motion.lateral_std_m,
        index,
        motion.start_arc_m,
        target.start_heading_rad,
    )


def _replay(target: TargetSettings, motion: TrackTarget, track: Track | None) -> ReplayMotion:
    if track is None:
        _refuse(
            target,
            f"motion.file = {str(motion.file)!r} was not read; a track has to be passed to build_motion",
        )
    if motion.start_s >= max(track.duration_s, 1e-9):
        _refuse(target, f"motion.start_s = {motion.start_s}; track {track.id!r} lasts {track.duration_s:g} s")
    path = TrackPath.of(track)
    speeds = _BETWEEN_SAMPLES * path.speeds()
    if speeds.size and speeds.max() > target.v_max_mps:
        piece = int(np.argmax(speeds.max(axis=1)))
        _refuse(
            target,
            f"track {track.id!r} reaches {speeds.max():.3g} m/s {track.t_s[piece] - track.t_s[0]:g} s after its "
            f"start, above v_max_mps = {target.v_max_mps}; raise v_max_mps, or clean the track",
        )
    return ReplayMotion(
        path,
        float(track.t_s[0]) + motion.start_s,
        motion.min_speed_mps,
        target.v_max_mps,
        target.w_max_radps,
        target.start_heading_rad,
    )


def _find(target: TargetSettings, name: str | None, roads: Sequence[Road]) -> Road:
    known = ", ".join(road.name for road in roads) or "none"
    if name is None:
        _refuse(target, f"motion.road is missing; name one of the roads: {known}")
    for road in roads:
        if road.name == name:
            return road
    _refuse(target, f"motion.road = {name!r} is no road of this world; its roads: {known}")


def _refuse(target: TargetSettings, message: str) -> NoReturn:
    raise WorldError(f"target {target.name!r}: {message}")
