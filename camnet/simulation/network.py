"""From a scenario to the objects of one simulation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from camnet.certification.outage import OutageBounds, bounds_of
from camnet.config.models import Agent, FixedCamera, Scenario
from camnet.control.references import Detour
from camnet.errors import WorldError
from camnet.estimation.basis import RbfBasis
from camnet.estimation.placement import place_basis
from camnet.geometry.frustum import Frustum
from camnet.geometry.regions import BoxRegion, CylinderRegion, PolytopeRegion, Region, build_region, narrowed
from camnet.geometry.rotations import look_at, normalise
from camnet.geometry.settings import CameraModel
from camnet.geometry.spacing import in_boxes
from camnet.importers.tracks import load_tracks, only_track
from camnet.motion.factory import HORIZON_S, build_motion
from camnet.motion.protocol import TargetMotion
from camnet.motion.settings import TargetSettings, TrackTarget
from camnet.sensing.own_pose_settings import PoseSource
from camnet.types import Array, BoolArray
from camnet.world.description import AgentSpec, CameraSpec, OccluderSpec, TargetSpec, WorldDescription

if TYPE_CHECKING:
    from camnet.sensing.marker import Marker

if TYPE_CHECKING:
    from camnet.control.planner.viewpoints import Viewpoints

_CONVEX = (BoxRegion, CylinderRegion, PolytopeRegion)

__all__ = ["Network", "build_network", "view_volume"]


@dataclass(frozen=True, eq=False)
class Network:
    """A scenario with its geometry built; region j belongs to camera j, agents' cameras first.

    Attributes
    ----------
    scenario : the settings
    regions : C regions: operating regions of the N agents, then the view volumes of fixed cameras
    cameras : C camera models
    description : what the world needs to build its bodies
    occluders : solids that block views
    basis : kernels of the learned motion model
    bounds : (2, 3) corners of the tracking space, m
    """

    scenario: Scenario
    regions: tuple[Region, ...]
    cameras: tuple[CameraModel, ...]
    description: WorldDescription
    occluders: tuple[Region, ...]
    basis: RbfBasis
    bounds: Array

    @property
    def n_agents(self) -> int:
        """Number of mobile cameras."""
        return len(self.scenario.agents)

    def containment(self, points: Array) -> BoolArray:
        """Whether points (K,3) lie in the regions, (K,C)."""
        low, high = self._boxes
        inside: BoolArray = in_boxes(points, low, high)
        for j in self._not_boxes:  # the bounding box alone does not decide
            inside[:, j] &= self.regions[j].contains(points)
        return inside

    def exceptions(self, target_p: Array, agent_p: Array) -> BoolArray:
        """Who (M + N, C) is not in a region though in the box about it: targets first; never with boxes alone."""
        if not self._not_boxes:
            return self._no_exceptions
        points = np.concatenate([target_p, agent_p])
        out = np.zeros((len(points), len(self.regions)), dtype=bool)
        for j in self._not_boxes:
            out[:, j] = ~self.regions[j].contains(points)
        return out

    @cached_property
    def _no_exceptions(self) -> BoolArray:
        return np.zeros((self.n_targets + self.n_agents, len(self.regions)), dtype=bool)

    @property
    def boxes(self) -> tuple[Array, Array]:
        """Corners (C,3), (C,3) of the boxes about the regions, m."""
        return self._boxes

    @cached_property
    def _boxes(self) -> tuple[Array, Array]:
        bounds = np.array([region.bounds for region in self.regions])
        return bounds[:, 0].copy(), bounds[:, 1].copy()

    @cached_property
    def half_widths(self) -> Array:
        """Smaller horizontal half-size of every region's bounding box, (C,), m."""
        low, high = self._boxes
        return np.asarray(0.5 * (high - low)[:, :2].min(axis=1))

    @cached_property
    def _not_boxes(self) -> tuple[int, ...]:
        return tuple(j for j, region in enumerate(self.regions) if not isinstance(region, BoxRegion))

    @cached_property
    def own_poses(self) -> dict[int, PoseSource]:
        """Pose sources of the agents that may lose their external pose, by the agent's number."""
        agents = enumerate(self.scenario.agents)
        return {j: a.pose for j, a in agents if a.pose.may_be_lost}

    @cached_property
    def exits(self) -> dict[int, tuple[float, float]]:
        """Exit budget, s, and reach, m, of the agents that may leave their regions, by the agent's number."""
        agents = enumerate(self.scenario.agents)
        return {j: (a.exit_budget_s, a.exit_reach_m) for j, a in agents if a.exit_budget_s > 0.0}

    @property
    def uncertain(self) -> str:
        """The first setting by which an agent may be wrong about itself or its target, or may leave; empty: none."""
        for i, agent in enumerate(self.scenario.agents):
            if agent.pose.may_be_lost:
                return f"agents[{i}].pose.source = {agent.pose.source!r}"
            if agent.exit_budget_s > 0.0:
                return f"agents[{i}].exit_budget_s = {agent.exit_budget_s:g}"
        for i, target in enumerate(self.scenario.targets):
            if target.assumed_size is not None:
                return f"targets[{i}].assumed_size = {target.assumed_size:g}"
        return ""

    @cached_property
    def outages(self) -> dict[int, OutageBounds]:
        """Bounds of the own position of the agents that may lose their external pose."""
        control = self.scenario.controller
        out = {}
        for j, source in self.own_poses.items():
            corners = self.regions[j].footprint()
            reach = float(np.linalg.norm(corners[:, None] - corners, axis=-1).max())
            reach += 2.0 * self.exits.get(j, (0.0, 0.0))[1]
            out[j] = bounds_of(source, reach, control.reference_v_max_mps + control.d_bar_mps)
        return out

    def outage_s(self, j: int) -> float:
        """Return the longest time that agent ``j`` can be without external pose, s: an exit may join an outage."""
        if j not in self.own_poses:
            return 0.0
        longest, budget = self.own_poses[j].longest_outage_s, self.exits.get(j, (0.0, 0.0))[0]
        return longest + (2.0 if longest > 0.0 else 1.0) * budget

    def lost_for_s(self, j: int, t_s: float) -> float | None:
        """Return since when camera ``j`` is without external pose at ``t_s``, by its outages, s; None: it is not."""
        source = self.own_poses.get(j)
        begun = [b for b, end in source.outages_s if b <= t_s < end] if source is not None else []
        return t_s - begun[0] if begun else None

    def own_error_m(self, j: int) -> float:
        """Return e(T): how far agent ``j`` can be from where it believes to be after an outage, m."""
        return self.outages[j].error_m(self.outage_s(j)) if j in self.outages else 0.0

    @cached_property
    def flight_regions(self) -> tuple[Region, ...]:
        """Where the agents' believed positions stay: their regions, less e(T) on every side."""
        return tuple(
            narrowed(region, self.own_error_m(j)) for j, region in enumerate(self.regions[: self.n_agents])
        )

    @property
    def can_occlude(self) -> bool:
        """Whether anything can come between a camera and a target that it looks at.

        With one target, no occluders and nothing but agents in convex regions of their own, the sight line stays in
        the region and the region holds nobody else.
        """
        alone = self.n_targets == 1 and not self.occluders and not self.description.cameras and not self.exits
        return not (alone and all(isinstance(region, _CONVEX) for region in self.regions))

    def detours(self) -> Mapping[int, Detour]:
        """Return what leads agents around occluders in their regions, by the agent's number; made anew at each call."""
        if not self.scenario.occluders:
            return {}
        from camnet.control.planner.pilot import pilots  # compiled, and needed with occluders only

        shapes = [o.shape for o in self.scenario.occluders]
        dt_s = 1.0 / self.scenario.controller.rate_hz
        return pilots(self.scenario.controller, self.regions[: self.n_agents], shapes, dt_s)

    @cached_property
    def viewpoints(self) -> Mapping[int, Viewpoints]:
        """What moves the setpoints of agents among occluders to where they can be and see, by the agent's number."""
        detoured = self.detours()
        if not detoured:
            return {}
        from camnet.control.planner.obstacles import from_shape
        from camnet.control.planner.viewpoints import Viewpoints

        solids = [from_shape(o.shape) for o in self.scenario.occluders]
        roads = [np.array([*r.points_m, *([r.points_m[0]] if r.closed else [])]) for r in self.scenario.roads]
        settings = self.scenario.controller
        return {j: Viewpoints(settings, self.regions[j], self.cameras[j], solids, roads) for j in detoured}

    @property
    def n_models(self) -> int:
        """Number of models that a learning estimator has."""
        return 1 if self.scenario.estimator.share else len(self.regions)

    @property
    def n_targets(self) -> int:
        """Number of targets."""
        return len(self.scenario.targets)


