"""What a simulated world offers to the loop that runs it, whatever engine is behind it.

| symbol | meaning |
| --- | --- |
| N | agents, each a quadrotor that carries one camera |
| C | cameras: the N agents' cameras first, in the agents' order, then the fixed ones |
| M | targets |
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from camnet.types import Array, BoolArray, Snapshot

if TYPE_CHECKING:
    from camnet.control.autopilot import Autopilot

__all__ = ["CameraCommand", "Flown", "Foresees", "Steers", "World"]


@dataclass(frozen=True, eq=False, slots=True)
class CameraCommand:
    """Velocity command ``u_c = [u_l; u_a]`` of (4-2), for every agent's camera.

    Attributes
    ----------
    v_world : (N,3) linear velocity of the optical centre in the world frame, m/s
    w_cam : (N,3) angular velocity of the camera frame, in the camera frame, rad/s
    a_world : (N,3) acceleration of the reference, m/s^2 (None: zero): feedforward for the quadrotors' inner loop,
        which without it lags behind a velocity command that changes
    """

    v_world: Array
    w_cam: Array
    a_world: Array | None = None

    @staticmethod
    def zeros(n: int) -> CameraCommand:
        """Stand-still command for ``n`` agents."""
        return CameraCommand(v_world=np.zeros((n, 3)), w_cam=np.zeros((n, 3)))


class World(Protocol):
    """A simulated world: N agents with cameras, fixed cameras, M targets, occluders.

    ``agent_names``, ``camera_names`` and ``target_names`` are in the order of the arrays of `Snapshot`.
    """

    @property
    def agent_names(self) -> tuple[str, ...]:
        """Names of the N agents."""
        ...

    @property
    def camera_names(self) -> tuple[str, ...]:
        """Names of the C cameras; an agent's camera has the agent's name."""
        ...

    @property
    def target_names(self) -> tuple[str, ...]:
        """Names of the M targets."""
        ...

    @property
    def control_dt_s(self) -> float:
        """Length of one control period, s."""
        ...

    def reset(self, rng: np.random.Generator) -> Snapshot:
        """Put everything at its start; ``rng`` drives starts, wind and targets until the next reset."""
        ...

    def step(self, command: CameraCommand) -> Snapshot:
        """Advance by one control period under a constant command.

        Raises
        ------
        SimulationError
            A body's state is not finite or has left the domain; the message names the body and the step.
        """
        ...

    def rays_clear(self, origins: Array, points: Array) -> BoolArray:
        """Tell, for K sight lines from ``origins`` (K,3) to ``points`` (K,3), which of them nothing blocks.

        Occluders, agents and targets block; the agent around the origin, the target that a point belongs to,
        and the ground do not. Returns (K,).
        """
        ...

    def render(self, camera: int, width: int, height: int) -> NDArray[np.uint8]:
        """Picture (height, width, 3), RGB, that a camera sees; its intrinsics scaled to that size."""
        ...

    def set_state(self, snapshot: Snapshot) -> None:
        """Pose every body as in ``snapshot`` (for pictures of a recorded run); `reset` ends the replay."""
        ...

    def close(self) -> None:
        """Free the engine; the world cannot be used afterwards."""
        ...


@runtime_checkable
class Foresees(Protocol):
    """A world that can tell its targets' true future, for upper bounds."""

    def foresee(self, target: int, t_s: Array) -> tuple[Array, Array]:
        """Poses (K, 3), (K, 4) that a target will have at times (K,), or had, since the last reset."""
        ...


class Flown(NamedTuple):
    """What came of several control periods: the truth after them, and what is counted in each.

    Attributes
    ----------
    snapshot : the truth at the end; its collisions are those of the last period
    square_m2ps2 : squared speeds of all agents at the ends of all periods, added up, m^2/s^2
    contacts : time, s, and pairs that touched of every period; empty if nothing touched in any
    """

    snapshot: Snapshot
    square_m2ps2: float
    contacts: tuple[tuple[float, tuple[tuple[str, str], ...]], ...]


@runtime_checkable
class Steers(Protocol):
    """A world whose agents can fly several control periods by themselves."""

    @property
    def can_steer(self) -> bool:
        """Whether `fly` can be used here; it does what `World.step` does with the autopilot's commands."""
        ...

    def fly(self, autopilot: Autopilot, periods: int) -> Flown:
        """Advance by ``periods`` control periods, each under the command that the autopilot gives at its start.

        Raises
        ------
        SimulationError
            As in `World.step`.
        """
        ...
