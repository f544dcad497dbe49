"""Certify a world whose target follows a velocity field: ``sound`` by dwell times, ``learned`` along the learned flow.

| symbol | name | unit | meaning |
| --- | --- | --- | --- |
| phi | ``true_velocity`` | m/s | the velocity that the world's target has at a place |
| phi_hat | ``LearnedModel.fields`` | m/s | the velocity that the estimator has learned |
| e_v | ``model_errors`` | m/s | sup norm(phi - phi_hat) + (1 - u) v |

``e_v`` is needed only where the target itself can be: within ``corridor_m`` of its path (docs/theory.md, section 8).
The supremum is taken on a grid in the corridor. With ``certificate.field_slope_per_s``, a bound of the slope of phi, it
is continued to all places between (``deterministic``, if e(0) covers what one measurement may be off); else half the
largest change between neighbours is added, an estimate and no bound (``sampled``). The last term covers the prior that
the predictor blends in where the model has no data; u is the share that the model answers for.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely

from camnet.certification.crossing import RegionAgent
from camnet.certification.flow_network import FlowTargetClass, certify_flow
from camnet.certification.free_network import GroundView, ground_views
from camnet.certification.growth import PlanarField
from camnet.certification.model_error import Conformal, ModelError, gap_model_error
from camnet.certification.planar_shapes import PolygonView, convex_solids, inscribed_radius
from camnet.certification.reachable import PlanarView
from camnet.certification.site import views_of
from camnet.errors import CertificateError
from camnet.experiments.learned_model import LearnedModel
from camnet.geometry.frustum import Frustum
from camnet.geometry.polytope import largest_ball
from camnet.geometry.regions import Region
from camnet.motion.field_motion import FieldMotion
from camnet.motion.vector_field import VectorFieldMotion
from camnet.simulation.certificates import feature_extent, view_radius
from camnet.simulation.network import Network
from camnet.simulation.sound_settings import sampling_of
from camnet.types import Array

__all__ = [
    "FlowCase",
    "calibrated_error",
    "certify_learned",
    "corridor_points",
    "flow_case",
    "ground_of",
    "learned_path",
    "model_errors",
    "region_agents",
    "solid_occluders",
    "time_to_settle",
    "true_velocity",
]

#: position error when a target is lost, unless the world says otherwise, m
_E0_M = 0.05
#: distance between the lines of the grid in the corridor, m
_GRID_M = 0.01


@dataclass(frozen=True, eq=False)
class FlowCase:
    """Everything that the certificate of a learned flow is about, shared by certifier and falsifier.

    Attributes
    ----------
    ground : views (or regions) on the ground
    fields : learned velocity for the way out of each
    target : class of the targets
    start : (2,) a point on the path, in the middle of a view, m
    duration_s : one lap and a half, s
    off_max_s : longest time out of view
    step_s, cover_m : step of the tubes and distance of samples across an exit
    agents : mobile cameras
    on_min_s : time in view after a gap until the error is within e(0) again, for the next exit
    """

    ground: list[GroundView]
    fields: list[PlanarField]
    target: FlowTargetClass
    start: Array
    duration_s: float
    off_max_s: float
    step_s: float
    cover_m: float
    agents: list[RegionAgent | None] | None
    on_min_s: float = 0.0


def ground_of(network: Network) -> list[GroundView]:
    """Cut what the cameras can see with the plane of the targets' reference points.

    Agents come first, each with its operating region, then the views of the fixed cameras, less what occluders hide.
    """
    ground = [_region_view(region) for region in network.regions[: network.n_agents]]
    specs = network.description.cameras
    if specs:
        frusta = [Frustum.from_camera(c.camera).in_world(c.p_world, c.q_world) for c in specs]
        views = views_of(frusta, np.array([c.p_world for c in specs]))
        names = [c.name for c in specs]
        ground += ground_views(views, names, 0.0, feature_extent(network), solid_occluders(network))
    return ground


def solid_occluders(network: Network) -> list[tuple[Array, Array]]:
    """Return a world's occluders as convex solids (B, c)."""
    return [part for occluder in network.occluders for part in convex_solids(occluder)]


