"""Certify a world whose target is bound to roads, with fixed cameras or with agents in operating regions."""

from __future__ import annotations

import numpy as np

from camnet.certification.coverage import Coverage, cover_roads
from camnet.certification.planar_shapes import cover_regions
from camnet.certification.road_arcs import RoadArcs, arcs_from_roads
from camnet.certification.site import certify_road_site, road_segments_with_verdict, views_of
from camnet.certification.transitions import GrowthModel, RoadTargetClass
from camnet.experiments.certified import Certified, dwell_times
from camnet.experiments.certify_flow import ground_of, solid_occluders
from camnet.geometry.frustum import Frustum
from camnet.motion.settings import RoadTarget
from camnet.report.certificate import MapLine
from camnet.simulation.certificates import feature_extent, view_radius
from camnet.simulation.network import Network
from camnet.types import Array

__all__ = ["certify_on_roads", "road_coverage", "road_lines"]


def certify_on_roads(network: Network, motion: RoadTarget, model_error_mps: float | None) -> Certified:
    """Certify a network on its own roads; views of mobile cameras are their regions."""
    scenario = network.scenario
    target = RoadTargetClass(*motion.speed_mps, feature_extent(network) + 2.0 * motion.lateral_std_m)
    roads = arcs_from_roads(
        [np.array(r.points_m, dtype=float) for r in scenario.roads], [r.closed for r in scenario.roads]
    )
    off, on, source = dwell_times(network)
    growth = None
    if model_error_mps is not None:
        e0 = scenario.certificate.initial_error_m
        growth = GrowthModel(0.05 if e0 is None else e0, model_error_mps)
    ground = ground_of(network)
    report, gaps, tables = certify_road_site(
        roads,
        None,
        [g.name for g in ground],
        target,
        height_m=0.0,
        off_max_s=off,
        on_min_s=on,
        growth=growth,
        coverage=road_coverage(network, roads, target.extent_m),
        constants={"off_max_s": off, "on_min_s": on, "dwell_source": source},
    )
    outlines = [ring for g in ground for ring in g.rings]
    pieces = road_segments_with_verdict(roads, gaps, tables["learned" if growth else "sound"])
    return Certified(report, outlines, road_lines(pieces))


def road_lines(pieces: dict[str, list[Array]]) -> list[MapLine]:
    """Return the lines of a road map."""
    verdicts = {"seen": "seen", "certified": "certified", "uncertified": "not certified"}
    return [MapLine(line, verdicts[k], verdicts[k]) for k, lines in pieces.items() for line in lines]


def road_coverage(network: Network, roads: RoadArcs, extent_m: float) -> Coverage:
    """Return what each camera sees of the roads: agents their regions, fixed cameras their views without shadows."""
    agents = range(network.n_agents)
    outlines = [network.regions[j].footprint() for j in agents]
    part = cover_regions(roads, outlines, extent_m, [view_radius(network, j) for j in agents])
    specs = network.description.cameras
    if not specs:
        return part
    frusta = [Frustum.from_camera(c.camera).in_world(c.p_world, c.q_world) for c in specs]
    views = views_of(frusta, np.array([c.p_world for c in specs]))
    seen = cover_roads(roads, views, 0.0, extent_m, solid_occluders(network))
    arc = np.concatenate([part.arc, seen.arc])
    start = np.concatenate([part.start_m, seen.start_m])
    order = np.lexsort((start, arc))
    camera = np.concatenate([part.camera, seen.camera + network.n_agents])
    others = (
        np.concatenate([getattr(part, name), getattr(seen, name)])[order]
        for name in ("end_m", "depth_m", "deepest_m")
    )
    return Coverage(arc[order], camera[order], start[order], *others)
