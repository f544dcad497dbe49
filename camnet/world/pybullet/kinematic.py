"""Agents that obey the thesis' kinematic model: the camera moves as commanded plus a bounded disturbance.

``p_c' = u_l + d_l``, ``q_c' = 1/2 B(q_c) (u_a + d_a)`` (harris2020 (4-2)). The quaternion is integrated exactly for
the angular velocity held during a physics step. The disturbance is smooth: each component is a sinusoid of
random frequency and phase with amplitude ``disturbance / sqrt(3)``, so ``||d_l||`` and ``||d_a||`` stay within
``disturbance``. The body follows its camera, level and with a constant heading.
"""

from __future__ import annotations

import numpy as np
import pybullet as pb

from camnet.geometry.rotations import exp, multiply, rotate
from camnet.types import Array
from camnet.world.protocol import CameraCommand
from camnet.world.pybullet.engine import Engine
from camnet.world.settings import PhysicsSettings

__all__ = ["KinematicMotion", "disturbance"]

_FREQUENCY_RANGE_RADPS = (0.5, 4.0)


def disturbance(t_s: float, amplitude: float, frequency: Array, phase: Array) -> Array:
    """Bounded disturbance (N,6) at ``t_s``: its first and last three components have norm <= ``amplitude``."""
    return np.asarray(amplitude / np.sqrt(3.0) * np.sin(frequency * t_s + phase))


class KinematicMotion:
    """Kinematic actuation of N agents; ``camera`` (N,13) is p, q (scalar first), v (world), w (camera)."""

    def __init__(self, engine: Engine, physics: PhysicsSettings, substeps: int) -> None:
        self._engine, self._substeps = engine, substeps
        self._physics = physics
        self._offset = np.array(physics.gimbal.offset_m)

    def reset(
        self,
        numbers: list[int],
        p_world: Array,
        q: Array,
        camera_p: Array,
        camera_q: Array,
        rng: np.random.Generator,
    ) -> None:
        """Start at rest: bodies at ``p_world`` (N,3), ``q`` (N,4), cameras at ``camera_p``, ``camera_q``."""
        n = len(numbers)
        self._q_body = q
        self._engine.watch(True)
        self._arm = rotate(q, np.broadcast_to(self._offset, (n, 3)))
        self._frequency = rng.uniform(*_FREQUENCY_RANGE_RADPS, size=(n, 6))
        self._phase = rng.uniform(0.0, 2.0 * np.pi, size=(n, 6))
        self._steps = 0
        self.camera = np.hstack([camera_p, camera_q, np.zeros((n, 6))])
        self.bodies = np.hstack([p_world, np.roll(q, -1, axis=1), np.zeros((n, 6))])
        self.adopt(numbers)
        self._place()

    def adopt(self, numbers: list[int]) -> None:
        """Move the bodies ``numbers`` of the engine from now on, wherever they are."""
        self._numbers = numbers
        inertia = list(self._physics.quadrotor.inertia_kgm2)
        for number in numbers:
            self._engine.make_free(number, self._physics.quadrotor.mass_kg, inertia)

    def _place(self) -> None:
        for number, body in zip(self._numbers, self.bodies.tolist(), strict=True):
            self._engine.place(number, body[:3], body[3:7])
            pb.resetBaseVelocity(number, (0, 0, 0), (0, 0, 0), self._engine.client)

    def hold(self, command: CameraCommand) -> bool:
        """Take the command of the next control period; False if it is not finite."""
        self._command = command
        return bool(np.isfinite(command.v_world).all() and np.isfinite(command.w_cam).all())

    def step(self) -> set[tuple[str, str]]:
        """Move for one control period; returns the pairs of names that touched."""
        command = self._command
        dt, n = 1.0 / self._physics.step_hz, len(self._numbers)
        p, q = self.camera[:, :3], self.camera[:, 3:7]
        v, w = np.zeros((n, 3)), np.zeros((n, 3))
        for _ in range(self._substeps):
            d = disturbance(self._steps * dt, self._physics.disturbance, self._frequency, self._phase)
            v, w = command.v_world + d[:, :3], command.w_cam + d[:, 3:]
            p = p + dt * v
            q = multiply(q, exp(dt * w))
            self._steps += 1
        q = q / np.linalg.norm(q, axis=1, keepdims=True)
        self.camera = np.hstack([p, q, v, w])
        self.bodies = np.hstack([p - self._arm, np.roll(self._q_body, -1, axis=1), v, np.zeros((n, 3))])
        if not np.isfinite(self.bodies).all():
            return set()  # the engine must not see it; the world raises
        self._place()
        pb.stepSimulation(self._engine.client)  # finds contacts; the poses are overwritten anyway
        touched = self._engine.contacts()
        self._place()
        return touched
