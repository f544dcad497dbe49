"""Place cameras so that no recorded track is out of view for longer than allowed.

| symbol | name | unit | meaning |
| --- | --- | --- | --- |
| t(s) | ``_clock`` | s | time at which a track has come a way s; standing still takes time and no way |
| L | ``off_max_s`` | s | longest time out of view |

The placement of ``camnet.certification.design`` asks for stretches along directed lines. Here a line is a track,
measured in seconds from its start, and a stretch in view is the time that the target spent in it. Before its first fix
and after its last one nothing is asked; between two fixes the target is taken to move straight and evenly.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from camnet.certification.coverage import Coverage, cover_roads
from camnet.certification.design import Placement, place_cameras
from camnet.certification.free_network import ground_views
from camnet.certification.road_arcs import RoadArcs, arcs_from_polylines
from camnet.errors import ConfigError, DataError
from camnet.experiments.certified import Certified
from camnet.experiments.certify_site import sensor_views
from camnet.experiments.design_roads import best_placement, weights_of
from camnet.importers.sumo_detectors import Sensor, read_sensor_table
from camnet.motion.track import Track
from camnet.report.certificate import MapLine
from camnet.types import Array

__all__ = ["design_tracks", "timed_coverage", "track_candidates", "unseen_stretches"]

#: way per fix that a standing target is taken to make, so that time grows with the way, m
_CREEP_M = 1e-7
#: step at which the answer is checked by looking, s
_LOOK_S = 0.1
#: most places of a grid
_MOST_CANDIDATES = 1_000_000
#: most of these steps, over all tracks
_MOST_LOOKS = 20_000_000
#: the longest stretches out of view that the map shows
_DRAWN = 20


def design_tracks(
    tracks: Sequence[Track],
    *,
    off_max_s: float,
    footprint_m: float,
    extent_m: float,
    spacing_m: float | None = None,
    poles: Path | None = None,
    count: int | None = None,
    objective: str | None = None,
    effort: float = 1.0,
    time_limit_s: float = math.inf,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> Certified:
    """Place cameras that look straight down on squares of ground, so that every track is seen often enough.

    Parameters
    ----------
    tracks : recorded targets
    off_max_s : longest time out of view, s
    footprint_m, extent_m : side of a view; radius of the targets' extent, m
    spacing_m : of the grid of candidate places; None: half a footprint
    poles : candidate places instead, with costs if wanted
    count, objective : as in ``design_roads``
    """
    moving = [t for t in tracks if len(t.t_s) > 1 and np.ptp(t.p_world[:, :2], axis=0).max() > 1e-3]
    if not moving:
        raise DataError(f"{len(tracks)} tracks: none of them moves; a set of trajectories was expected")
    lasting = max(t.duration_s for t in moving)
    if lasting <= off_max_s:
        raise ConfigError(
            f"--off-max {off_max_s:g}: no track lasts longer than {lasting:g} s, so that nothing asks for a camera; "
            "give a shorter time"
        )
    looks = sum(t.duration_s for t in moving) / _LOOK_S
    if looks > _MOST_LOOKS:
        raise DataError(
            f"the tracks last {looks * _LOOK_S:.4g} s in all, {looks:.4g} looks of {_LOOK_S:g} s; at most "
            f"{_MOST_LOOKS:,} are possible: are their times in seconds?"
        )
    lines = [t.p_world[:, :2] for t in moving]
    roads = arcs_from_polylines(lines, [[] for _ in lines])
    sensors = (
        list(read_sensor_table(poles))
        if poles is not None
        else track_candidates(lines, spacing_m or 0.5 * footprint_m, footprint_m)
    )
    cover = cover_roads(roads, sensor_views(sensors, footprint_m), 0.0, extent_m)
    clocks, timed = timed_coverage(roads, cover, moving)
    weight = weights_of(sensors, objective)

    def place(off_s: float) -> Placement:  # the lines are measured in seconds
        return place_cameras(
            clocks,
            timed,
            len(sensors),
            off_s,
            costs=weight,
            effort=effort,
            time_limit_s=time_limit_s,
            seed=seed,
            progress=progress,
        )

    found, off_max_s = best_placement(place, off_max_s, count, objective)
    chosen = [sensors[k] for k in found.chosen.tolist()]
    views = sensor_views(chosen, footprint_m)
    ground = ground_views(views, [s.name for s in chosen], 0.0, extent_m)
    hidden = unseen_stretches(moving, [g.view for g in ground])
    longest = hidden[0][0] if hidden else 0.0
    report: dict[str, Any] = {
        **found.as_dict(),
        "cameras": [{"name": s.name, "x": s.x_m, "y": s.y_m} for s in chosen],
        "certified": found.certified and longest <= off_max_s + 2.0 * _LOOK_S,
        "optimal": found.optimal,
        "candidates": len(sensors),
        "off_max_s": off_max_s,
        "tracks": len(moving),
        "standing_tracks": len(tracks) - len(moving),
        "longest_unseen_s": longest,
        "roads_km": float(roads.length_m.sum() / 1000.0),
        "target_class": f"{len(moving)} recorded tracks",
    }
    verdict = "certified" if report["certified"] else "not certified"
    drawn = [MapLine(line, "seen", f"track {t.id}") for line, t in zip(lines, moving, strict=True)]
    for seconds, name, points in hidden[:_DRAWN]:
        drawn.append(MapLine(points, verdict, f"track {name}: {seconds:.1f} s out of view"))
    return Certified(report, [ring for g in ground for ring in g.rings], drawn)


def track_candidates(lines: Sequence[Array], spacing_m: float, footprint_m: float) -> list[Sensor]:
    """Return places on a square grid that have a track within half a footprint."""
    points = np.concatenate(lines)
    low = points.min(axis=0) - 0.5 * footprint_m
    cells = np.ceil((np.ptp(points, axis=0) + footprint_m) / spacing_m) + 1.0
    if cells.prod() > _MOST_CANDIDATES:
        raise ConfigError(
            f"--spacing {spacing_m:g}: the grid of candidates has {cells.prod():.4g} places; at most "
            f"{_MOST_CANDIDATES:,} are possible: take more"
        )
    size = cells.astype(int)
    near = np.zeros(size, dtype=bool)
    reach = math.ceil(0.5 * footprint_m / spacing_m)
    near_cells = np.unique(np.round((points - low) / spacing_m).astype(int), axis=0)
    for dx in range(-reach, reach + 1):
        for dy in range(-reach, reach + 1):
            shifted = np.clip(near_cells + np.array([dx, dy]), 0, size - 1)
            near[shifted[:, 0], shifted[:, 1]] = True
    return [
        Sensor(f"grid {i} {j}", float(low[0] + i * spacing_m), float(low[1] + j * spacing_m))
        for i, j in np.argwhere(near).tolist()
    ]


def timed_coverage(roads: RoadArcs, coverage: Coverage, tracks: Sequence[Track]) -> tuple[RoadArcs, Coverage]:
    """Measure every track in seconds from its start in place of metres."""
    durations = np.array([t.t_s[-1] - t.t_s[0] for t in tracks])
    start, end = coverage.start_m.copy(), coverage.end_m.copy()
    deepest = coverage.deepest_m.copy()
    for k, track in enumerate(tracks):
        rows = coverage.arc == k
        way, clock = _clock(track)
        scale = way[-1] / roads.length_m[k]
        # at the ends of a stretch a standing target counts as in view
        start[rows] = np.interp(start[rows] * scale - _CREEP_M, way, clock)
        end[rows] = np.interp(end[rows] * scale + _CREEP_M * len(way), way, clock)
        deepest[rows] = np.clip(np.interp(deepest[rows] * scale, way, clock), start[rows], end[rows])
    order = np.lexsort((start, coverage.arc))
    timed = Coverage(
        coverage.arc[order], coverage.camera[order], start[order], end[order], coverage.depth_m[order], deepest[order]
    )  # fmt: skip
    return replace(roads, length_m=durations), timed


def _clock(track: Track) -> tuple[Array, Array]:
    """Return the way made at every fix, m, strictly growing, and the time since the first fix, s."""
    steps = np.linalg.norm(np.diff(track.p_world[:, :2], axis=0), axis=1)
    way = np.concatenate([[0.0], np.cumsum(steps)]) + _CREEP_M * np.arange(len(track.t_s))
    return way, track.t_s - track.t_s[0]


def unseen_stretches(tracks: Sequence[Track], views: Sequence[Any]) -> list[tuple[float, str, Array]]:
    """Return times out of view, s, whose and where (n, 2), the longest first.

    Found by looking every tenth of a second, a route that shares nothing with the placement.
    """
    found: list[tuple[float, str, Array]] = []
    for track in tracks:
        t = np.arange(track.t_s[0], track.t_s[-1], _LOOK_S)
        p = np.stack([np.interp(t, track.t_s, track.p_world[:, k]) for k in (0, 1)], axis=1)
        seen = np.any([v.depth(p) >= 0.0 for v in views], axis=0) if views else np.zeros(len(t), dtype=bool)
        edges = np.flatnonzero(np.diff(np.r_[False, ~seen, False].astype(int))).reshape(-1, 2)
        found += [((b - a) * _LOOK_S, track.id, p[a:b]) for a, b in edges.tolist()]
    return sorted(found, key=lambda row: -row[0])
