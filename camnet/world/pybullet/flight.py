"""Agents as rigid bodies in the engine: the inner loop makes forces and torques, the engine integrates."""

from __future__ import annotations

import struct
from collections.abc import Sequence, Set

import numpy as np
import pybullet as pb

from camnet.control.autopilot import Autopilot
from camnet.control.flight_kernel import begin_period, end_period
from camnet.control.period_kernel import COCKPIT, Cockpit, begin_flight, continue_flight
from camnet.control.quadrotor import QuadrotorModel
from camnet.control.quadrotor_kernel import MEMORY, pack_model, step_packed, turn_gimbals
from camnet.control.trim import trimmed
from camnet.geometry.rotations import rotate
from camnet.types import Array
from camnet.world.protocol import CameraCommand
from camnet.world.pybullet.engine import Engine, xyzw
from camnet.world.settings import PhysicsSettings, WindSettings

__all__ = ["Flight", "model_from_settings"]

_NOBODY: Set[tuple[str, str]] = frozenset()
#: how far an acceleration carries an agent in a control period beyond its velocity, generously, m
_REACH_M = 0.1


def model_from_settings(physics: PhysicsSettings, substeps: int = 1) -> QuadrotorModel:
    """Constants of the inner loop, one period of which takes ``substeps`` physics steps."""
    q, g = physics.quadrotor, physics.gimbal
    return QuadrotorModel(
        dt_s=substeps / physics.step_hz,
        substeps=substeps,
        mass_kg=q.mass_kg,
        inertia_kgm2=np.array(q.inertia_kgm2),
        arm_m=q.arm_m,
        thrust_coefficient=q.thrust_n_per_rad2ps2,
        torque_coefficient=q.torque_nm_per_rad2ps2,
        rotor_max_radps=q.rotor_max_radps,
        motor_lag_s=q.motor_lag_s,
        rotor_response_s=q.rotor_response_s,
        drag_n_per_mps=np.array(q.drag_n_per_mps),
        gravity_mps2=physics.gravity_mps2,
        v_max_mps=q.v_max_mps,
        a_max_mps2=q.a_max_mps2,
        velocity_gain_per_s=q.velocity_gain_per_s,
        velocity_integral_per_s2=q.velocity_integral_per_s2,
        attitude_radps=2.0 * np.pi * q.attitude_hz,
        attitude_damping=q.attitude_damping,
        gimbal_rate_max_radps=g.rate_max_radps,
        gimbal_lag_s=g.lag_s,
        gimbal_pan_max_rad=g.pan_max_rad,
    )


