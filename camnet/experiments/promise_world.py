"""The promise of a world file for fixed cameras: what the simulator's own visibility says along every way.

The promise is the worst over the roads as drawn and as driven (``world_ways``). Both are needed: a driver cuts corners,
and the certificate speaks of everybody on the road.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from camnet.certification.blind import blind_cameras
from camnet.certification.coverage import Coverage, Views
from camnet.certification.detection import detected, time_in_view_s
from camnet.certification.planar_shapes import convex_solids
from camnet.certification.promise import BlindCamera, Promise, UnseenWay
from camnet.certification.road_gaps import SeenStretches, merge_coverage
from camnet.certification.sight_lines import Solids
from camnet.certification.site import views_of
from camnet.certification.unseen import UnseenWays, longest_unseen
from camnet.certification.ways import Ways, cover_ways, seen_arcs
from camnet.geometry.frustum import Frustum
from camnet.simulation.network import Network
from camnet.types import Array, BoolArray, IntArray

__all__ = [
    "Limit",
    "Watched",
    "fixed_views",
    "less_detections",
    "promise_of",
    "seen_ways",
    "solids_of",
    "target_features",
    "watch",
]


@dataclass(frozen=True, slots=True)
class Limit:
    """What is allowed out of view: metres, seconds, and where the figures come from."""

    off_m: float | None = None
    off_s: float | None = None
    source: str = "stated"


@dataclass(frozen=True, eq=False)
class Watched:
    """Ways with what is seen of them.

    Attributes
    ----------
    ways, coverage, stretches : the ways, the views along them, and the union of these
    in_m, in_s : longest unseen stretches
    """

    ways: Ways
    coverage: Coverage
    stretches: SeenStretches
    in_m: UnseenWays
    in_s: UnseenWays


def fixed_views(network: Network) -> tuple[Views | None, list[str]]:
    """Return the views of the fixed cameras, None without any, and their names."""
    specs = network.description.cameras
    if not specs:
        return None, []
    frusta = [Frustum.from_camera(c.camera).in_world(c.p_world, c.q_world) for c in specs]
    return views_of(frusta, np.array([c.p_world for c in specs])), [c.name for c in specs]


def solids_of(network: Network) -> Solids:
    """Return the world's occluders as convex solids; none of them is smaller than the occluder."""
    return Solids.of([part for occluder in network.occluders for part in convex_solids(occluder)])


def target_features(network: Network) -> Array:
    """Return the feature points (F, 3) of the network's first target, in its frame, m."""
    return np.asarray(network.description.targets[0].features_m, dtype=float)


def seen_ways(network: Network, ways: Ways, views: Views, solids: Solids, features: Array) -> Coverage:
    """Return what fixed cameras see of ways, less what detections take (``certificate.detection``)."""
    return less_detections(network, ways, cover_ways(ways, views, solids, features))


def less_detections(network: Network, ways: Ways, coverage: Coverage) -> Coverage:
    """Return what counts as seen of what is in view of fixed cameras."""
    settings = network.scenario.certificate.detection
    if settings is None:
        return coverage
    fastest = max(t.motion.v_max_mps for t in network.description.targets)
    return detected(coverage, ways.roads, fastest * time_in_view_s(settings))


def watch(ways: Ways, coverage: Coverage) -> Watched:
    """Find the longest unseen stretches of ways of which ``coverage`` is seen."""
    seen = merge_coverage(ways.roads, coverage)
    parts = Coverage(seen.arc, seen.entry_camera, seen.start_m, seen.end_m, seen.depth_m, seen.deepest_m)
    in_m, in_s = (
        longest_unseen(seen_arcs(ways, parts, seen.entry_camera, seen.exit_camera, in_time))
        for in_time in (False, True)
    )
    return Watched(ways, coverage, seen, in_m, in_s)


def watch_fixed(network: Network, ways: Ways) -> Watched:
    """Watch ways with the fixed cameras of a network."""
    views, _ = fixed_views(network)
    if views is None:
        none = np.zeros(0)
        integers: IntArray = np.zeros(0, dtype=np.int64)
        return watch(ways, Coverage(integers, integers, none, none, none, none))
    return watch(ways, seen_ways(network, ways, views, solids_of(network), target_features(network)))


