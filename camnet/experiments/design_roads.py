"""Place cameras over a city's roads (repairs of a network that stands: ``repair_roads``)."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from camnet.certification.coverage import cover_roads
from camnet.certification.design import Placement, place_cameras
from camnet.certification.free_network import ground_views
from camnet.certification.road_promise import target_words
from camnet.certification.site import certify_road_site, road_segments_with_verdict
from camnet.certification.transitions import RoadTargetClass
from camnet.errors import CertificateError, ConfigError
from camnet.experiments.certified import Certified
from camnet.experiments.certify_road_world import road_lines
from camnet.experiments.certify_site import read_sensors, sensor_views
from camnet.experiments.check_traffic import check_traffic, read_traffic
from camnet.experiments.road_site import RoadSite, read_road_site
from camnet.importers.sumo_detectors import Sensor
from camnet.types import Array

__all__ = ["best_placement", "candidates_of", "design_roads", "way_limit", "weights_of"]

#: candidates closer than this are one, m
_APART_M = 5.0
#: rounds of the search for the shortest way out of view
_ROUNDS = 8


def way_limit(target: RoadTargetClass, off_max_s: float | None, unseen_max_m: float | None) -> float:
    """Return the longest unseen way that keeps both limits, m: v_lo (T - t_stop) at most.

    Raises
    ------
    ConfigError
        Targets may stand still for as long as they may be out of view.
    """
    limit = math.inf if unseen_max_m is None else unseen_max_m
    if off_max_s is not None:
        if off_max_s <= target.stop_s:
            raise ConfigError(
                f"--off-max {off_max_s:g}: targets may stand still for --stop-s {target.stop_s:g} s while unseen; "
                "a longer time out of view is needed"
            )
        limit = min(limit, target.v_lo_mps * (off_max_s - target.stop_s))
    return limit


#: most candidate places along roads
_MOST_CANDIDATES = 1_000_000


def candidates_of(site: RoadSite, spacing_m: float) -> list[Sensor]:
    """Return the candidate places of a road network: its junctions, and points every ``spacing_m`` along its roads."""
    roads = site.roads
    count = len(site.junctions) + float(roads.length_m.sum()) / spacing_m
    if count > _MOST_CANDIDATES:
        raise ConfigError(
            f"--spacing {spacing_m:g}: {count:.4g} candidate places, more than {_MOST_CANDIDATES:,}: take more"
        )
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
    off_max_s: float | None,
    on_min_s: float,
    footprint_m: float,
    spacing_m: float,
    unseen_max_m: float | None = None,
    poles: Path | None = None,
    count: int | None = None,
    objective: str | None = None,
    height_m: float = 0.5,
    effort: float = 1.0,
    time_limit_s: float = math.inf,
    traffic: Path | None = None,
    own_limits: bool = False,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> Certified:
    """Place cameras that certify every lane and every turn of a road network.

    Parameters
    ----------
    network, target : SUMO network and class of the targets
    off_max_s, unseen_max_m : longest time and longest way out of view allowed; at least one is needed
    on_min_s : shortest view that counts, s
    footprint_m : side of a camera's view, m
    spacing_m, poles : candidates every ``spacing_m`` along the roads, or the places of a table
    count, objective : ``fewest`` cameras; ``cheapest``, where poles have costs; ``margin``: the shortest way out of
        view with at most ``count`` cameras, or with the fewest that certify the limit. None: ``margin`` with a count,
        else ``cheapest`` where poles have costs, else ``fewest``
    height_m : height of the targets' reference point, m
    effort, time_limit_s, seed, progress : of ``place_cameras``
    traffic : recorded or simulated traffic that the result is checked against
    own_limits : the targets' greatest speed is the network's highest speed limit
    """
    limit_m = way_limit(target, off_max_s, unseen_max_m)
    site = read_road_site(network)
    target = site.with_limits(target) if own_limits else target
    # a limit in seconds is one in metres at the least speed
    site = site if off_max_s is None else replace(site, roads=site.paced(target.v_lo_mps))
    sensors = list(read_sensors(poles, network, 0.0)) if poles is not None else candidates_of(site, spacing_m)
    weight = weights_of(sensors, objective)
    views = sensor_views(sensors, footprint_m)
    cover = cover_roads(site.roads, views, height_m, target.extent_m)

    def place(way_m: float) -> Placement:
        least_m = target.v_max_mps * on_min_s
        return place_cameras(
            site.roads, cover, len(sensors), way_m, least_m, weight, effort=effort, time_limit_s=time_limit_s,
            seed=seed, progress=progress,
        )  # fmt: skip

    found, limit_m = best_placement(place, limit_m, count, objective)
    chosen = [sensors[k] for k in found.chosen.tolist()]
    checked = _check(site, chosen, target, footprint_m, height_m, limit_m)
    if found.certified and checked.report["promise"]["verdict"] != "certified":
        raise CertificateError(
            f"the solver's answer for {limit_m:.6g} m does not pass the certifier: "
            f"{checked.report['promise']['sentence']}"
        )
    report: dict[str, Any] = {
        "promise": checked.report["promise"],
        **found.as_dict(),
        "cameras": [{"name": s.name, "x": s.x_m, "y": s.y_m} for s in chosen],
        "optimal": found.optimal,
        "candidates": len(sensors),
        "rounds": found.rounds,
        "unseen_ways": found.ways,
        "unseen_max_m": limit_m,
        "off_max_s": target.longest_time(limit_m),
        "on_min_s": on_min_s,
        "footprint_m": footprint_m,
        "roads_km": site.edges_km,
        "target_class": target_words(target),
        "certifier": {"transitions": len(checked.report["transitions"]), "certified": True},
    }
    if traffic is not None:
        tracks = read_traffic(traffic)
        seconds = None if off_max_s is None else target.longest_time(limit_m)
        report["check"] = check_traffic(
            tracks, sensor_views(chosen, footprint_m), site.roads, target, limit_m, seconds
        )
    return Certified(report, checked.views, checked.lines)


def weights_of(sensors: Sequence[Sensor], objective: str | None) -> Array | None:
    """Return what each candidate costs; None: one each.

    Raises
    ------
    ConfigError
        The cheapest set is asked for and no candidate has a cost.
    """
    costs = [s.cost for s in sensors]
    priced = any(c is not None for c in costs)
    if objective == "cheapest" and not priced:
        raise ConfigError("--objective cheapest: no candidate has a cost; give --poles with a column cost")
    if not priced or objective not in (None, "cheapest"):
        return None
    return np.array([1.0 if c is None else c for c in costs])


def best_placement(
    place: Callable[[float], Placement],
    limit: float,
    count: int | None,
    objective: str | None,
    budget: float | None = None,
) -> tuple[Placement, float]:
    """Return the placement for an objective, and the way (m) or time (s) out of view that it certifies.

    ``budget`` bounds the cost that ``place`` minimises, as ``count`` bounds the number of cameras.
    """
    if count is not None and objective not in (None, "margin"):
        raise ConfigError(
            f"--count {count} with --objective {objective}: a count goes with the objective margin"
        )
    found = place(limit)
    if count is not None and len(found.chosen) > count:
        raise CertificateError(
            f"--count {count}: what is allowed out of view needs {len(found.chosen)} cameras (at least "
            f"{found.lower_bound:g}); allow more cameras or more out of view"
        )
    if budget is not None and found.cost > budget:
        raise CertificateError(
            f"--budget {budget:g}: what is allowed out of view costs {found.cost:g} (at least {found.lower_bound:g}); "
            "allow more money, more out of view, or a longer --time-limit where the bound is lower"
        )
    if count is None and objective != "margin":
        return found, limit
    if budget is not None:
        return _shortest(place, found, lambda p: p.cost <= budget, limit)
    most = len(found.chosen) if count is None else count
    return _shortest(place, found, lambda p: len(p.chosen) <= most, limit)


def _shortest(
    place: Callable[[float], Placement],
    first: Placement,
    fits: Callable[[Placement], bool],
    limit: float,
) -> tuple[Placement, float]:
    """Shorten what is out of view by bisection as long as a placement fits."""
    best, low, high = first, 0.0, limit
    for _ in range(_ROUNDS):
        middle = 0.5 * (low + high)
        try:
            found = place(middle)
        except CertificateError:  # not even all candidates are enough
            low = middle
            continue
        if fits(found):
            best, high = found, middle
        else:
            low = middle
    return best, high


def _check(
    site: RoadSite,
    chosen: Sequence[Sensor],
    target: RoadTargetClass,
    footprint_m: float,
    height_m: float,
    limit_m: float,
) -> Certified:
    """Certify the chosen cameras anew."""
    views = sensor_views(chosen, footprint_m)
    names = [s.name for s in chosen]
    report, gaps, tables = certify_road_site(
        site.roads, views, names, target, height_m=height_m, off_max_s=None, off_max_m=limit_m, on_min_s=0.0
    )
    ground = ground_views(views, names, height_m, target.extent_m)
    outlines = [ring for g in ground for ring in g.rings]
    kept = report["promise"]["verdict"] == "certified"  # type: ignore[index]
    lines = road_lines(road_segments_with_verdict(site.roads, gaps, tables["unseen"], kept))
    return Certified(report, outlines, lines)