def _region_view(region: Region) -> GroundView:
    """Turn the outline of an operating region into half-planes, or a polygon where it is not convex."""
    outline = shapely.geometry.polygon.orient(shapely.Polygon(region.footprint()))
    if outline.convex_hull.area > outline.area * (1.0 + 1e-6):
        whole = PolygonView(outline)
        return GroundView(region.name, whole, outline, inscribed_radius(whole))
    corners = np.asarray(outline.exterior.coords)
    along = np.diff(corners, axis=0)
    normals = np.c_[along[:, 1], -along[:, 0]] / np.linalg.norm(along, axis=1, keepdims=True)
    offsets = np.einsum("fi,fi->f", normals, corners[:-1])
    return GroundView(
        region.name, PlanarView(normals, offsets, True), outline, largest_ball(normals, offsets)[1]
    )


def region_agents(network: Network) -> list[RegionAgent | None] | None:
    """Return what the agents can do: reference speed, disturbance bound, footprint; None without agents.

    The fixed cameras of a mixed network have None in their places.
    """
    if network.n_agents == 0:
        return None
    control = network.scenario.controller
    ramp = control.reference_v_max_mps / control.reference_a_max_mps2
    ramp += control.reference_a_max_mps2 / control.reference_jerk_max_mps3
    agents: list[RegionAgent | None] = [
        RegionAgent(
            network.regions[j].footprint(),
            control.reference_v_max_mps,
            control.d_bar_mps,
            view_radius(network, j),
            ramp,
        )
        for j in range(network.n_agents)
    ]
    return agents + [None] * len(network.description.cameras)


def learned_path(model: LearnedModel) -> tuple[Array, Array]:
    """Return the last lap and a half: points (n, 2) and the camera that saw, or last saw, the target there (n,)."""
    t, seen = model.path[:, 0], model.path[:, 3].astype(int)
    last = np.maximum.accumulate(np.where(seen >= 0, np.arange(len(seen)), 0))
    late = t >= t[-1] - 1.5 * _lap_s(model)
    return model.path[late][:, 1:3], np.where(seen[last] >= 0, seen[last], 0)[late]


def _lap_s(model: LearnedModel) -> float:
    """Time between the last two arrivals in the same view."""
    seen = model.path[:, 3].astype(int)
    into = np.flatnonzero((seen[1:] >= 0) & (seen[:-1] < 0)) + 1
    again = [k for k in into[:-1] if seen[k] == seen[into[-1]]] if len(into) else []
    if not again:
        raise CertificateError(
            "the target never came back to a view in the run that it was learned from: learn for longer"
        )
    return float(model.path[into[-1], 0] - model.path[again[-1], 0])


def true_velocity(network: Network, points: Array) -> Array | None:
    """Return the target's velocity (n, 2) at points (n, 2), once turned into its field; None if it has a memory."""
    motion = network.description.targets[0].motion
    if isinstance(motion, FieldMotion) and motion.law is not None and motion.law.by_place:
        return motion.law.velocity(points) if motion.law.dimensions == 2 else None
    if not isinstance(motion, VectorFieldMotion):
        return None
    out = np.empty((len(points), 2))
    for k, (x, y) in enumerate(points.tolist()):
        half = 0.5 * motion.field.guide(x, y).direction
        q_world = np.array([math.cos(half), 0.0, 0.0, math.sin(half)])
        twist = motion.velocity(np.array([x, y, 0.0]), q_world, 0.0)
        if twist is None:
            return None
        out[k] = twist.v[:2]
    return out


