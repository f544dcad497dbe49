"""Place cameras over a city's roads, and repair a network that is not certified yet."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from camnet.certification.coverage import cover_roads
from camnet.certification.design import Placement, Repair, place_cameras, smallest_repairs
from camnet.certification.free_network import ground_views
from camnet.certification.road_gaps import road_gaps
from camnet.certification.site import certify_road_site, road_segments_with_verdict
from camnet.certification.transitions import RoadTargetClass
from camnet.errors import CertificateError
from camnet.experiments.certified import Certified
from camnet.experiments.certify_road_world import road_lines
from camnet.experiments.certify_site import RoadSite, read_road_site, read_sensors, sensor_views
from camnet.importers.sumo_detectors import Sensor
from camnet.types import Array

__all__ = ["candidates_of", "design_roads", "repair_roads"]

#: candidates closer than this are one, m
_APART_M = 5.0
#: rounds of the search for the shortest time out of view
_ROUNDS = 8


def candidates_of(site: RoadSite, spacing_m: float) -> list[Sensor]:
    """Return the candidate places of a road network: its junctions, and points every ``spacing_m`` along its roads."""
    roads = site.roads
    places = [(f"junction {k}", p) for k, p in enumerate(site.junctions)]
    for arc in range(roads.n_arcs):
        length = float(roads.length_m[arc])
        for s in np.arange(0.5 * spacing_m, length, spacing_m).tolist():
            places.append((f"{site.streets[arc]} + {s:.0f} m", roads.position(arc, s)))
    kept: list[Sensor] = []
    cells: dict[tuple[int, int], list[Array]] = {}
    for name, p in places:
        key = (math.floor(p[0] / _APART_M), math.floor(p[1] / _APART_M))
        near = [q for i in (-1, 0, 1) for j in (-1, 0, 1) for q in cells.get((key[0] + i, key[1] + j), [])]
        if all(math.dist(p, q) > _APART_M for q in near):
            cells.setdefault(key, []).append(p)
            kept.append(Sensor(name, float(p[0]), float(p[1])))
    return kept


def design_roads(
    network: Path,
    target: RoadTargetClass,
    *,
    off_max_s: float,
    on_min_s: float,
    footprint_m: float,
    spacing_m: float,
    poles: Path | None = None,
    count: int | None = None,
    height_m: float = 0.5,
    time_limit_s: float = 60.0,
    progress: Callable[[float], None] | None = None,
) -> Certified:
    """Place the fewest (or, where poles have costs, the cheapest) cameras that certify every road.

    With ``count``, the cameras are at most that many and the time out of view is as short as that allows: the largest
    margin for a given number.
    """
    site = read_road_site(network)
    sensors = list(read_sensors(poles, network, 0.0)) if poles is not None else candidates_of(site, spacing_m)
    costs = [s.cost for s in sensors]
    weight = np.array([1.0 if c is None else c for c in costs]) if any(c is not None for c in costs) else None
    views = sensor_views(sensors, footprint_m)
    cover = cover_roads(site.roads, views, height_m, target.extent_m)

    def place(off_s: float) -> Placement:
        return place_cameras(
            site.roads, cover, len(sensors), target, off_s, on_min_s, weight, time_limit_s=time_limit_s
        )

    found = place(off_max_s)
    if count is not None:
        found, off_max_s = _with_count(place, found, count, off_max_s, progress)
    chosen = [sensors[k] for k in found.chosen.tolist()]
    report: dict[str, Any] = {
        **found.as_dict(),
        "cameras": [{"name": s.name, "x": s.x_m, "y": s.y_m} for s in chosen],
        "optimal": found.optimal,
        "candidates": len(sensors),
        "rounds": found.rounds,
        "unseen_ways": found.ways,
        "off_max_s": off_max_s,
        "on_min_s": on_min_s,
        "roads_km": float(site.roads.length_m.sum() / 1000.0),
        "target_class": f"road-bound, {target.v_lo_mps:g} to {target.v_max_mps:g} m/s",
    }
    checked = _check(site, chosen, target, footprint_m, height_m, off_max_s)
    # ways of the final network that end where the roads end are no transitions; all others must be certified
    report["certified"] = bool(found.certified and checked.report["certified"])
    report["check"] = checked.report
    return Certified(report, checked.views, checked.lines)


def _with_count(
    place: Callable[[float], Placement],
    first: Placement,
    count: int,
    off_max_s: float,
    progress: Callable[[float], None] | None,
) -> tuple[Placement, float]:
    """Shorten the time out of view by bisection as long as ``count`` cameras are enough."""
    if len(first.chosen) > count:
        raise CertificateError(
            f"--count {count}: {off_max_s:g} s out of view need {len(first.chosen)} cameras (at least "
            f"{first.lower_bound:g}); allow more cameras or a longer time"
        )
    best, low, high = first, 0.0, off_max_s
    for k in range(_ROUNDS):
        middle = 0.5 * (low + high)
        try:
            found = place(middle)
        except CertificateError:  # not even all candidates are enough
            low = middle
            continue
        if len(found.chosen) <= count:
            best, high = found, middle
        else:
            low = middle
        if progress is not None:
            progress((k + 1) / _ROUNDS)
    return best, high


def _check(
    site: RoadSite,
    chosen: Sequence[Sensor],
    target: RoadTargetClass,
    footprint_m: float,
    height_m: float,
    off_max_s: float,
) -> Certified:
    """Certify the chosen cameras anew."""
    views = sensor_views(chosen, footprint_m)
    names = [s.name for s in chosen]
    report, gaps, tables = certify_road_site(
        site.roads, views, names, target, height_m=height_m, off_max_s=off_max_s, on_min_s=0.0
    )
    table = tables["sound"]
    good = bool(table.certified.all() and not gaps.cyclic.any())
    ground = ground_views(views, names, height_m, target.extent_m)
    outlines = [ring for g in ground for ring in g.rings]
    lines = road_lines(road_segments_with_verdict(site.roads, gaps, table))
    words = {"transitions": len(report["transitions"]), "certified": good}  # type: ignore[arg-type]
    return Certified(words, outlines, lines)


def repair_roads(
    network: Path,
    cameras: Path,
    target: RoadTargetClass,
    *,
    off_max_s: float,
    on_min_s: float,
    footprint_m: float,
    height_m: float = 0.5,
) -> dict[str, Any]:
    """Return for every uncertified way between two cameras the single changes that certify it, the cheapest first."""
    site, sensors = read_road_site(network), read_sensors(cameras, network)
    views = sensor_views(sensors, footprint_m)
    gaps = road_gaps(site.roads, cover_roads(site.roads, views, height_m, target.extent_m))
    seen = gaps.stretches
    worst: dict[tuple[str, str], tuple[float, list[Repair]]] = {}
    for k in range(len(gaps.longest_m)):
        chord = float(seen.chord_m[gaps.entry_stretch[k]])
        repairs = smallest_repairs(float(gaps.longest_m[k]), chord, target, off_max_s, on_min_s)
        key = (
            sensors[int(seen.exit_camera[gaps.exit_stretch[k]])].name,
            sensors[int(seen.entry_camera[gaps.entry_stretch[k]])].name,
        )
        length = float(gaps.longest_m[k])
        hopeless = not math.isfinite(length)
        if (repairs or hopeless) and (key not in worst or length > worst[key][0]):
            worst[key] = (length, [] if hopeless else repairs)
    return {
        "count": len(sensors),
        "certified": not worst and not bool(gaps.cyclic.any()),
        "repairs": [
            {
                "from": a,
                "to": b,
                "longest_m": length if math.isfinite(length) else None,
                "changes": [
                    {"change": r.change, "amount": r.amount, "unit": r.unit, "cost": r.cost} for r in rs
                ]
                or [
                    {
                        "change": "break the unseen circle of roads with a camera",
                        "amount": 1,
                        "unit": "cameras",
                        "cost": 1.0,
                    }
                ],
            }
            for (a, b), (length, rs) in sorted(worst.items(), key=lambda item: item[1][0])
        ],
    }
