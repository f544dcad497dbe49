"""What every kind of target motion offers."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from camnet.types import Array, Twist

__all__ = ["TargetMotion", "TargetState", "planar_state"]


@dataclass(frozen=True, eq=False, slots=True)
class TargetState:
    """Pose and velocity of one target, and what its class keeps for itself.

    Attributes
    ----------
    p_world : (3,) m, on the ground
    q_world : (4,) body (x forward, z up) to world, scalar first, continuous in sign
    v_world : (3,) m/s
    w_body : (3,) rad/s
    internal : (k,) the class's own state, opaque to others
    """

    p_world: Array
    q_world: Array
    v_world: Array
    w_body: Array
    internal: Array


class TargetMotion(Protocol):
    """How one target moves: pure functions of the state, the time and a generator."""

    @property
    def v_max_mps(self) -> float:
        """Bound on the linear speed, m/s: no state exceeds it."""

    @property
    def w_max_radps(self) -> float:
        """Bound on the angular speed, rad/s: no state exceeds it."""

    def reset(self, rng: np.random.Generator) -> TargetState:
        """Return the state at time 0."""

    def step(self, state: TargetState, t_s: float, dt_s: float, rng: np.random.Generator) -> TargetState:
        """Advance from ``t_s`` to ``t_s + dt_s``."""

    def velocity(self, p_world: Array, q_world: Array, t_s: float) -> Twist | None:
        """Return the true velocity (world frame, body frame) at a pose, or None where pose does not decide it."""


def planar_state(
    x: float, y: float, z: float, heading: float, v: float, w: float, internal: tuple[float, ...]
) -> TargetState:
    """Return the state of a vehicle that drives forward at ``v`` m/s and turns at ``w`` rad/s.

    ``heading`` (rad) is not wrapped, so that the quaternion does not jump to its negative.
    """
    half = 0.5 * heading
    pose = (x, y, z, math.cos(half), 0.0, 0.0, math.sin(half))
    velocity = (v * math.cos(heading), v * math.sin(heading), 0.0, 0.0, 0.0, w)
    all_of_it = np.array(pose + velocity + internal)  # one array, cut up: five would cost five times as much
    return TargetState(all_of_it[:3], all_of_it[3:7], all_of_it[7:10], all_of_it[10:13], all_of_it[13:])