class Flight:
    """The full rigid-body actuation of N agents.

    ``bodies`` (N,13) and ``memory`` (N,19) are the packed state of `camnet.control.quadrotor_kernel`.
    """

    def __init__(self, engine: Engine, physics: PhysicsSettings, control_dt_s: float, substeps: int) -> None:
        self._engine = engine
        self._physics = physics
        self._model = model_from_settings(physics, substeps)
        self._periods, self._substeps = round(control_dt_s / self._model.dt_s), substeps
        self._constants = pack_model(self._model)
        self._control_dt_s = control_dt_s
        self._numbers: list[int] = []

    def reset(
        self,
        numbers: list[int],
        p_world: Array,
        yaw: Array,
        q: Array,
        offset_body: Array,
        rng: np.random.Generator,
    ) -> None:
        """Start at rest in hover at ``p_world`` (N,3), orientation ``q`` (N,4), trimmed to the mean wind.

        In a wind bodies lean into it, and their cameras, ``offset_body`` (3,) off them, are where they would be else.
        """
        n = len(numbers)
        self._rng = rng
        self.adopt(numbers)
        wind = self._physics.wind
        self.memory = np.zeros((n, 19))
        self.memory[:, MEMORY["thrust_axis"]] = (0.0, 0.0, 1.0)
        lift = self._model.mass_kg * self._model.gravity_mps2 / 4.0
        self.memory[:, :4] = np.sqrt(lift / self._model.thrust_coefficient)
        if n and any(wind.mean_mps):
            level, heading = q, np.column_stack([np.cos(yaw), np.sin(yaw)])
            q, self.memory = trimmed(self._constants, heading, np.array(wind.mean_mps))
            offset = np.broadcast_to(offset_body, (n, 3))
            p_world = p_world + rotate(level, offset) - rotate(q, offset)
        for i, number in enumerate(numbers):
            self._engine.place(number, p_world[i].tolist(), xyzw(q[i]))
            pb.resetBaseVelocity(number, (0, 0, 0), (0, 0, 0), self._engine.client)
        self._command, self._wrench = np.zeros((n, 13)), np.zeros((n, 6))
        self._loads = self._wrench.reshape(n, 2, 3)  # force and torque of each
        self._asked = np.zeros((4, n, 3))
        self._command[:, 9] = yaw
        self._gust, self._no_feedforward = np.zeros((n, 3)), np.zeros((n, 3))
        self._mean_wind = np.tile(np.array(wind.mean_mps), (n, 1))
        if wind.gust_std_mps > 0:
            self._gust = rng.normal(scale=wind.gust_std_mps, size=(n, 3))
        self.bodies, self._before = np.zeros((n, 13)), np.zeros((n, 13))
        self._row_format = f"{13 * n}d"
        self._read()

    def adopt(self, numbers: list[int]) -> None:
        """Fly the bodies ``numbers`` of the engine from now on, wherever they are."""
        self._numbers = numbers
        for number in numbers:
            self._engine.make_free(number, self._model.mass_kg, self._model.inertia_kgm2.tolist())

    def _read(self) -> None:
        """Poses and velocities from the engine into ``bodies``."""
        c, position, velocity = self._engine.client, pb.getBasePositionAndOrientation, pb.getBaseVelocity
        flat: list[float] = []
        for b in self._numbers:
            (p, q), (v, w) = position(b, c), velocity(b, c)
            flat += (*p, *q, *v, *w)
        struct.pack_into(self._row_format, self.bodies.data, 0, *flat)

    def _wind(self, wind: WindSettings, dt: float) -> Array:
        """Mean wind plus a first-order Gauss-Markov gust of each agent, (N,3)."""
        if wind.gust_std_mps == 0:
            return self._mean_wind
        decay = np.exp(-dt / wind.gust_time_s)
        noise = self._rng.normal(scale=wind.gust_std_mps, size=self._gust.shape)
        self._gust = decay * self._gust + np.sqrt(1.0 - decay * decay) * noise
        return self._mean_wind + self._gust

    def hold(self, command: CameraCommand, radius: float, balls: Array) -> int:
        """Take the command of the next control period: 1 if anything may touch in it, 0 if not, -1 if not finite.

        ``radius``, ``balls``: see `camnet.control.camera_kernel.may_touch`.
        """
        return int(
            begin_period(
                self.bodies,
                self.memory,
                self._command,
                self._constants,
                command.v_world,
                command.w_cam,
                self._no_feedforward if command.a_world is None else command.a_world,
                self._wind(self._physics.wind, self._control_dt_s),
                self._wrench,
                radius,
                balls,
                _REACH_M,
                self._control_dt_s,
            )
        )

    def step(self, watch: bool) -> Set[tuple[str, str]]:
        """Fly for the control period whose command is held; returns the pairs of names that touched.

        ``watch``: something may touch. Contacts are then looked up after every physics step; else nobody is asked.
        The gimbals have yet to make their last turn: `observe`.
        """
        self._engine.watch(watch)
        if not watch and self._periods == 1:
            self._push(self.bodies[:, :3].tolist())
            self._before[...] = self.bodies
            self._read()
            return _NOBODY
        touched: set[tuple[str, str]] = set()
        for period in range(self._periods):
            if period:
                turn_gimbals(self._before, self.bodies, self.memory, self._command, self._constants)
                step_packed(self.bodies, self.memory, self._command, self._constants, self._wrench)
            self._push(self.bodies[:, :3].tolist())
            if watch:
                touched |= self._engine.contacts()
                for _ in range(self._substeps - 1):
                    self._push(self._points())
                    touched |= self._engine.contacts()
            self._before[...] = self.bodies
            self._read()
        return touched

    def board(
        self,
        autopilot: Autopilot,
        n_cameras: int,
        radius: float,
        balls: Array,
        offset_body: Array,
        fixed: Array,
        start_p: Array,
    ) -> Array:
        """Take an autopilot on board; returns the motion (N+C,13) that `begin` reads and `end` writes.

        ``radius``, ``balls``: see `hold`; the others: see `observe`. The arrays are kept and read at every call.
        """
        self._monitor, limits = autopilot.monitor, self._physics
        motion = np.empty((len(self._numbers) + n_cameras, 13))
        self._air = self._mean_wind.copy()
        self._cockpit = COCKPIT.pin(
            Cockpit(
                **autopilot.packed,
                bodies=self.bodies,
                before=self._before,
                memory=self.memory,
                held=self._command,
                constants=self._constants,
                wrench=self._wrench,
                asked=self._asked,
                motion=motion,
                balls=balls,
                wind=self._air,
                radius=radius,
                reach=_REACH_M,
                offset_body=offset_body,
                fixed=fixed,
                start_p=start_p,
                range_m=limits.range_limit_m,
                speed_mps=limits.speed_limit_mps,
            )
        )
        return motion

    def begin(self, targets: Array) -> int:
        """Take the autopilot's command for the next control period; result as in `hold`.

        ``targets`` (M,13): where the centres of the balls are.
        """
        if self._physics.wind.gust_std_mps > 0:
            self._air[...] = self._wind(self._physics.wind, self._control_dt_s)
        found: int = begin_flight(self._cockpit.at, self._monitor.place, targets)
        return found

    def end(self) -> tuple[int, float]:
        """End a control period of the autopilot: first unsound body (-1: none), and the sum of squared speeds."""
        return continue_flight(self._cockpit.at, self._monitor.place)

    def observe(self, offset_body: Array, fixed: Array, start_p: Array) -> tuple[int, Array]:
        """End a control period; see `camnet.control.flight_kernel.end_period`."""
        limits, n = self._physics, len(self._numbers)
        motion = np.empty((2 * n + len(fixed), 13))
        unsound = end_period(
            self._before,
            self.bodies,
            self.memory,
            self._command,
            self._constants,
            offset_body,
            fixed,
            start_p,
            limits.range_limit_m,
            limits.speed_limit_mps,
            motion,
        )
        return unsound, motion

    def _points(self) -> list[tuple[float, ...]]:
        c = self._engine.client
        return [pb.getBasePositionAndOrientation(body, c)[0] for body in self._numbers]

    def _push(self, points: Sequence[Sequence[float]]) -> None:
        """Apply forces at ``points``, the centres of mass, and torques, and let the engine go on."""
        c, frame = self._engine.client, pb.WORLD_FRAME
        push, twist = pb.applyExternalForce, pb.applyExternalTorque
        for body, (force, torque), point in zip(self._numbers, self._loads.tolist(), points, strict=True):
            push(body, -1, force, point, frame, c)
            twist(body, -1, torque, frame, c)
        pb.stepSimulation(c)
