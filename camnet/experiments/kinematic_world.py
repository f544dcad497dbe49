"""A world without physics for networks of fixed cameras: targets move by their own laws, nothing flies or falls.

The closed loop runs on it unchanged, sensors and estimators included, several times faster than on the rigid-body
engine; with no agents and nothing to collide with, both show the estimator the same thing.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from camnet.errors import WorldError
from camnet.motion.protocol import TargetState
from camnet.types import Array, BoolArray, Snapshot
from camnet.world.description import WorldDescription
from camnet.world.foresight import Foresight
from camnet.world.protocol import CameraCommand

__all__ = ["KinematicWorld"]


class KinematicWorld:
    """Targets in motion before fixed cameras.

    Raises
    ------
    WorldError
        If the world has agents or occluders: both need the rigid-body engine.
    """

    def __init__(self, description: WorldDescription) -> None:
        if description.agents or description.occluders:
            raise WorldError("a world with agents or occluders cannot run without physics")
        self._description = description
        self._count = 0
        self._rng = np.random.default_rng(0)
        self._states: list[TargetState] = []

    @property
    def agent_names(self) -> tuple[str, ...]:
        """No agents."""
        return ()

    @property
    def camera_names(self) -> tuple[str, ...]:
        """Names of the cameras."""
        return tuple(c.name for c in self._description.cameras)

    @property
    def target_names(self) -> tuple[str, ...]:
        """Names of the targets."""
        return tuple(t.name for t in self._description.targets)

    @property
    def control_dt_s(self) -> float:
        """Length of one step, s."""
        return 1.0 / self._description.control_hz

    def reset(self, rng: np.random.Generator) -> Snapshot:
        """Put the targets at their starts."""
        self._count, self._rng = 0, rng
        motions = [t.motion for t in self._description.targets]
        self._states = [motion.reset(rng) for motion in motions]
        self._foresight = Foresight(motions, self._states, [rng] * len(motions), self.control_dt_s)
        return self._snapshot()

    def step(self, command: CameraCommand) -> Snapshot:
        """Move the targets by one step; there is nothing to command."""
        dt, t = self.control_dt_s, self._count * self.control_dt_s
        self._states = [
            target.motion.step(state, t, dt, self._rng)
            for target, state in zip(self._description.targets, self._states, strict=True)
        ]
        self._count += 1
        return self._snapshot()

    def foresee(self, target: int, t_s: Array) -> tuple[Array, Array]:
        """Return the true poses of a target at any times."""
        return self._foresight.poses(target, t_s)

    def rays_clear(self, origins: Array, points: Array) -> BoolArray:
        """Nothing blocks."""
        return np.ones(len(points), dtype=bool)

    def render(self, camera: int, width: int, height: int) -> NDArray[np.uint8]:
        """There are no pictures."""
        raise WorldError("a world without physics draws no pictures")

    def set_state(self, snapshot: Snapshot) -> None:
        """There is nothing to pose."""

    def close(self) -> None:
        """There is nothing to free."""

    def _snapshot(self) -> Snapshot:
        none3, none4 = np.zeros((0, 3)), np.zeros((0, 4))
        cameras, states = self._description.cameras, self._states
        still = np.zeros((len(cameras), 3))
        return Snapshot(
            t_s=self._count * self.control_dt_s,
            step=self._count,
            agent_p_world=none3,
            agent_q_world=none4,
            agent_v_world=none3,
            agent_w_body=none3,
            camera_p_world=np.array([c.p_world for c in cameras]),
            camera_q_world=np.array([c.q_world for c in cameras]),
            camera_v_world=still,
            camera_w_cam=still,
            target_p_world=np.array([s.p_world for s in states]),
            target_q_world=np.array([s.q_world for s in states]),
            target_v_world=np.array([s.v_world for s in states]),
            target_w_body=np.array([s.w_body for s in states]),
        )
