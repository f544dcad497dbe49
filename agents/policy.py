"""What a policy is: observation in, action out, and the fixed facts that an agent knows of itself."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from camnet.control.setpoints import Setpoint
from camnet.control.settings import ControllerSettings
from camnet.env.handoff_v0 import HandoffEnv
from camnet.env.layout import ObservationLayout
from camnet.geometry.regions import Region
from camnet.geometry.settings import CameraModel
from camnet.types import Array

__all__ = ["AgentContext", "Policy", "contexts"]

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
    gaze_max_rad : pan and tilt of an action of 1
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

    def world(self, relative: Array) -> Array:
        """Position (3,) in the world from one in half-sizes about the region's centre."""
        return np.asarray(self.center + relative * self.half_size)

    def action(self, setpoint: Setpoint) -> Action:
        """Return the action in [-1, 1]^5 that asks for a setpoint."""
        reach = np.maximum(self.half_size - self.controller.region_margin_m, 1e-6)
        flat = np.concatenate([(setpoint.p_world - self.center) / reach, setpoint.gaze / self.gaze_max_rad])
        return np.asarray(np.clip(flat, -1.0, 1.0), dtype=np.float32)


class Policy(Protocol):
    """A policy of one agent."""

    def __call__(self, observation: NDArray[np.float32]) -> Action:
        """Return the action, (5,) in [-1, 1], for an observation."""
        ...


def contexts(env: HandoffEnv) -> dict[str, AgentContext]:
    """Return the fixed facts of every agent of an environment."""
    network, observer = env.simulation.network, env.observer
    return {
        name: AgentContext(
            name=name,
            region=network.regions[j],
            camera=network.cameras[j],
            controller=network.scenario.controller,
            layout=observer.layout,
            center=observer.centers[j],
            half_size=observer.half_sizes[j],
            speeds=np.array([target.v_max_mps for target in network.scenario.targets]),
            lookahead_s=network.scenario.handoff.lookahead_s,
            gaze_max_rad=env.settings.gaze_max_rad,
        )
        for j, name in enumerate(env.possible_agents)
    }
