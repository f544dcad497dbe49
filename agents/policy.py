"""What a policy is: observation in, action out, and the fixed facts that an agent knows of itself."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from camnet.control.setpoints import Setpoint
from camnet.control.settings import ControllerSettings
from camnet.env.handoff_v0 import HandoffEnv
from camnet.env.layout import ObservationLayout
from camnet.geometry.regions import Region
from camnet.geometry.settings import CameraModel, Road
from camnet.simulation.network import Network
from camnet.types import Array

if TYPE_CHECKING:
    from camnet.control.planner.viewpoints import Viewpoints

__all__ = ["AgentContext", "Policy", "contexts", "network_contexts"]

Action = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class AgentContext:
    """What one agent knows of itself before the first observation.

    Attributes
    ----------
    name : of the agent
    region, camera, controller : where it may fly, what it sees with, how it flies
    layout : order of the observation's fields
    center, half_size : (3,), (3,) of the region, m
    speeds : (M,) top speeds of the targets, m/s
    lookahead_s : time that scales times in observations
    roads : the map
    grace_s, decision_s : time allowed for a handoff; from one decision to the next
    gaze_max_rad : pan and tilt of an action of 1
    viewpoints : for an agent among occluders: where it can be and see
    """

    name: str
    region: Region
    camera: CameraModel
    controller: ControllerSettings
    layout: ObservationLayout
    center: Array
    half_size: Array
    speeds: Array
    lookahead_s: float
    gaze_max_rad: float
    viewpoints: Viewpoints | None = None
    roads: tuple[Road, ...] = ()
    grace_s: float = 2.0
    decision_s: float = 0.1

    def world(self, relative: Array) -> Array:
        """Position (3,) in the world from one in half-sizes about the region's centre."""
        return np.asarray(self.center + relative * self.half_size)

    def action(self, setpoint: Setpoint) -> Action:
        """Return the action in [-1, 1]^5 that asks for a setpoint."""
        flat = [(p - c) / r for p, c, r in zip(setpoint.p_world.tolist(), *self._box, strict=True)]
        flat += [angle / self.gaze_max_rad for angle in setpoint.gaze.tolist()]
        return np.array([min(max(x, -1.0), 1.0) for x in flat], dtype=np.float32)

    @cached_property
    def _box(self) -> tuple[list[float], list[float]]:
        """Centre of the region and how far from it a setpoint may lie along each axis, m."""
        reach = np.maximum(self.half_size - self.controller.region_margin_m, 1e-6)
        return self.center.tolist(), reach.tolist()

    @cached_property
    def width_m(self) -> float:
        """Smaller horizontal half-size of the region, m: what error radii are divided by."""
        return float(self.half_size[:2].min())


class Policy(Protocol):
    """A policy of one agent."""

    def __call__(self, observation: NDArray[np.float32]) -> Action:
        """Return the action, (5,) in [-1, 1], for an observation."""
        ...


def contexts(env: HandoffEnv) -> dict[str, AgentContext]:
    """Return the fixed facts of every agent of an environment."""
    return network_contexts(env.simulation.network, env.observer.layout, env.settings.gaze_max_rad)


def network_contexts(
    network: Network, layout: ObservationLayout, gaze_max_rad: float
) -> dict[str, AgentContext]:
    """Return the fixed facts of every agent of a network that is observed by ``layout``, whatever its back end."""
    scenario = network.scenario
    bounds = [region.bounds for region in network.regions]
    return {
        agent.name: AgentContext(
            name=agent.name,
            region=network.regions[j],
            camera=network.cameras[j],
            controller=scenario.controller,
            layout=layout,
            center=bounds[j].mean(axis=0),
            half_size=np.ptp(bounds[j], axis=0) / 2,
            speeds=np.array([target.v_max_mps for target in scenario.targets]),
            lookahead_s=scenario.handoff.lookahead_s,
            gaze_max_rad=gaze_max_rad,
            viewpoints=network.viewpoints.get(j),
            roads=scenario.roads,
            grace_s=scenario.handoff.grace_s,
            decision_s=1.0 / scenario.run.decision_hz,
        )
        for j, agent in enumerate(scenario.agents)
    }
