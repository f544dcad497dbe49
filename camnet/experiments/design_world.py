"""Place cameras on a site's walls and poles so that the world's targets are never out of view for longer than allowed.

Candidates are every camera of a catalogue at every mount in many directions; each is looked at along every way of the
targets as the certifier does (``certification.ways``). The cheapest set is a hitting set (``certification.design``).
The answer is written as a world and certified from that world anew: a contradiction is an error.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from camnet.certification.coverage import Coverage, Views
from camnet.certification.design import Placement, place_cameras
from camnet.certification.way_limits import LimitedWays, reachable_arcs, ways_as_one
from camnet.certification.way_search import coverage_rows
from camnet.certification.ways import Ways, cover_ways, join_coverage
from camnet.config.catalogue import CatalogueCamera
from camnet.config.models import FixedCamera, Scenario
from camnet.errors import CertificateError, ConfigError
from camnet.experiments.certified import Certified
from camnet.experiments.certify_world import limit_of
from camnet.experiments.design_changes import (
    FREE,
    Prices,
    change_prices,
    changed_cameras,
    changes_of,
    words_of_change,
)
from camnet.experiments.design_confirm import check_failures, confirm
from camnet.experiments.design_mounts import ADD, Candidates, candidates_at
from camnet.experiments.design_private import keep_private
from camnet.experiments.design_roads import best_placement
from camnet.experiments.promise_world import (
    Limit,
    fixed_views,
    less_detections,
    seen_ways,
    solids_of,
    target_features,
    watch,
)
from camnet.experiments.restate import restate_pixels
from camnet.experiments.site_ways import SiteWays, site_ways
from camnet.geometry.mount_tolerance import MountTolerance
from camnet.geometry.pixel_density import pixels_per_metre
from camnet.geometry.settings import CameraModel, FixedPose
from camnet.importers.geojson_areas import NamedArea
from camnet.importers.mounts import Mount
from camnet.types import Array, IntArray

__all__ = ["DesignedWorld", "design_world"]

#: the solver asks for this share less than what is allowed, so that halvings of a tenth of a millimetre never decide
_SPARE = 1e-4
#: candidates that are looked at in one go
_BLOCK = 500


@dataclass(frozen=True, eq=False)
class DesignedWorld:
    """A design: the report, its certificate, and the world with the cameras in it."""

    report: dict[str, Any]
    certified: Certified
    scenario: Scenario


def design_world(
    scenario: Scenario,
    mounts: Sequence[Mount],
    catalogue: Sequence[CatalogueCamera],
    *,
    pixel_class: str | None = None,
    off_max_s: float | None = None,
    unseen_max_m: float | None = None,
    keep: bool = True,
    movable: Prices | None = None,
    objective: str | None = None,
    count: int | None = None,
    budget: float | None = None,
    survive: int = 0,
    private: Sequence[NamedArea] = (),
    tolerance: MountTolerance | None = None,
    aim_step_deg: float = 15.0,
    effort: float = 1.0,
    time_limit_s: float = math.inf,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> DesignedWorld:
    """Choose cameras, places and directions for a world.

    Parameters
    ----------
    scenario : the world; its fixed cameras stay (``keep``) or are taken away
    movable : what it costs to turn or move a camera that stays; None: nobody touches them
    mounts, catalogue : where cameras may be, and which
    pixel_class : what an image must show of a target that counts as seen, of EN 62676-4:2015; it decides how far each
        camera sees, those that stand too. None: ``detect`` for the catalogue, and those that stand as they are
    off_max_s, unseen_max_m : longest time and way out of view; None: the world's
    objective : ``cheapest`` (default), ``fewest``, or ``margin``: the shortest out of view with at most ``count``
        cameras, within ``budget``, or with the fewest that keep the limit
    count, budget : most cameras, and most money, that may be added
    survive : the limit is kept after any so many cameras fail
    private : areas that no camera may see (``design_private``)
    tolerance : the limit is kept, and private areas are not seen, wherever within it added cameras are installed
    aim_step_deg : between two directions of a candidate, degrees
    effort, time_limit_s, seed, progress : of ``place_cameras``

    Raises
    ------
    CertificateError
        Not even all candidates are enough, or the certifier does not confirm the answer.
    """
    if budget is not None and (count is not None or objective == "fewest"):
        other = f"--count {count}" if count is not None else "--objective fewest"
        raise ConfigError(f"--budget {budget:g} with {other}: money bounds the price; give one of them")
    if pixel_class is not None and keep:
        scenario = restate_pixels(scenario, pixel_class)
    sites = site_ways(scenario)
    limit = limit_of(scenario, off_max_s, unseen_max_m)
    _ask_for_something(sites, limit)
    models = [camera.model(pixels_per_metre(pixel_class or "detect")) for camera in catalogue]
    candidates = candidates_at(mounts, models, aim_step_deg)
    standing = scenario.fixed_cameras if keep else ()
    changes = None
    if movable is not None and standing:
        changes = changes_of(standing, scenario.cameras, mounts, aim_step_deg, len(models))
        candidates = Candidates.joined([candidates, changes.candidates])
        models, mounts = [*models, *changes.models], [*mounts, *changes.mounts]
    tried = len(candidates)
    if private:
        candidates = keep_private(candidates, models, sites[0].network, private, keep, tolerance)
    bought = np.r_[[c.price for c in catalogue], np.zeros(len(models) - len(catalogue))]
    price = bought[candidates.model] + change_prices(candidates, mounts, movable or Prices())
    seeing, parts = _look(sites, candidates, models, bool(standing), limit, tolerance)
    roads, cover = ways_as_one(parts)
    n = len(seeing)
    there = n + np.arange(len(standing))
    by_count = objective == "fewest" or count is not None or (objective == "margin" and budget is None)
    as_they_are = np.full(len(there), 1.0 if changes is None else FREE)
    weight = np.r_[np.ones(n) if by_count else price[seeing], as_they_are]
    at_most = [] if changes is None else changes.at_most(candidates, seeing)

    needed_of: dict[tuple[int, ...], IntArray] = {}

    def place(share: float) -> Placement:
        found = place_cameras(
            roads, cover, n + len(there), share * (1.0 - _SPARE), costs=weight,
            standing=there if changes is None else None, survive=survive, at_most=at_most,
            exact_limit=len(weight), effort=effort, time_limit_s=time_limit_s, seed=seed, progress=progress,
        )  # fmt: skip
        new = found.chosen[found.chosen < n]
        needed_of[tuple(new.tolist())] = found.chosen[found.chosen >= n] - n
        return replace(found, chosen=new, cost=round(found.cost, 6))

    found, share = best_placement(place, 1.0, count, objective, budget)
    needed = needed_of[tuple(found.chosen.tolist())]
    chosen = seeing[found.chosen]
    stays, names = np.arange(len(standing)), dict[int, str]()
    after: Sequence[FixedCamera] = standing
    if changes is not None:
        after, names, left = changed_cameras(standing, changes, candidates, chosen, needed)
        stays = np.array(left, dtype=np.int64)
    added = chosen[candidates.kind[chosen] == ADD]
    designed = world_with(scenario, candidates, mounts, models, added, after, limit)
    certified = confirm(designed, limit, share)
    failures = check_failures(designed, limit, share, survive) if survive else None
    held = np.r_[found.chosen, n + stays]
    installed = None if tolerance is None else _installed(parts, held, tolerance)
    cameras = [_row(candidates, mounts, models, price, k) for k in chosen.tolist()]
    own = iter(designed.fixed_cameras[len(after) :])
    for row, k in zip(cameras, chosen.tolist(), strict=True):
        row["name"] = names[k] if k in names else next(own).name
    report: dict[str, Any] = {
        "promise": certified.report["promise"],
        **found.as_dict(),
        "certified": certified.report["promise"]["verdict"] == "certified",
        "optimal": found.optimal,
        "objective": objective or ("margin" if count is not None else "cheapest"),
        "minimised": "cameras" if by_count else "price",
        "price": float(price[chosen].sum()),
        "budget": budget,
        "cameras": cameras,
        "standing": [standing[j].name for j in stays.tolist()],
        "mounts": len(mounts) - (0 if changes is None else len(changes.mounts)),
        "candidates": tried,
        "candidates_that_may": len(candidates),
        "candidates_that_see": n,
        "survive": survive,
        "after_failures": failures,
        "with_installation_error": installed,
        "private": [area.name for area in private],
        "pixel_class": pixel_class or "detect",
        "pixels_per_m": pixels_per_metre(pixel_class or "detect"),
        "limit_m": limit.off_m,
        "limit_s": limit.off_s,
        "limit_source": limit.source,
        "share_of_limit": share,
        "target_class": certified.report["target_class"],
    }
    if scenario.certificate.detection is not None:
        report["detection"] = scenario.certificate.detection.model_dump()
    return DesignedWorld(report, certified, designed)


def _ask_for_something(sites: Sequence[SiteWays], limit: Limit) -> None:
    """Refuse limits that no way of a class exceeds: no camera would be asked for, and nobody would see the target."""
    for site in sites:
        for ways in site.ways:
            reach = reachable_arcs(ways)
            endless = len(ways.roads.successor) > 0 and bool(np.diff(ways.roads.successor_ptr)[reach].any())
            length = float(ways.roads.length_m[reach].sum())
            arcs = np.arange(ways.roads.n_arcs)
            seconds = float(ways.time(arcs, ways.roads.length_m)[reach].sum())
            if endless or length > (limit.off_m or np.inf) or seconds > (limit.off_s or np.inf):
                continue
            raise ConfigError(
                f"what is allowed out of view ({limit.source}) is more than the whole way of {', '.join(site.names)}, "
                f"{length:.4g} m in {seconds:.4g} s: nothing asks for a camera; allow less"
            )


def _look(
    sites: Sequence[SiteWays],
    candidates: Candidates,
    models: Sequence[CameraModel],
    with_standing: bool,
    limit: Limit,
    tolerance: MountTolerance | None,
) -> tuple[IntArray, list[LimitedWays]]:
    """Return the candidates that see something, and what each sees of all ways; standing cameras come after them."""
    everything = np.arange(len(candidates))
    found: list[tuple[Ways, Coverage, Coverage | None]] = []
    for site in sites:
        features, solids = target_features(site.network), solids_of(site.network)
        grown = solids if tolerance is None else solids.grown(tolerance.position_m)
        views, _ = fixed_views(site.network)
        for ways in site.ways:
            cover = _cover(ways, candidates, models, everything, grown, features, tolerance)
            cover = less_detections(site.network, ways, cover)
            own = None
            if with_standing and views is not None:
                own = seen_ways(site.network, ways, views, solids, features)
            found.append((ways, cover, own))
    seeing = np.unique(np.concatenate([cover.camera for _, cover, _ in found]))
    if len(seeing) == 0:
        raise CertificateError(
            f"none of the {len(candidates)} candidates sees any way: are the mounts in the world's metres, "
            "and do they look at the ways?"
        )
    number = np.zeros(len(candidates), dtype=np.int64)
    number[seeing] = np.arange(len(seeing))
    parts = []
    for ways, cover, own in found:
        numbered = Coverage(
            cover.arc, number[cover.camera], cover.start_m, cover.end_m, cover.depth_m, cover.deepest_m
        )
        both = numbered if own is None else join_coverage(numbered, own, len(seeing))
        parts.append(LimitedWays(ways, both, limit.off_m, limit.off_s))
    return seeing, parts


def _cover(
    ways: Ways,
    candidates: Candidates,
    models: Sequence[CameraModel],
    rows: IntArray,
    solids: Any,  # noqa: ANN401 - Solids
    features: Array,
    tolerance: MountTolerance | None,
) -> Coverage:
    """Look along the ways with all candidates, some at a time."""
    whole: Coverage | None = None
    parts: list[tuple[Coverage, int]] = []
    for first in range(0, len(rows), _BLOCK):
        views: Views = candidates.views(models, rows[first : first + _BLOCK], tolerance)
        parts.append((cover_ways(ways, views, solids, features), first))
    names = ("arc", "start_m", "end_m", "depth_m", "deepest_m")
    arc, start, end, depth, at = (np.concatenate([getattr(c, n) for c, _ in parts]) for n in names)
    camera = np.concatenate([c.camera + first for c, first in parts])
    order = np.lexsort((start, arc))
    whole = Coverage(arc[order], camera[order], start[order], end[order], depth[order], at[order])
    return whole


def world_with(
    scenario: Scenario,
    candidates: Candidates,
    mounts: Sequence[Mount],
    models: Sequence[CameraModel],
    chosen: IntArray,
    standing: Sequence[FixedCamera],
    limit: Limit,
) -> Scenario:
    """Return the world with the cameras that stand and the chosen ones, what is allowed out of view stated in it."""
    used = {camera.camera for camera in standing}
    kinds = {model.name: model for model in scenario.cameras if model.name in used}
    model_of: dict[int, str] = {}
    taken = {camera.name for camera in standing}
    added = []
    for k in chosen.tolist():
        number = int(candidates.model[k])
        if number not in model_of:
            name = _free_name(models[number].name, kinds)
            model_of[number] = name
            kinds[name] = models[number].model_copy(update={"name": name})
        name = _free_name(mounts[int(candidates.mount[k])].name.replace(" ", "_"), taken)
        taken.add(name)
        place = tuple(candidates.position_m[k].tolist())
        look = tuple(candidates.look_at_m[k].tolist())
        pose = FixedPose(position_m=place, look_at_m=look)
        added.append(FixedCamera(name=name, camera=model_of[number], pose=pose))
    change: dict[str, Any] = {
        "name": f"{scenario.name}_design",
        "cameras": tuple(kinds.values()),
        "fixed_cameras": (*standing, *added),
    }
    if limit.off_s is not None:
        change["certificate"] = scenario.certificate.model_copy(update={"off_max_s": limit.off_s})
    return scenario.model_copy(update=change)


def _free_name(name: str, taken: Any) -> str:  # noqa: ANN401 - anything with names in it
    if name not in taken:
        return name
    return next(f"{name}_{k}" for k in itertools.count(2) if f"{name}_{k}" not in taken)


def _installed(parts: Sequence[LimitedWays], chosen: IntArray, tolerance: MountTolerance) -> dict[str, Any]:
    """Return the longest stretches out of view, wherever within the tolerance the chosen cameras are installed."""
    held = [
        watch(
            p.ways,
            coverage_rows(p.coverage, np.isin(p.coverage.camera, chosen)),
        )
        for p in parts
    ]
    return {
        "position_m": tolerance.position_m,
        "angle_deg": tolerance.angle_deg,
        "unseen_max_m": max(w.in_m.longest[0] for w in held),
        "unseen_max_s": max(w.in_s.longest[0] for w in held),
    }


def _row(
    candidates: Candidates, mounts: Sequence[Mount], models: Sequence[CameraModel], price: Array, k: int
) -> dict[str, Any]:
    x, y, z = candidates.position_m[k].tolist()
    mount = mounts[int(candidates.mount[k])]
    return {
        "name": mount.name,
        "change": words_of_change(int(candidates.kind[k])),
        "camera": models[int(candidates.model[k])].name,
        "mount": mount.name,
        "x": x,
        "y": y,
        "z": z,
        "pan_deg": (float(candidates.pan_deg[k]) + 180.0) % 360.0 - 180.0,
        "tilt_deg": float(candidates.tilt_deg[k]),
        "price": float(price[k]),
    }