def build_network(scenario: Scenario) -> Network:
    """Build the geometry, the world's description and the basis of one scenario."""
    if not scenario.agents and not scenario.fixed_cameras:
        raise WorldError(
            f"world {scenario.name!r} has no agents and no fixed cameras: add at least one camera"
        )
    models = {model.name: model for model in scenario.cameras}
    shapes = {region.name: build_region(region.name, region.shape) for region in scenario.regions}
    fixed = [_fixed_camera(camera, models) for camera in scenario.fixed_cameras]
    regions = (*(shapes[a.region] for a in scenario.agents), *(view_volume(spec) for spec in fixed))
    description = WorldDescription(
        physics=scenario.physics,
        control_hz=scenario.controller.rate_hz,
        agents=tuple(_agent(a, shapes, models) for a in scenario.agents),
        cameras=tuple(fixed),
        occluders=tuple(OccluderSpec(o.name, o.shape) for o in scenario.occluders),
        targets=tuple(
            TargetSpec(
                t.name, t.size_m, np.array(t.features_m), _motion(t, scenario), _marker(t, m, scenario)
            )
            for m, t in enumerate(scenario.targets)
        ),
        roads=scenario.roads,
    )
    bounds = _bounds(regions, scenario)
    cameras = (*(agent.camera for agent in description.agents), *(spec.camera for spec in fixed))
    basis = place_basis(scenario.estimator.basis, scenario.roads, *bounds)
    occluders = tuple(build_region(o.name, o.shape) for o in scenario.occluders)
    return Network(scenario, regions, cameras, description, occluders, basis, bounds)