def slope_of(network: Network) -> float | None:
    """Return the stated bound of the slope of the first target's velocity over the place, 1/s; None without one."""
    stated = network.scenario.certificate.field_slope_per_s
    motion = network.description.targets[0].motion
    own = motion.lipschitz_per_s if isinstance(motion, FieldMotion) else None
    return own if stated is None else stated


def corridor_points(path: Array, corridor_m: float) -> Array:
    """Return a grid (k, n, 2) of points: the path shifted sideways by up to ``corridor_m``."""
    along = np.gradient(path, axis=0)
    across = np.c_[-along[:, 1], along[:, 0]] / np.maximum(
        np.linalg.norm(along, axis=1, keepdims=True), 1e-12
    )
    steps = max(1, math.ceil(corridor_m / _GRID_M))
    shifts = corridor_m * np.arange(-steps, steps + 1) / steps
    return np.asarray(path + shifts[:, None, None] * across)


def model_errors(network: Network, model: LearnedModel) -> list[float]:
    """Return e_v of every region's model in the corridor of its sighting's end and of the gap behind it, m/s."""
    path, last = learned_path(model)
    speed = 1.05 * float(
        np.linalg.norm(np.diff(model.path[:, 1:3], axis=0), axis=1).max() / np.diff(model.path[:2, 0])[0]
    )
    blends = network.scenario.estimator.gap.prior != "none"
    slope = slope_of(network)
    out = []
    for j, field in enumerate(model.fields()):
        parts = [p for p in _runs(path, last == j) if len(p) > 2]
        worst = 0.0
        for part in parts:
            if slope is not None and not blends:
                part = _finer(part)
            grid = corridor_points(part, network.scenario.certificate.corridor_m)
            flat = grid.reshape(-1, 2)
            true = true_velocity(network, flat)
            if true is None:
                raise CertificateError(
                    "the target's velocity does not depend on its place alone (motors that lag, or another kind of "
                    "motion): state the model's error with --model-error"
                )
            error = np.linalg.norm(true - field.velocity(flat), axis=1)
            if blends:
                error += speed * (1.0 - model.support(j, flat))
            worst = max(worst, _supremum(grid, error, field, None if blends else slope))
        out.append(worst)
    return out


def _finer(path: Array) -> Array:
    """Put points between those of a path (n, 2), at most ``_GRID_M`` apart on each chord."""
    longest = float(np.linalg.norm(np.diff(path, axis=0), axis=1).max())
    parts = max(1, math.ceil(longest / _GRID_M))
    at = np.arange((len(path) - 1) * parts + 1) / parts
    known = np.arange(len(path), dtype=float)
    return np.column_stack([np.interp(at, known, path[:, i]) for i in (0, 1)])


def _supremum(grid: Array, error: Array, field: PlanarField, slope_per_s: float | None) -> float:
    """Return the supremum over the corridor of an error (k n,) that was taken on its grid (k, n, 2), m/s.

    Every place is within half of both sides of a cell of a grid point; over that distance the error changes by at most
    both slopes times it.
    """
    if slope_per_s is not None:
        sides = (np.linalg.norm(np.diff(grid, axis=a), axis=2).max(initial=0.0) for a in (0, 1))
        reach = 0.5 * float(sum(sides))
        learned = field.slope_bound(grid.reshape(-1, 2), reach)
        return float((error + (slope_per_s + learned) * reach).max())
    error = error.reshape(grid.shape[:2])
    slack = 0.5 * sum(float(np.abs(np.diff(error, axis=a)).max(initial=0.0)) for a in (0, 1))
    return float(error.max()) + slack


def _runs(path: Array, chosen: Array) -> list[Array]:
    """Cut out the unbroken stretches of a path where ``chosen`` holds."""
    edges = np.flatnonzero(np.diff(np.r_[False, chosen, False].astype(int)))
    return [path[a:b] for a, b in edges.reshape(-1, 2).tolist()]


