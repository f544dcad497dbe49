"""Certify a world whose target is bound to roads, with fixed cameras or with agents in operating regions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from camnet.certification.coverage import Coverage
from camnet.certification.free_network import GroundView
from camnet.certification.model_error import Conformal, ModelError
from camnet.certification.planar_shapes import cover_regions
from camnet.certification.promise import with_claims
from camnet.certification.road_gaps import RoadGaps, road_gaps
from camnet.certification.site import certify_road_site, road_segments_with_verdict
from camnet.certification.transitions import GrowthModel, RoadTargetClass
from camnet.certification.ways import Ways, join_coverage
from camnet.errors import CertificateError
from camnet.experiments.certified import Certified, dwell_times
from camnet.experiments.certify_flow import ground_of
from camnet.experiments.promise_mobile import apply_refusals, mobile_road_promise
from camnet.experiments.promise_world import (
    Limit,
    Watched,
    blind_of,
    fixed_views,
    promise_of,
    seen_ways,
    solids_of,
    target_features,
    watch,
    watch_fixed,
)
from camnet.experiments.published_world import published_on_ways
from camnet.experiments.world_ways import drawn_ways, driven_ways, wander_m
from camnet.motion.road import RoadMotion
from camnet.report.certificate import MapLine
from camnet.simulation.certificates import feature_extent, view_radius
from camnet.simulation.network import Network
from camnet.types import Array, BoolArray

__all__ = ["ROAD_E0_M", "RoadWorld", "certify_on_roads", "road_lines", "road_world"]

#: position error when a target is lost, unless the world says otherwise, m
ROAD_E0_M = 0.05
#: places of a stretch at which the room in its view is measured
_PLACES = 33


@dataclass(frozen=True, eq=False)
class RoadWorld:
    """What the certificate of road-bound targets is about, shared by certifier and falsifier.

    Attributes
    ----------
    network : with one of the targets
    motions : of all targets of the class
    target : the class
    ground : views and regions on the ground
    watched : the roads as drawn, with what is seen of them
    gaps : transitions that a target can take
    """

    network: Network
    motions: Sequence[RoadMotion]
    target: RoadTargetClass
    ground: list[GroundView]
    watched: Watched
    gaps: RoadGaps


def road_world(network: Network, motions: Sequence[RoadMotion]) -> RoadWorld:
    """Watch the roads of a world; agents see their whole regions here, which the promise does not take for granted."""
    slow, fast = motions[0].speed_mps
    target = RoadTargetClass(slow, fast, feature_extent(network) + wander_m(motions[0].lateral_std_m))
    ground = ground_of(network)
    ways = drawn_ways(network, motions, slow)
    watched = watch(ways, _coverage(network, ways, ground, target.extent_m))
    coverage = _only(watched.coverage, watched.in_m.reachable)
    watched = Watched(ways, coverage, watched.stretches, watched.in_m, watched.in_s)
    return RoadWorld(network, motions, target, ground, watched, road_gaps(ways.roads, coverage))


def certify_on_roads(
    network: Network,
    motions: Sequence[RoadMotion],
    names: Sequence[str],
    model_error_mps: ModelError,
    limit: Limit,
    *,
    on_min_s: float | None = None,
    at_once: int,
) -> Certified:
    """Certify a network on its own roads for targets ``names`` of one class, ``at_once`` of them at the same time."""
    case = road_world(network, motions)
    off, on, source = dwell_times(network)
    growth = None
    if isinstance(model_error_mps, Conformal):
        raise CertificateError(
            "--model-error conformal: targets on roads have no learned flow to calibrate; state the error in m/s"
        )
    if model_error_mps is not None:
        e0 = network.scenario.certificate.initial_error_m
        # whoever loses a target may be off itself
        own = max((network.own_error_m(j) for j in range(network.n_agents)), default=0.0)
        growth = GrowthModel((ROAD_E0_M if e0 is None else e0) + own, model_error_mps)
    report, gaps, tables = certify_road_site(
        case.watched.ways.roads,
        None,
        [g.name for g in case.ground],
        case.target,
        height_m=0.0,
        off_max_s=limit.off_s,
        off_max_m=limit.off_m,
        on_min_s=on_min_s,
        growth=growth,
        coverage=case.watched.coverage,
        dwell=(off, on),
        constants={
            "off_max_s": limit.off_s,
            "off_max_m": limit.off_m,
            "on_min_s": on_min_s or 0.0,
            "limit_source": limit.source,
            "dwell_off_max_s": off,
            "dwell_on_min_s": on,
            "dwell_source": source,
            "extent_m": case.target.extent_m,
        },
    )
    if off is None:
        report["certificates"]["sound"] |= {"verdict": "unsatisfiable"}  # type: ignore[index]
    target_class = f"road-bound, {case.target.v_lo_mps:g} to {case.target.v_max_mps:g} m/s"
    if network.n_agents > 0:
        promise = mobile_road_promise(case, tables, limit, names, at_once=at_once, target_class=target_class)
    else:
        report["certificates"]["published"] = published_on_ways(network, case.watched, case.ground)  # type: ignore[index]
        forms = [case.watched, watch_fixed(network, driven_ways(motions, case.target.v_lo_mps))]
        promise = promise_of(
            forms,
            [g.name for g in case.ground],
            target_class=target_class,
            targets=names,
            limit=limit,
            at_once=at_once,
            span="from where it begins on its road, for ever",
            blind=blind_of(network, case.watched),
        )
    outlines = [ring for g in case.ground for ring in g.rings]
    pieces = road_segments_with_verdict(
        case.watched.ways.roads, gaps, tables["unseen"], promise.verdict == "certified"
    )
    lines = apply_refusals(report, road_lines(pieces), promise)
    return Certified(with_claims(report, promise), outlines, lines, promise)


def road_lines(pieces: dict[str, list[Array]]) -> list[MapLine]:
    """Return the lines of a road map."""
    verdicts = {"seen": "seen", "certified": "certified", "uncertified": "not certified"}
    words = {
        "seen": "in view",
        "certified": "unseen, within what is allowed",
        "uncertified": "unseen for too long",
    }
    return [MapLine(line, verdicts[k], words[k]) for k, lines in pieces.items() for line in lines]


def _coverage(network: Network, ways: Ways, ground: Sequence[GroundView], extent_m: float) -> Coverage:
    """Return what each camera sees of the ways: agents their regions, fixed cameras what the simulator shows them."""
    agents = range(network.n_agents)
    outlines = [network.regions[j].footprint() for j in agents]
    part = cover_regions(ways.roads, outlines, extent_m, [view_radius(network, j) for j in agents])
    views, _ = fixed_views(network)
    if views is None:
        return part
    seen = seen_ways(network, ways, views, solids_of(network), target_features(network))
    return join_coverage(part, _with_room(seen, ways, ground[network.n_agents :]), network.n_agents)


def _with_room(coverage: Coverage, ways: Ways, ground: Sequence[GroundView]) -> Coverage:
    """Measure the largest disc that fits each stretch's view."""
    shares = np.linspace(0.0, 1.0, _PLACES)
    depth, deepest = np.zeros(len(coverage.arc)), coverage.deepest_m.copy()
    for k, camera in enumerate(coverage.camera.tolist()):
        at = coverage.start_m[k] + shares * (coverage.end_m[k] - coverage.start_m[k])
        places, _ = ways.pose(np.full(_PLACES, coverage.arc[k]), at)
        room = ground[camera].view.depth(places)
        best = int(np.argmax(room))
        depth[k], deepest[k] = max(float(room[best]), 0.0), at[best]
    return Coverage(coverage.arc, coverage.camera, coverage.start_m, coverage.end_m, depth, deepest)


def _only(coverage: Coverage, reachable: BoolArray) -> Coverage:
    """Return the stretches of arcs that a target can reach."""
    keep = reachable[coverage.arc]
    return Coverage(
        coverage.arc[keep],
        coverage.camera[keep],
        coverage.start_m[keep],
        coverage.end_m[keep],
        coverage.depth_m[keep],
        coverage.deepest_m[keep],
    )
