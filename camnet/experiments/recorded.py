"""Recorded targets replayed past surveyed cameras and predicted through the gaps between the views.

A fix of a track is *seen* if a camera sees its place on the ground (``camnet.estimation.crossing.views``). A *gap* is a
seen fix (exit), one or more unseen ones, and a seen one (entry) of the same target. Fixes farther apart than
``max_fix_interval_s`` are a recording that stopped, not a gap: nobody knows whether the target was in view meanwhile.

All targets' fixes are taken in one order of time. At the exit a predictor knows what cameras saw before, of everybody
(and nothing that no camera saw); the prediction is a function of time, read off at the time of the entry.

Next camera: what a row says, one rule for all, is the nearest camera that sees the predicted place, or whose footprint
is nearest to it; the learned row has a distribution over cameras of its own and takes its maximum. For the last-seen
place that rule gives the camera of the exit. Which camera truly saw the target next is the nearest that sees the entry.

Ground height: GPS heights scatter by ten metres and are not used. The fixes are put on a horizontal plane; the survey's
local frame has its origin on the ground, so 0 is the default, and the point looked at is ``target_height_m`` above.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from shapely import MultiPolygon, Polygon

from camnet.errors import DataError
from camnet.estimation.crossing import (
    CameraViews,
    CrossingPredictor,
    CrossingSettings,
    GapPredictor,
    LastSeen,
)
from camnet.experiments.recorded_replay import Fixes, Progress, Record, collect, replay
from camnet.experiments.recorded_summary import Row, summarise
from camnet.geometry.pinhole import Pinhole
from camnet.importers.geodesy import Origin
from camnet.importers.surveyed_camera import SurveyedCamera
from camnet.motion.track import Track
from camnet.types import Array, BoolArray, IntArray

__all__ = ["RecordedMap", "RecordedResult", "camera_views", "run_recorded"]

#: makes further predictors to be compared, by name, from the number of cameras and the bounds (2, 2) of the views
MoreRows = Callable[[CrossingSettings, int, Array], Mapping[str, GapPredictor]]


@dataclass(frozen=True, eq=False, slots=True)
class RecordedMap:
    """What a map of the run shows; all in metres in the local frame.

    Attributes
    ----------
    cameras : names
    camera_p_world : (C, 3) optical centres
    footprints : for each camera, the outlines (n, 2) of the ground that it sees
    fixes : (n, 2) all recorded fixes, ``seen`` (n,) which of them a camera saw
    exits, entries, predicted : (gaps, 2) the two ends of each gap and where the learned row expected the entry
    origin : of the local frame, None if unknown
    """

    cameras: tuple[str, ...]
    camera_p_world: Array
    footprints: tuple[tuple[Array, ...], ...]
    fixes: Array
    seen: BoolArray
    exits: Array
    entries: Array
    predicted: Array
    origin: Origin | None


@dataclass(frozen=True, eq=False, slots=True)
class RecordedResult:
    """Outcome of a run.

    Attributes
    ----------
    summary : ``{"gaps": {...}, "recording": {...}}``, ready for JSON
    gaps : one row a gap, columns by name (n,): lists of text, or numeric arrays
    map : see `RecordedMap`
    interrupted : the run was stopped early; everything here covers the part before
    """

    summary: dict[str, Any]
    gaps: dict[str, list[str] | Array | IntArray]
    map: RecordedMap
    interrupted: bool


def camera_views(
    cameras: Sequence[SurveyedCamera], height_m: float, range_cap_m: float, near_m: float = 0.5
) -> CameraViews:
    """Build the views of surveyed cameras over a horizontal plane at ``height_m``."""
    return CameraViews(
        tuple(Pinhole.from_settings(camera.intrinsics) for camera in cameras),
        np.array([camera.p_world for camera in cameras]),
        np.array([camera.q_world for camera in cameras]),
        height_m,
        near_m,
        range_cap_m,
    )


def run_recorded(
    cameras: Sequence[SurveyedCamera],
    tracks: Sequence[Track],
    settings: CrossingSettings | None = None,
    range_cap_m: float = 80.0,
    origin: Origin | None = None,
    seed: int = 0,
    progress: Progress | None = None,
    *,
    near_m: float = 0.5,
    ground_height_m: float = 0.0,
    target_height_m: float = 1.0,
    max_fix_interval_s: float = 30.0,
    min_gap_s: float = 0.0,
    max_gap_s: float = 3600.0,
    more_rows: MoreRows | None = None,
) -> RecordedResult:
    """Replay recorded tracks past surveyed cameras, learn from everybody, predict everybody.

    Parameters
    ----------
    cameras : surveyed cameras
    tracks : recorded targets; pieces ``id#1``, ``id#2``, ... of one recording belong to one target
    settings : of the learned predictor and the Kalman filter
    range_cap_m, near_m : largest distance and least depth at which a camera recognises a target
    origin : of the local frame, for the map
    seed : of the bootstrap; the predictions are deterministic
    progress : called with the share done, 0 to 1
    ground_height_m, target_height_m : z of the ground in the local frame; height above it that is looked at
    max_fix_interval_s : fixes farther apart are a recording that stopped
    min_gap_s, max_gap_s : shorter gaps are left out of the table; after a longer one a new visit begins
    more_rows : further predictors for the table

    Raises
    ------
    DataError
        There is no camera or no track, or no target ever crosses a gap.
    """
    settings = settings or CrossingSettings()
    if not cameras or not tracks:
        raise DataError(f"{len(cameras)} cameras and {len(tracks)} tracks; at least one of each was expected")
    views = camera_views(cameras, ground_height_m + target_height_m, range_cap_m, near_m)
    fixes = collect(tracks, views, max_fix_interval_s)
    footprints = views.footprints()
    rows = _rows(settings, len(cameras), footprints, more_rows)
    record, interrupted = replay(fixes, rows, settings, min_gap_s, max_gap_s, progress)
    if not record.crossings:
        raise DataError(
            f"no target is seen, lost and seen again: {np.sum(fixes.camera >= 0)} of {len(fixes.t_s)} fixes are seen; "
            "are the tracks, the cameras and the origin of one site?"
        )
    table, compared = _tabulate(record, fixes, views, footprints, [camera.name for camera in cameras])
    summary = {
        "gaps": summarise(compared, np.asarray(table["target_index"]), np.random.default_rng(seed)),
        "recording": _recording(fixes, record, len(cameras)),
    }
    summary["gaps"]["radius_coverage"] = _coverage(table)
    picture = _map(cameras, footprints, fixes, record, origin)
    return RecordedResult(summary, table, picture, interrupted)


def _rows(
    settings: CrossingSettings,
    cameras: int,
    footprints: Sequence[Polygon | MultiPolygon],
    more_rows: MoreRows | None,
) -> dict[str, GapPredictor]:
    rows: dict[str, GapPredictor] = {
        "learned": CrossingPredictor(settings, cameras),
        "last_seen": LastSeen(cameras),
    }
    if more_rows is not None:
        boxes = np.array([shape.bounds for shape in footprints if not shape.is_empty]).reshape(-1, 4)
        bounds = np.array([boxes[:, :2].min(axis=0), boxes[:, 2:].max(axis=0)])
        rows |= more_rows(settings, cameras, bounds)
    return rows


def _tabulate(
    record: Record,
    fixes: Fixes,
    views: CameraViews,
    footprints: Sequence[Polygon | MultiPolygon],
    names: Sequence[str],
) -> tuple[dict[str, list[str] | Array | IntArray], dict[str, Row]]:
    """Columns of the table of gaps, and what is compared in the summary."""
    exits, entries = [c.exit for c in record.crossings], [c.entry for c in record.crossings]
    truth, seen_by = np.array([e.p_world for e in entries]), np.array([e.camera for e in entries])
    table: dict[str, list[str] | Array | IntArray] = {
        "target": [fixes.names[e.target] for e in exits],
        "target_index": np.array([e.target for e in exits]),
        "exit_t_s": np.array([e.t_s for e in exits]),
        "entry_t_s": np.array([e.t_s for e in entries]),
        "exit_camera": [names[e.camera] for e in exits],
        "entry_camera": [names[e.camera] for e in entries],
    }
    _add_points(table, "exit", np.array([e.p_world for e in exits]))
    _add_points(table, "exit_v", np.array([e.v_world for e in exits]), "mps")
    _add_points(table, "entry", truth)
    compared = {}
    for name, places in record.places.items():
        place = np.array(places)
        camera = np.array(record.cameras[name])
        if camera[0] < 0:
            camera = views.nearest_view(place, footprints)
        error = np.hypot(*(place - truth).T)
        compared[name] = Row(error, camera == seen_by)
        if name != "learned_at_exit":
            _add_points(table, name, place)
            table[f"{name}_error_m"] = error
        table[f"{name}_next_camera"] = [names[c] for c in camera]
    table["learned_radius_m"] = np.array(record.radius_m)
    return table, compared


def _add_points(
    table: dict[str, list[str] | Array | IntArray], name: str, points: Array, unit: str = "m"
) -> None:
    table[f"{name}_x_{unit}"], table[f"{name}_y_{unit}"] = points[:, 0], points[:, 1]


def _coverage(table: Mapping[str, list[str] | Array | IntArray]) -> float | None:
    """Share of entries within the stated radius, where there was one."""
    radius, error = np.asarray(table["learned_radius_m"]), np.asarray(table["learned_error_m"])
    stated = np.isfinite(radius)
    return float(np.mean(error[stated] <= radius[stated])) if stated.any() else None


def _recording(fixes: Fixes, record: Record, cameras: int) -> dict[str, Any]:
    duration = np.array([c.entry.t_s - c.exit.t_s for c in record.crossings])
    other = [c.exit.camera != c.entry.camera for c in record.crossings]
    return {
        "cameras": cameras,
        "targets": len(fixes.names),
        "visits": int(np.unique(fixes.visit).size),
        "fixes": len(fixes.t_s),
        "in_view": float(np.mean(fixes.camera >= 0)),
        "gap_median_s": float(np.median(duration)),
        "gaps_to_another_camera": float(np.mean(other)),
    }


def _map(
    cameras: Sequence[SurveyedCamera],
    footprints: Sequence[Polygon | MultiPolygon],
    fixes: Fixes,
    record: Record,
    origin: Origin | None,
) -> RecordedMap:
    return RecordedMap(
        tuple(camera.name for camera in cameras),
        np.array([camera.p_world for camera in cameras]),
        tuple(_outlines(shape) for shape in footprints),
        fixes.p_world,
        fixes.camera >= 0,
        np.array([c.exit.p_world for c in record.crossings]),
        np.array([c.entry.p_world for c in record.crossings]),
        np.array(record.places["learned"]),
        origin,
    )


def _outlines(shape: Polygon | MultiPolygon) -> tuple[Array, ...]:
    parts = shape.geoms if isinstance(shape, MultiPolygon) else [shape]
    return tuple(np.asarray(part.exterior.coords)[:, :2] for part in parts if not part.is_empty)
