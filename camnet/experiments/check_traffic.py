"""Check a promise against traffic: every unseen stretch that was too long, which assumption failed, and better values.

The traffic is replayed through what the cameras look at; the roads are used only to say how far vehicles drove beside
their lanes. A stretch breaks the promise where it is longer, or takes longer, than is allowed.

| assumption | measured from the traffic |
| --- | --- |
| ``v_lo_mps`` | mean speed over an unseen stretch while moving |
| ``stop_s`` | time of standing still (below 0.1 m/s) within an unseen stretch |
| ``extent_m`` | distance of a vehicle's reference point from the nearest lane |
| ``v_max_mps`` | speed between two fixes; jumps of the recording count as its fault |
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from camnet.certification.coverage import Views
from camnet.certification.road_arcs import RoadArcs
from camnet.certification.transitions import RoadTargetClass
from camnet.certification.unseen_stretches import STRETCH_KINDS, Stretch, stretches_of
from camnet.errors import ConfigError
from camnet.importers.csv_tracks import read_csv_tracks
from camnet.importers.fcd_tracks import read_fcd_tracks
from camnet.importers.fixes import TrackOptions
from camnet.motion.track import Track
from camnet.types import Array

__all__ = ["check_traffic", "read_traffic"]

#: lengths of the recording are rounded; stretches may exceed the limit by this much, m and s
_SLACK_M, _SLACK_S = 0.5, 0.5
#: share of the vehicles that proposed values hold for
_SHARE = 0.99
#: broken stretches that the report lists
_MOST_LISTED = 1000
#: fixes between two at which the distance to the lanes is measured
_STRIDE = 10
#: faster than this no road vehicle is, m/s: the recording jumps
_JUMP_MPS = 100.0


def read_traffic(path: Path) -> tuple[Track, ...]:
    """Read SUMO's floating-car data (``.xml``, ``.xml.gz``) or a table of tracks (``.csv``) in the network's metres."""
    name = path.name.lower()
    if name.endswith((".xml", ".xml.gz")):
        return read_fcd_tracks(path, TrackOptions())
    if name.endswith((".csv", ".csv.gz")):
        return read_csv_tracks(path, TrackOptions())
    raise ConfigError(f"--check {str(path)!r}: SUMO's FCD (.xml, .xml.gz) or tracks (.csv) were expected")


def check_traffic(
    tracks: Sequence[Track],
    views: Views,
    roads: RoadArcs,
    target: RoadTargetClass,
    limit_m: float | None,
    limit_s: float | None,
) -> dict[str, Any]:
    """Return the report of a check as plain data.

    Parameters
    ----------
    tracks : traffic in the network's frame
    views : of the cameras, looked at on the ground
    roads, target : what the promise was made for
    limit_m, limit_s : longest way and longest time out of view that are allowed; None: not limited
    """
    stretches = stretches_of(tracks, views)
    lanes = _lanes(roads)
    faults = [s for s in stretches if _too_long(s, limit_m, limit_s)]
    listed = sorted(faults, key=lambda s: (-s.length_m, -s.time_s, s.track))[:_MOST_LISTED]
    by_id = {track.id: track for track in tracks}
    rows = [_row(s, by_id[s.track], lanes, target, limit_m, limit_s) for s in listed]
    longest = max((s.length_m for s in stretches), default=0.0)
    outside = [s.track for s in stretches if _failed(s, target)]
    return {
        "vehicles": len(tracks),
        "stretches": {k: sum(s.kind == k for s in stretches) for k in STRETCH_KINDS},
        "longest_m": {
            k: max((s.length_m for s in stretches if s.kind == k), default=0.0) for k in STRETCH_KINDS
        },
        "longest_s": {
            k: max((s.time_s for s in stretches if s.kind == k), default=0.0) for k in STRETCH_KINDS
        },
        "limit_m": limit_m,
        "limit_s": limit_s,
        "tightness": None if limit_m is None else longest / limit_m,
        "broken": len(faults),
        "broken_inside_assumptions": sum(not row["assumptions_failed"] for row in rows),
        "inside_assumptions": 1.0 - len(outside) / len(stretches) if stretches else None,
        "vehicles_inside": 1.0 - len(set(outside)) / len(tracks) if tracks else None,
        "worst": rows,
        "assumptions": _measured(stretches, tracks, lanes, target),
        "verdict": "kept" if not faults else "broken",
    }


def _too_long(s: Stretch, limit_m: float | None, limit_s: float | None) -> bool:
    return (limit_m is not None and s.length_m > limit_m + _SLACK_M) or (
        limit_s is not None and s.time_s > limit_s + _SLACK_S
    )


def _failed(s: Stretch, target: RoadTargetClass) -> list[str]:
    """Return the assumptions about speeds and waits that a stretch does not keep, in words."""
    out = []
    if s.fastest_mps > _JUMP_MPS:
        out.append(f"the recording jumps: {s.fastest_mps:.0f} m/s between two fixes")
    if s.moving_mps < target.v_lo_mps:
        out.append(f"v_lo_mps: {s.moving_mps:.2f} m/s while moving, {target.v_lo_mps:g} stated")
    if s.standing_s > target.stop_s + _SLACK_S:
        out.append(f"stop_s: stood still for {s.standing_s:.1f} s, {target.stop_s:g} stated")
    return out


def _row(
    s: Stretch,
    track: Track,
    lanes: shapely.STRtree,
    target: RoadTargetClass,
    limit_m: float | None,
    limit_s: float | None,
) -> dict[str, Any]:
    failed = _failed(s, target)
    if limit_m is not None and s.length_m > limit_m + _SLACK_M and limit_s is None:
        failed = [w for w in failed if w.startswith("the recording")]  # a way in metres needs no speed
    inside = (track.t_s >= s.start_s) & (track.t_s <= s.end_s)
    beside = _beside(track.p_world[inside, :2], lanes)
    if len(beside) and beside.max() > target.extent_m:
        failed.append(f"extent_m: {beside.max():.2f} m beside the lanes, {target.extent_m:g} stated")
    return {
        "vehicle": s.track,
        "kind": s.kind,
        "unseen_m": s.length_m,
        "unseen_s": s.time_s,
        "from_s": s.start_s,
        "to_s": s.end_s,
        "from_xy": list(s.start_xy),
        "to_xy": list(s.end_xy),
        "assumptions_failed": failed,
    }


def _lanes(roads: RoadArcs) -> shapely.STRtree:
    length = np.repeat(roads.piece_length_m, np.diff(roads.line_ptr))[:, None]
    ends = roads.line_start_xy + length * roads.line_direction_xy
    return shapely.STRtree(shapely.linestrings(np.stack([roads.line_start_xy, ends], axis=1)))


def _beside(xy: Array, lanes: shapely.STRtree) -> Array:
    """Return the distances of points (n, 2) from the nearest lane, m."""
    points = shapely.points(xy)
    _, distance = lanes.query_nearest(points, return_distance=True, all_matches=False)
    return np.asarray(distance, dtype=np.float64)


def _measured(
    stretches: Sequence[Stretch], tracks: Sequence[Track], lanes: shapely.STRtree, target: RoadTargetClass
) -> dict[str, Any]:
    """Measure the assumptions, and propose values that hold for 99 % of the vehicles, on all their stretches."""
    slowest: dict[str, float] = {}
    stood: dict[str, float] = {}
    for s in stretches:
        if math.isfinite(s.moving_mps) and s.length_m > 0.0:
            slowest[s.track] = min(s.moving_mps, slowest.get(s.track, math.inf))
        stood[s.track] = max(s.standing_s, stood.get(s.track, 0.0))
    moving, standing = np.array(list(slowest.values())), np.array(list(stood.values()))
    beside = _beside(np.concatenate([t.p_world[::_STRIDE, :2] for t in tracks]), lanes)
    fastest = np.array([s.fastest_mps for s in stretches if s.fastest_mps < _JUMP_MPS])
    # each of the two assumptions about time may fail for half of the remaining share of the vehicles
    low, high = 0.5 * (1.0 - _SHARE), 1.0 - 0.5 * (1.0 - _SHARE)
    return {
        "v_lo_mps": {"stated": target.v_lo_mps, "smallest": _at(moving, 0.0), "proposed": _at(moving, low)},
        "stop_s": {"stated": target.stop_s, "largest": _at(standing, 1.0), "proposed": _at(standing, high)},
        "extent_m": {"stated": target.extent_m, "largest": _at(beside, 1.0), "proposed": _at(beside, _SHARE)},
        "v_max_mps": {
            "stated": target.v_max_mps,
            "largest": _at(fastest, 1.0),
            "proposed": _at(fastest, _SHARE),
        },
    }


def _at(values: Array, share: float) -> float | None:
    if not len(values):
        return None
    if share < 0.5:
        return float(np.quantile(values, share, method="lower"))
    return float(np.quantile(values, share, method="higher"))
