"""A network packed for the compiled loops: everything that stays the same for all environments.

What the loops cannot do is refused here, by name, so that nothing is left out silently.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from camnet.batch.motion import Targets, pack_targets
from camnet.certification.planar_shapes import convex_solids
from camnet.certification.sight_lines import Solids
from camnet.control.quadrotor_kernel import pack_model
from camnet.control.references import RegionBounds
from camnet.control.sliding_mode_kernel import SWITCHING_CODE
from camnet.errors import ConfigError
from camnet.estimation.own_pose.sources import pack_sources
from camnet.geometry.frustum import Frustum
from camnet.geometry.pinned import Pins
from camnet.geometry.polytope import PolytopeRegion
from camnet.geometry.regions import BoxRegion, CylinderRegion, Region
from camnet.geometry.rotations import from_yaw, rotate
from camnet.simulation.certificates import view_radius
from camnet.simulation.network import Network
from camnet.types import Array, IntArray
from camnet.world.pybullet.flight import model_from_settings

__all__ = ["MODELS", "Model", "network_at", "pack_network"]

#: kinds of region in the distance kernel
BOX, CYLINDER, POLYTOPE = 0, 1, 2


class Model(NamedTuple):
    """One network; N agents, C cameras and regions (the agents' first), M targets, F features.

    Attributes
    ----------
    targets : laws of motion
    constants : (27,) of the inner loop, as `camnet.control.quadrotor_kernel.pack_model` makes them
    periods, decide_every, sense_every : inner-loop periods in a control period; control periods in a decision, between
        two sensings
    dt_s : control period, s
    gains, switching : of the sliding mode (4,), and its switching function's code
    limits, gaze_limits, gaze_max, margin : of the references: (5,), (3,), rad, m
    yaw, half_yaw : (N, 2) cosine and sine of the agents' headings and of their halves
    start_p : (N, 3) bodies at the start, m
    offset : (3,) camera in the body frame, m
    wind, gust_std, gust_keep : mean (3,), standard deviation and decay in a control period
    planes, plane_ends, discs : bounds of the regions, as in `camnet.batch.reference`
    kind, boxes : (C,), (C, 2, 3) kind and bounding box of each region
    triangles, triangle_ends : (K, 3, 3) surfaces of polytopes
    frusta, reach : (C, 6, 3), (C, 6) half-spaces of the views in the camera frames
    fixed : (C - N, 7) poses of the fixed cameras
    features, feature_ends : (F, 3) in the targets' body frames
    sizes : (M, 3) boxes of the targets, m
    body : radius and height of an agent's cylinder, m
    occlusion : whether anything can come between
    solid_normals, solid_limits, solid_ptr : (K, 3), (K,), (S + 1,) as in `camnet.geometry.solid_lines`, of occluders
    noise : standard deviations of position and orientation, m, rad; drop-out probability
    sense_dt_s, grace_s, replan_s, rollout_dt_s, lookahead_s : times, s
    steps : count of instants in a rollout
    centers, halves, widths : (C, 3), (C, 3), (C,) of the regions' bounding boxes; smaller horizontal half-size
    heights : (C, 2) lowest and highest point of each region
    own : (N, 6) constant fields own.region_center and own.region_size
    speeds, views : (M,) top speeds of the targets; (N,) radius of the ball that fits the view
    v_max : top speed of the references, m/s
    gaze_scale, neighbours, range_m : of observations
    rewards : (6,) in view, reacquired, lost, effort, region exit, collision
    ends : (2,) whether a collision ends the episode; time lost that ends it (inf: none)
    guard : (2,) range from the start and speed at which a body counts as diverged
    every_entry, cameras_on : whether every entry into a region is a handoff; whether cameras see at all
    in_world : whether actions are setpoints, m and rad, not shares in [-1, 1]
    flight : (N, 2, 3) boxes that references stay in
    own_numbers, own_outages : pose sources of the A agents that may lose their pose, as in
        `camnet.estimation.own_pose.sources`
    own_index : (C,) which of them a camera's is (-1: none)
    """

    targets: Targets
    constants: Array
    periods: int
    decide_every: int
    sense_every: int
    dt_s: float
    gains: Array
    switching: int
    limits: Array
    gaze_limits: Array
    gaze_max: float
    margin: float
    yaw: Array
    half_yaw: Array
    start_p: Array
    offset: Array
    wind: Array
    gust_std: float
    gust_keep: float
    planes: Array
    plane_ends: IntArray
    discs: Array
    kind: IntArray
    boxes: Array
    triangles: Array
    triangle_ends: IntArray
    frusta: Array
    reach: Array
    fixed: Array
    features: Array
    feature_ends: IntArray
    sizes: Array
    body: Array
    occlusion: bool
    solid_normals: Array
    solid_limits: Array
    solid_ptr: IntArray
    noise: Array
    sense_dt_s: float
    grace_s: float
    replan_s: float
    rollout_dt_s: float
    lookahead_s: float
    steps: int
    centers: Array
    halves: Array
    heights: Array
    widths: Array
    own: Array
    speeds: Array
    views: Array
    v_max: float
    gaze_scale: float
    neighbours: int
    range_m: float
    rewards: Array
    ends: Array
    guard: Array
    every_entry: bool
    cameras_on: bool
    in_world: bool
    flight: Array
    own_numbers: Array
    own_index: IntArray
    own_outages: Array


#: networks at addresses
MODELS = Pins(Model)
#: the network at an address, in compiled code
network_at = MODELS.of


class Shown(NamedTuple):
    """How a network is shown and rewarded: the part of the environment's settings that the loops need."""

    gaze_max_rad: float
    neighbours: int
    communication_range_m: float
    rewards: tuple[float, float, float, float, float, float]
    terminate_on_collision: bool
    lost_limit_s: float
    in_world: bool = False
    every_entry: bool = False
    cameras_on: bool = True
    #: whoever steers does so by what agents believe of their poses, not by what is shown
    by_believed: bool = False


def _refuse(network: Network, by_believed: bool) -> None:
    scenario = network.scenario
    if scenario.occluders and network.n_agents:
        names = ", ".join(o.name for o in scenario.occluders)
        raise ConfigError(
            f"world {scenario.name!r} has occluders ({names}): agents of the batch back end fly in the open only"
        )
    if scenario.physics.actuation != "quadrotor":
        raise ConfigError(
            f"physics.actuation = {scenario.physics.actuation!r}: the batch back end flies 'quadrotor' only"
        )
    if scenario.sensing.level != "pose":
        raise ConfigError(
            f"sensing.level = {scenario.sensing.level!r}: the batch back end senses 'pose' only"
        )
    if scenario.sensing.latency_s > 0.0:
        raise ConfigError(
            f"sensing.latency_s = {scenario.sensing.latency_s}: the batch back end senses without latency (0)"
        )
    if by_believed and network.own_poses:
        _refuse_beside_own_poses(network)
    elif network.uncertain:
        raise ConfigError(
            f"world {scenario.name!r}: {network.uncertain}: agents of the batch back end know their poses and the "
            "targets' "
            "sizes, and stay in their regions"
        )
    for j, region in enumerate(network.regions):
        known = (BoxRegion, CylinderRegion) if j < network.n_agents else (BoxRegion, PolytopeRegion)
        if not isinstance(region, known):
            raise ConfigError(
                f"region {region.name!r} is a {type(region).__name__}: on the batch back end agents fly in "
                "boxes and cylinders"
            )


def _refuse_beside_own_poses(network: Network) -> None:
    """Refuse what agents that dead-reckon on this back end cannot have."""
    for j in network.own_poses:
        if not isinstance(network.regions[j], BoxRegion):
            raise ConfigError(
                f"region {network.regions[j].name!r} of an agent that may lose its pose: on the batch back end it is "
                "a box"
            )
    if network.exits or any(t.assumed_size is not None for t in network.scenario.targets):
        raise ConfigError(
            f"world {network.scenario.name!r}: exit budgets and targets of unknown size are not on the batch back end"
        )


def _ratio(what: str, fast: float, slow: float) -> int:
    ratio = fast / slow
    if abs(ratio - round(ratio)) > 1e-9 or ratio < 1:
        raise ConfigError(
            f"controller.rate_hz = {fast:g} must be a whole multiple of the {what} rate {slow:g} Hz"
        )
    return round(ratio)


def _planes(regions: tuple[Region, ...]) -> tuple[Array, IntArray, Array]:
    bounds = [RegionBounds.of(region) for region in regions]
    ends = np.concatenate([[0], np.cumsum([len(b.planes) for b in bounds])]).astype(np.int64)
    return np.concatenate([b.planes for b in bounds]), ends, np.array([b.disc for b in bounds])


def _surfaces(regions: tuple[Region, ...]) -> tuple[Array, IntArray]:
    blocks = [r.triangles if isinstance(r, PolytopeRegion) else np.zeros((0, 3, 3)) for r in regions]
    ends = np.concatenate([[0], np.cumsum([len(b) for b in blocks])]).astype(np.int64)
    return np.ascontiguousarray(np.concatenate(blocks)), ends


def _circle(angle: Array) -> Array:
    return np.column_stack([np.cos(angle), np.sin(angle)])


def pack_network(network: Network, shown: Shown) -> Model:
    """Pack a network.

    Raises
    ------
    ConfigError
        It has something that the batch back end does not: occluders among agents, regions of agents that are neither
        boxes nor cylinders, latency, kinematic actuation.
    """
    _refuse(network, shown.by_believed)
    s, d, n = network.scenario, network.description, network.n_agents
    controller, physics, wind = s.controller, s.physics, s.physics.wind
    yaw = np.array([a.start_yaw_rad for a in d.agents])
    offset = np.array(physics.gimbal.offset_m)
    start_p = np.array([a.start_p_world for a in d.agents], dtype=float).reshape(n, 3)
    start_p = start_p - rotate(from_yaw(yaw).reshape(n, 4), np.broadcast_to(offset, (n, 3)))
    flown = (*network.flight_regions, *network.regions[n:])
    planes, plane_ends, discs = _planes(flown)
    lost = sorted(network.own_poses)
    own_numbers, own_outages = pack_sources(
        [network.own_poses[j] for j in lost], d.substeps / physics.step_hz
    )
    own_index = np.full(len(network.cameras), -1, dtype=np.int64)
    own_index[lost] = np.arange(len(lost))
    triangles, triangle_ends = _surfaces(network.regions)
    solids = Solids.of([part for occluder in network.occluders for part in convex_solids(occluder)])
    frusta = Frustum.stack([Frustum.from_camera(camera) for camera in network.cameras])
    bounds = np.stack([region.bounds for region in network.regions])
    centers, halves = bounds.mean(axis=1), np.ptp(bounds, axis=1) / 2
    corners = np.stack([bounds[:, 0].min(axis=0), bounds[:, 1].max(axis=0)])
    middle, half = corners.mean(axis=0), np.ptp(corners, axis=0) / 2
    features = [np.array(t.features_m, dtype=float).reshape(-1, 3) for t in d.targets]
    dt_s = d.substeps / physics.step_hz
    lookahead, rollout_dt = s.handoff.lookahead_s, s.handoff.rollout_dt_s
    kinds = [
        1 if isinstance(r, CylinderRegion) else 2 if isinstance(r, PolytopeRegion) else 0
        for r in network.regions
    ]
    return Model(
        targets=pack_targets([t.motion for t in d.targets]),
        constants=pack_model(model_from_settings(physics, d.flight_substeps)),
        periods=d.substeps // d.flight_substeps,
        decide_every=_ratio("decision", controller.rate_hz, s.run.decision_hz),
        sense_every=_ratio("sensing", controller.rate_hz, s.sensing.rate_hz),
        dt_s=dt_s,
        gains=np.array(
            [controller.k1_per_s, controller.d_bar_mps, controller.d_bar_radps, controller.boundary_layer]
        ),
        switching=SWITCHING_CODE[controller.switching],
        limits=np.array(
            [
                controller.reference_v_max_mps,
                controller.reference_a_max_mps2,
                controller.reference_position_gain_per_s,
                controller.reference_velocity_gain_per_s,
                controller.reference_jerk_max_mps3,
            ]
        ),
        gaze_limits=np.array(
            [
                controller.reference_w_max_radps,
                controller.reference_w_acceleration_radps2,
                controller.gaze_gain_per_s,
            ]
        ),
        gaze_max=controller.gaze_max_rad,
        margin=controller.region_margin_m,
        yaw=_circle(yaw),
        half_yaw=_circle(0.5 * yaw),
        start_p=start_p,
        offset=offset,
        wind=np.array(wind.mean_mps),
        gust_std=wind.gust_std_mps,
        gust_keep=math.exp(-dt_s / wind.gust_time_s),
        planes=planes,
        plane_ends=plane_ends,
        discs=discs,
        kind=np.array(kinds, dtype=np.int64),
        boxes=bounds,
        triangles=triangles,
        triangle_ends=triangle_ends,
        frusta=np.ascontiguousarray(frusta.A),
        reach=np.ascontiguousarray(frusta.b),
        fixed=np.array([[*c.p_world, *c.q_world] for c in d.cameras]).reshape(-1, 7),
        features=np.concatenate(features),
        feature_ends=np.concatenate([[0], np.cumsum([len(f) for f in features])]).astype(np.int64),
        sizes=np.array([t.size_m for t in d.targets], dtype=float).reshape(-1, 3),
        body=np.array([physics.quadrotor.arm_m, physics.quadrotor.height_m]),
        occlusion=network.can_occlude,
        solid_normals=solids.normals,
        solid_limits=solids.limits,
        solid_ptr=solids.ptr,
        noise=np.array(
            [s.sensing.position_noise_m, s.sensing.orientation_noise_rad, s.sensing.dropout_probability]
        ),
        sense_dt_s=1.0 / s.sensing.rate_hz,
        grace_s=s.handoff.grace_s,
        replan_s=s.handoff.replan_s,
        rollout_dt_s=rollout_dt,
        lookahead_s=lookahead,
        steps=max(1, round(lookahead / rollout_dt)),
        centers=centers,
        halves=halves,
        heights=np.ascontiguousarray(bounds[:, :, 2]),
        widths=halves[:, :2].min(axis=1),
        own=np.concatenate([(centers - middle) / half, halves / half], axis=1)[:n],
        speeds=np.array([t.v_max_mps for t in s.targets]),
        views=np.array([view_radius(network, j) for j in range(n)], dtype=float),
        v_max=controller.reference_v_max_mps,
        gaze_scale=shown.gaze_max_rad,
        neighbours=max(min(shown.neighbours, n - 1), 0),
        range_m=shown.communication_range_m,
        rewards=np.array(shown.rewards),
        ends=np.array([float(shown.terminate_on_collision), shown.lost_limit_s]),
        guard=np.array([physics.range_limit_m, physics.speed_limit_mps]),
        every_entry=shown.every_entry,
        cameras_on=shown.cameras_on,
        in_world=shown.in_world,
        flight=np.stack([region.bounds for region in flown])[:n].reshape(n, 2, 3),
        own_numbers=own_numbers,
        own_index=own_index,
        own_outages=own_outages,
    )