def view_volume(spec: CameraSpec) -> Region:
    """Field-of-view volume V_c of a fixed camera: the frustum between its near and far range, world frame."""
    return Frustum.from_camera(spec.camera).in_world(spec.p_world, spec.q_world).region(spec.name)


def _motion(target: TargetSettings, scenario: Scenario) -> TargetMotion:
    track = None
    if isinstance(target.motion, TrackTarget):
        track = only_track(load_tracks(target.motion), str(target.motion.file))
    horizon_s = max(HORIZON_S, scenario.run.duration_s)
    return build_motion(target, scenario.roads, track, horizon_s)


def _marker(target: TargetSettings, number: int, scenario: Scenario) -> Marker | None:
    if scenario.sensing.level != "image":
        return None
    from camnet.sensing.marker import marker_on  # OpenCV, for this level only

    return marker_on(target.features_m, number)


def _agent(agent: Agent, regions: dict[str, Region], models: dict[str, CameraModel]) -> AgentSpec:
    region = regions[agent.region]
    start = region.center if agent.start_m is None else np.array(agent.start_m)
    return AgentSpec(agent.name, start, agent.start_yaw_rad, models[agent.camera], region)


def _fixed_camera(camera: FixedCamera, models: dict[str, CameraModel]) -> CameraSpec:
    p_world = np.array(camera.pose.position_m)
    if camera.pose.quaternion_wxyz is not None:
        q_world = normalise(np.array(camera.pose.quaternion_wxyz))
    else:
        q_world = look_at(p_world, np.array(camera.pose.look_at_m))
    return CameraSpec(camera.name, models[camera.camera], p_world, q_world)


def _bounds(regions: tuple[Region, ...], scenario: Scenario) -> Array:
    """Smallest box around all regions, roads and target starts, grown by the basis' margin on the ground."""
    corners = [region.bounds for region in regions]
    corners += [np.c_[np.array(road.points_m), np.zeros(len(road.points_m))] for road in scenario.roads]
    corners += [np.array([[*t.start_m, 0.0]]) for t in scenario.targets if t.start_m is not None]
    points = np.concatenate(corners)
    margin = np.array([1.0, 1.0, 0.0]) * scenario.estimator.basis.margin_m
    return np.stack([points.min(axis=0) - margin, points.max(axis=0) + margin])
