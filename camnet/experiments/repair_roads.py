"""Repair a network of road cameras: the smallest single changes for every uncertified way, and what must be added.

Three kinds of repair are offered. *Budget*: how many metres of view, cameras or m/s of the targets' class would be
enough, whatever their geometry (``smallest_repairs``). *Pose*: one of the two cameras at the ends moved, raised or
tilted, found by certifying the changed network; no other transition may lose its certificate. *Addition*: the fewest
cameras that, with those that stand, certify the whole network, with their places.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from camnet.certification.benchmark import nadir_views
from camnet.certification.camera_poses import FoundChange, PoseChange, changed_view, smallest_changes
from camnet.certification.coverage import Coverage, cover_roads
from camnet.certification.design import place_cameras, smallest_repairs
from camnet.certification.road_arcs import RoadArcs
from camnet.certification.road_gaps import RoadGaps, road_gaps
from camnet.certification.road_promise import road_promise
from camnet.certification.transitions import RoadTargetClass
from camnet.errors import CertificateError
from camnet.experiments.certify_site import read_sensors, sensor_views
from camnet.experiments.design_roads import candidates_of, way_limit
from camnet.experiments.road_site import read_road_site
from camnet.importers.sumo_detectors import Sensor
from camnet.types import Array

__all__ = ["repair_roads"]

#: height of the cameras, m, and of the targets' reference points
_CAMERA_M = 20.0
_CIRCLE = {
    "change": "break the unseen circle of roads with a camera",
    "amount": 1,
    "unit": "cameras",
    "cost": 1.0,
}


@dataclass(frozen=True, eq=False)
class _Standing:
    """The network that stands, and what it is asked for."""

    roads: RoadArcs
    sensors: tuple[Sensor, ...]
    coverage: Coverage
    target: RoadTargetClass
    limit_m: float
    on_min_s: float
    footprint_m: float
    height_m: float

    def changed(self, camera: int, change: PoseChange) -> Coverage:
        """Return what is seen with one camera changed."""
        sensor = self.sensors[camera]
        view = changed_view(
            np.array([sensor.x_m, sensor.y_m]), _CAMERA_M, sensor.footprint_m or self.footprint_m, change
        )
        fresh = cover_roads(self.roads, view, self.height_m, self.target.extent_m)
        others = self.coverage.camera != camera
        parts = [_rows(self.coverage, others), replace(fresh, camera=np.full_like(fresh.camera, camera))]
        names = ("arc", "camera", "start_m", "end_m", "depth_m", "deepest_m")
        joined = [np.concatenate([getattr(p, n) for p in parts]) for n in names]
        order = np.lexsort((joined[2], joined[0]))
        return Coverage(*(column[order] for column in joined))

    def faults(self, gaps: RoadGaps) -> dict[tuple[int, int], tuple[float, float]]:
        """Return the uncertified pairs of cameras: the longest unseen way and the least view behind it, m."""
        seen = gaps.stretches
        chord = seen.chord_m[gaps.entry_stretch]
        bad = gaps.longest_m > self.limit_m + 1e-9
        bad |= chord < self.target.v_max_mps * self.on_min_s - 1e-9
        out: dict[tuple[int, int], tuple[float, float]] = {}
        for k in np.flatnonzero(bad).tolist():
            key = (
                int(seen.exit_camera[gaps.exit_stretch[k]]),
                int(seen.entry_camera[gaps.entry_stretch[k]]),
            )
            length, view = out.get(key, (0.0, math.inf))
            out[key] = (max(length, float(gaps.longest_m[k])), min(view, float(chord[k])))
        return out


def repair_roads(
    network: Path,
    cameras: Path,
    target: RoadTargetClass,
    *,
    off_max_s: float | None,
    on_min_s: float,
    footprint_m: float,
    unseen_max_m: float | None = None,
    height_m: float = 0.5,
    spacing_m: float = 50.0,
    most_poses: int = 10,
    effort: float = 1.0,
    time_limit_s: float = math.inf,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> dict[str, Any]:
    """Return the repairs of every uncertified way between two cameras, the cheapest first, and of the whole network.

    Changes of poses are looked for at the ``most_poses`` transitions with the shortest unseen ways, which need least.
    """
    site, sensors = read_road_site(network), read_sensors(cameras, network)
    coverage = cover_roads(site.roads, sensor_views(sensors, footprint_m), height_m, target.extent_m)
    limit_m = way_limit(target, off_max_s, unseen_max_m)
    here = _Standing(site.roads, tuple(sensors), coverage, target, limit_m, on_min_s, footprint_m, height_m)
    gaps = road_gaps(site.roads, coverage)
    faults = here.faults(gaps)
    loops = int(gaps.cyclic.sum())
    rows = []
    ordered = sorted(faults.items(), key=lambda item: item[1][0])
    for k, ((a, b), (longest, chord)) in enumerate(ordered):
        changes: list[dict[str, Any]] = [_CIRCLE]
        if math.isfinite(longest):
            found = smallest_repairs(longest, chord, target, limit_m / target.v_lo_mps, on_min_s)
            changes = [
                {"change": r.change, "amount": r.amount, "unit": r.unit, "cost": r.cost} for r in found
            ]
            if k < most_poses:
                changes += _poses(here, (a, b), set(faults), loops)
        changes.sort(key=lambda c: float(c["cost"]))
        rows.append(
            {
                "from": sensors[a].name,
                "to": sensors[b].name,
                "longest_m": longest if math.isfinite(longest) else None,
                "changes": changes,
            }
        )
        if progress is not None:
            progress((k + 1) / len(ordered))
    promise = road_promise(
        site.roads, coverage, [s.name for s in sensors], target, off_max_s=None, off_max_m=limit_m,
        limit_source="as asked for", views=sensor_views(sensors, footprint_m), height_m=height_m,
    )  # fmt: skip
    certified = promise.verdict == "certified" and not faults
    extra = [] if certified else _additions(here, candidates_of(site, spacing_m), effort, time_limit_s, seed)
    return {
        "promise": promise.as_dict(),
        "count": len(sensors),
        "certified": certified,
        "repairs": rows,
        "additions": extra,
        "warnings": [f"camera {c.name} sees no road: {c.reason}" for c in promise.blind],
    }


def _poses(
    here: _Standing, pair: tuple[int, int], faults: set[tuple[int, int]], loops: int
) -> list[dict[str, Any]]:
    """Return the smallest move, raise and tilt of either camera that certify a transition and harm no other."""
    out = []
    for camera in dict.fromkeys(pair):

        def good(change: PoseChange, camera: int = camera) -> bool:
            gaps = road_gaps(here.roads, here.changed(camera, change))
            now = set(here.faults(gaps))
            return pair not in now and now <= faults and int(gaps.cyclic.sum()) <= loops

        side = here.sensors[camera].footprint_m or here.footprint_m
        out += [_pose_entry(here.sensors[camera].name, f) for f in smallest_changes(good, _CAMERA_M, side)]
    return out


def _pose_entry(name: str, found: FoundChange) -> dict[str, Any]:
    c = found.change
    towards = math.degrees(c.towards_rad if found.kind == "tilt" else math.atan2(c.north_m, c.east_m))
    heading = (
        "" if found.kind == "raise" else f" towards {towards % 360.0:.0f} degrees (from east, to the left)"
    )
    return {
        "change": f"{found.kind} {name}{heading} by",
        "amount": found.amount,
        "unit": found.unit,
        "cost": found.cost,
        "camera": name,
        "pose": {
            "east_m": c.east_m,
            "north_m": c.north_m,
            "up_m": c.up_m,
            "tilt_degrees": math.degrees(c.tilt_rad),
            "towards_degrees": math.degrees(c.towards_rad),
        },
    }


def _additions(
    here: _Standing, candidates: list[Sensor], effort: float, time_limit_s: float, seed: int
) -> list[dict[str, Any]]:
    """Return the fewest further cameras that certify the whole network, with their places; none if none are enough."""
    n = len(here.sensors)
    fresh = cover_roads(
        here.roads, _views_of(candidates, here.footprint_m), here.height_m, here.target.extent_m
    )
    fresh = replace(fresh, camera=fresh.camera + n)
    names = ("arc", "camera", "start_m", "end_m", "depth_m", "deepest_m")
    columns = [np.concatenate([getattr(here.coverage, k), getattr(fresh, k)]) for k in names]
    order = np.lexsort((columns[2], columns[0]))
    both = Coverage(*(column[order] for column in columns))
    # a camera that stands costs all but nothing, so that the number of further ones decides
    weight = np.r_[np.full(n, 0.5 / max(n, 1)), np.ones(len(candidates))]
    try:
        found = place_cameras(
            here.roads, both, n + len(candidates), here.limit_m, here.target.v_max_mps * here.on_min_s, weight,
            effort=effort, time_limit_s=time_limit_s, seed=seed,
        )  # fmt: skip
    except CertificateError:
        return []
    chosen = [candidates[k - n] for k in found.chosen.tolist() if k >= n]
    return [{"name": s.name, "x": s.x_m, "y": s.y_m} for s in chosen]


def _views_of(sensors: list[Sensor], footprint_m: float) -> Any:  # noqa: ANN401 - ``Views``
    places: Array = np.array([[s.x_m, s.y_m] for s in sensors])
    return nadir_views(places, _CAMERA_M, footprint_m)


def _rows(c: Coverage, keep: Array) -> Coverage:
    return Coverage(
        c.arc[keep], c.camera[keep], c.start_m[keep], c.end_m[keep], c.depth_m[keep], c.deepest_m[keep]
    )