def flow_case(
    network: Network,
    model: LearnedModel,
    model_error_mps: ModelError = None,
    off_max_s: float | None = None,
    on_min_s: float | None = None,
) -> FlowCase:
    """Put together what the learned certificate of a world is about; ``off_max_s`` None: what the world allows.

    ``on_min_s`` is asked for in view after each gap, beside what the estimate needs there (``time_to_settle``).

    ``model_error_mps``: stated, or from the model's gaps (no truth is needed), or None: from the world's own motion.

    Raises
    ------
    CertificateError
        The model belongs to another network, or the target never returned to a view.
    """
    if len(model.weights) != len(network.regions):
        raise CertificateError(
            f"the model has {len(model.weights)} regions, the network {len(network.regions)}: learn it again"
        )
    settings, ground = network.scenario.certificate, ground_of(network)
    path, last = learned_path(model)
    e0 = settings.initial_error_m if settings.initial_error_m is not None else _E0_M
    if isinstance(model_error_mps, Conformal):
        e_v, source = calibrated_error(model, e0, model_error_mps.confidence), "statistical"
    elif model_error_mps is not None:
        e_v, source = model_error_mps, "stated"
    else:
        bounded = slope_of(network) is not None and network.scenario.estimator.gap.prior == "none"
        bounded &= e0 >= sampling_of(network).position_noise_m  # a restart at a measurement is off by as much
        e_v, source = max(model_errors(network, model)), "deterministic" if bounded else "sampled"
    target = FlowTargetClass(
        network.scenario.targets[0].v_max_mps,
        e_v,
        e0,
        spread_m=settings.corridor_m,
        source=source,
        own_m=own_errors(network),
    )
    depth = np.array([ground[j].view.depth(p) for p, j in zip(path, last, strict=True)])
    return FlowCase(
        ground,
        model.fields(),
        target,
        path[int(np.argmax(depth))],
        1.5 * _lap_s(model),
        off_max_s or settings.off_max_s or network.scenario.estimator.gap.max_gap_s,
        0.2,
        max(0.1, 2.0 * settings.corridor_m),
        region_agents(network),
        max(on_min_s or 0.0, time_to_settle(network, e0, max(g.radius_m for g in ground))),
    )


def own_errors(network: Network) -> tuple[float, ...]:
    """Return e(T) of each view's agent at the end of its longest outage, m; empty where no agent loses its pose."""
    if not network.own_poses:
        return ()
    return tuple(network.own_error_m(j) for j in range(len(network.regions)))


def time_to_settle(network: Network, e0_m: float, radius_m: float) -> float:
    """Return how long a target must be in view until the error, at most ``radius_m`` at the entry, is e(0) again, s.

    A restart at the measurement takes one sensing period; without it the error decays at the gain of the feedback.
    """
    estimator = network.scenario.estimator
    period = 1.0 / network.scenario.sensing.rate_hz
    if estimator.reset_on_sighting or radius_m <= e0_m:
        return period
    if e0_m <= 0.0:
        raise CertificateError(
            "certificate.initial_error_m = 0: without estimator.reset_on_sighting no time in view brings the error to 0"
        )
    return period + math.log(radius_m / e0_m) / estimator.k1_per_s


def calibrated_error(model: LearnedModel, e0_m: float, confidence: float) -> float:
    """Return e_v from the later half of a model's gaps, m/s: while it learned the earlier ones it knew less.

    Each gap was predicted before it was learned from, so that all are held out.
    """
    late = model.gaps[len(model.gaps) // 2 :]
    return gap_model_error(late[:, 4], late[:, 3] - late[:, 2], e0_m, confidence)


def certify_learned(case: FlowCase, find_largest: bool = True) -> dict[str, Any]:
    """Return the ``learned`` report of a flow case."""
    return certify_flow(
        case.fields,
        case.ground,
        case.target,
        case.start,
        case.duration_s,
        case.off_max_s,
        case.on_min_s,
        step_s=case.step_s,
        cover_m=case.cover_m,
        find_largest=find_largest,
        agents=case.agents,
    )
