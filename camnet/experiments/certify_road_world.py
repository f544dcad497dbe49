"""Certify a world whose target is bound to roads, with fixed cameras or with agents in operating regions."""

from __future__ import annotations

from typing import Any

import numpy as np

from camnet.certification.coverage import Views
from camnet.certification.road_arcs import arcs_from_roads
from camnet.certification.site import certify_road_site, road_segments_with_verdict, views_of
from camnet.certification.transitions import GrowthModel, RoadTargetClass
from camnet.errors import CertificateError
from camnet.experiments.certified import Certified, dwell_times
from camnet.experiments.certify_flow import ground_of
from camnet.geometry.frustum import Frustum
from camnet.motion.settings import RoadTarget
from camnet.report.certificate import MapLine
from camnet.simulation.certificates import feature_extent, view_radius
from camnet.simulation.network import Network
from camnet.types import Array

__all__ = ["certify_on_roads", "road_lines", "road_views"]


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
    names, views = road_views(network)
    occluders = [_half_spaces(o) for o in network.occluders] if network.n_agents == 0 else []
    limits = (
        None
        if network.n_agents == 0
        else np.array([view_radius(network, j) for j in range(network.n_agents)])
    )
    report, gaps, tables = certify_road_site(
        roads,
        views,
        names,
        target,
        height_m=0.0,
        off_max_s=off,
        on_min_s=on,
        growth=growth,
        occluders=occluders,
        largest_m=limits,
        constants={"off_max_s": off, "on_min_s": on, "dwell_source": source},
    )
    ground = ground_of(network)
    outlines = [(g.name, np.asarray(g.outline.exterior.coords)) for g in ground if not g.outline.is_empty]
    pieces = road_segments_with_verdict(roads, gaps, tables["learned" if growth else "sound"])
    return Certified(report, outlines, road_lines(pieces))


def road_lines(pieces: dict[str, list[Array]]) -> list[MapLine]:
    """Return the lines of a road map."""
    verdicts = {"seen": "seen", "certified": "certified", "uncertified": "not certified"}
    return [MapLine(line, verdicts[k], verdicts[k]) for k, lines in pieces.items() for line in lines]


def road_views(network: Network) -> tuple[list[str], Views]:
    """Return fields of view of fixed cameras, or the operating regions of agents as upright views."""
    if network.n_agents == 0:
        specs = network.description.cameras
        frusta = [Frustum.from_camera(c.camera).in_world(c.p_world, c.q_world) for c in specs]
        return [c.name for c in specs], views_of(frusta, np.array([c.p_world for c in specs]))
    ground = ground_of(network)
    faces = max(len(g.view.offsets) for g in ground)
    normals, offsets = np.zeros((len(ground), faces, 3)), np.zeros((len(ground), faces))
    corners = []
    for k, g in enumerate(ground):
        rows = np.arange(faces) % len(g.view.offsets)  # repeated faces change nothing
        normals[k, :, :2], offsets[k] = g.view.normals[rows], g.view.offsets[rows]
        x0, y0, x1, y1 = g.outline.bounds
        corners.append([[x0, y0, 0.0], [x1, y1, 0.0]])
    centres = np.array([r.center for r in network.regions])
    return [g.name for g in ground], Views.create(normals, offsets, np.array(corners), centres)


def _half_spaces(region: Any) -> tuple[Array, Array]:  # noqa: ANN401 - any solid with an outline
    """Return a convex solid as half-spaces."""
    corners = np.asarray(region.footprint(), dtype=float)
    centre = corners.mean(axis=0)
    along = np.roll(corners, -1, axis=0) - corners
    normals = np.c_[along[:, 1], -along[:, 0]] / np.linalg.norm(along, axis=1, keepdims=True)
    offsets = np.einsum("fi,fi->f", normals, corners)
    if (normals @ centre > offsets + 1e-9).any():
        raise CertificateError(f"occluder {region.name!r} is not convex: split it into convex parts")
    low, high = (float(h) for h in region.height)
    a = np.r_[np.c_[normals, np.zeros(len(normals))], [[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]]]
    return a, np.r_[offsets, -low, high]