def promise_of(
    watched: Sequence[Watched],
    names: list[str],
    *,
    target_class: str,
    targets: Sequence[str],
    limit: Limit,
    at_once: int | None,
    span: str,
    blind: tuple[BlindCamera, ...] = (),
    refusals: tuple[str, ...] = (),
) -> Promise:
    """Return the promise over ways that have been watched in several forms: the worst of them."""
    worst_m = max(watched, key=lambda w: w.in_m.longest[0])
    worst_s = max(watched, key=lambda w: w.in_s.longest[0])
    who = ", ".join(targets)
    longest = _record(worst_s, worst_s.in_s.longest, names, who)
    into = max((w for w in watched), key=lambda w: w.in_s.into_first[0])
    first = _record(into, into.in_s.into_first, names, who)
    unseen_by_all = tuple(targets) if not all(w.in_m.some_seen for w in watched) else ()
    length_m, length_s = worst_m.in_m.longest[0], worst_s.in_s.longest[0]
    return Promise(
        target_class=target_class,
        unseen_max_m=length_m,
        unseen_max_s=length_s,
        longest=longest if length_s > 0.0 else None,
        into_first=first if into.in_s.into_first[0] > 0.0 else None,
        targets=tuple(targets),
        at_once=at_once,
        served=None,
        cameras=len(names),
        limit_m=limit.off_m,
        limit_s=limit.off_s,
        limit_source=limit.source,
        span=span,
        nobody_sees=unseen_by_all,
        never_seen_m=watched[0].in_m.never_seen,
        blind=blind,
        refusals=refusals,
    )


def _record(w: Watched, found: tuple[float, str, int, int], names: list[str], who: str) -> UnseenWay:
    """Turn a stretch in seconds into a record with its metres; the same kind of stretch in metres where they differ."""
    time, kind, before, after = found
    same = w.in_m.into_first if found is w.in_s.into_first else w.in_m.longest
    reason = ""
    if not np.isfinite(time):
        reason = "unseen ways lead in a circle: the target may stay on them for ever"
    return UnseenWay(
        kind,
        same[0],
        time,
        names[before] if before >= 0 else None,
        names[after] if after >= 0 else None,
        who,
        reason,
    )


def blind_of(network: Network, watched: Watched) -> tuple[BlindCamera, ...]:
    """Return the fixed cameras that see none of the reachable ways, with the likely reasons."""
    views, names = fixed_views(network)
    if views is None:
        return ()
    sees = _seeing(watched.coverage, watched.in_m.reachable, len(names))
    if sees.all():
        return ()
    short: tuple[BlindCamera, ...] = ()
    if network.scenario.certificate.detection is not None:
        looked = cover_ways(watched.ways, views, solids_of(network), target_features(network))
        before, sees = sees, _seeing(looked, watched.in_m.reachable, len(names))
        words = "no target is in its view for as long as the detections take"
        short = tuple(BlindCamera(names[k], words) for k in np.flatnonzero(sees & ~before))
    would = None
    if network.occluders:
        free = cover_ways(watched.ways, views, Solids.of([]), target_features(network))
        would = _seeing(free, watched.in_m.reachable, len(names))
    owner = np.repeat(np.arange(watched.ways.roads.n_arcs), np.diff(watched.ways.sample_ptr))
    places = watched.ways.xy[watched.in_m.reachable[owner]]
    return (*short, *blind_cameras(names, views, places, 0.0, sees, would))


def _seeing(coverage: Coverage, reachable: BoolArray, cameras: int) -> BoolArray:
    out = np.zeros(cameras, dtype=bool)
    out[coverage.camera[reachable[coverage.arc]]] = True
    return out


def with_blind(promise: Promise, blind: tuple[BlindCamera, ...]) -> Promise:
    """Return a promise that names blind cameras."""
    return replace(promise, blind=blind)
