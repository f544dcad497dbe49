"""`PyBulletWorld`: the protocol of `camnet.world.protocol` on PyBullet. Composition only; the parts are beside it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np
import pybullet as pb
from numpy.typing import NDArray

from camnet.control.camera_kernel import body_motion, first_unsound
from camnet.control.flight_kernel import INVALID
from camnet.copies import ExactCopies
from camnet.errors import SimulationError, WorldError
from camnet.geometry.rotations import STRAIGHT_DOWN, from_yaw, multiply, rotate
from camnet.types import Array, BoolArray, Snapshot
from camnet.world.description import WorldDescription
from camnet.world.foresight import Foresight
from camnet.world.protocol import CameraCommand, Flown
from camnet.world.pybullet.engine import Engine, xyzw
from camnet.world.pybullet.flight import Flight
from camnet.world.pybullet.kinematic import KinematicMotion
from camnet.world.pybullet.picture import picture, projection_matrix, view_matrix
from camnet.world.pybullet.scene import build_scene, complete_scene, draw_scenery
from camnet.world.pybullet.sight import rays_clear
from camnet.world.targets import Targets

if TYPE_CHECKING:
    from camnet.control.autopilot import Autopilot

__all__ = ["PyBulletWorld"]


def _ball(size_m: tuple[float, float, float]) -> float:
    """Radius of the ball about the foot of a target's box that holds it, m."""
    return math.hypot(0.5 * size_m[0], 0.5 * size_m[1], size_m[2])


class PyBulletWorld(ExactCopies):
    """A world simulated by PyBullet; see `camnet.world.protocol.World` for the contract.

    A copy has a physics client of its own and goes on like the original, bit for bit where nothing touches. The client
    is freed by `close`, or when nobody holds the world any more.

    Parameters
    ----------
    description : what the world is made of
    """

    def __init__(self, description: WorldDescription) -> None:
        d = self.description = description
        self.agent_names = tuple(a.name for a in d.agents)
        self.camera_names = self.agent_names + tuple(c.name for c in d.cameras)
        self.target_names = tuple(t.name for t in d.targets)
        self._substeps, self._step_hz = d.substeps, d.physics.step_hz
        self.control_dt_s = d.substeps / d.physics.step_hz
        self._models = [a.camera for a in d.agents] + [c.camera for c in d.cameras]
        self._fixed = np.zeros((len(d.cameras), 13))
        for row, camera in zip(self._fixed, d.cameras, strict=True):
            row[:3], row[3:7] = camera.p_world, camera.q_world
        self._offset = np.array(d.physics.gimbal.offset_m)
        self._yaw = np.array([a.start_yaw_rad for a in d.agents])
        self._body_q = from_yaw(self._yaw).reshape(len(d.agents), 4)
        self._camera_p = np.array([a.start_p_world for a in d.agents], dtype=float).reshape(-1, 3)
        self._start_p = self._camera_p - rotate(
            self._body_q, np.broadcast_to(self._offset, self._camera_p.shape)
        )
        quad = d.physics.quadrotor
        self._agent_radius = float(np.hypot(quad.arm_m, quad.height_m / 2) + 1e-3)
        self._command_shape = (len(d.agents), 3)
        # balls about the targets: centre, radius, speed
        self._balls = np.array([[0.0, 0.0, 0.0, _ball(t.size_m), t.motion.v_max_mps] for t in d.targets])
        self._balls = self._balls.reshape(-1, 5)
        self._is_kinematic = d.physics.actuation == "kinematic"
        self._can_always_touch = self._is_kinematic or bool(d.occluders)
        self._engine = Engine(d.physics, 1 if self._is_kinematic else d.flight_substeps)
        self._flight = Flight(self._engine, d.physics, self.control_dt_s, d.flight_substeps)
        self._kinematic = KinematicMotion(self._engine, d.physics, d.substeps)
        self._targets = Targets(self.target_names, [t.motion for t in d.targets], self.control_dt_s)
        self._snapshot: Snapshot | None = None

    def __getstate__(self) -> dict[str, Any]:
        alive = self._snapshot is not None and self._engine.client >= 0
        return {**self.__dict__, "_saved": self._engine.save() if alive else None}

    def __setstate__(self, state: dict[str, Any]) -> None:
        saved = state.pop("_saved")
        self.__dict__.update(state)
        if saved is not None:
            self._rebuild(saved)

    def _rebuild(self, saved: bytes) -> None:
        """Give the copy's engine, which is empty, the bodies of the original, in the same order, and their state."""
        self._scene = build_scene(self._engine, self.description)
        (self._kinematic if self._is_kinematic else self._flight).adopt(self._scene.agents)
        if self._complete:
            complete_scene(self._engine, self.description, self._scene)
        if self._drawn:
            draw_scenery(self._engine, self.description)
        self._engine.load(saved)
        self._placed = self._boxes_fresh = False

    def reset(self, rng: np.random.Generator) -> Snapshot:
        """Put everything at its start; see the protocol."""
        self._check_open()
        self._engine.restart()
        self._scene, self._drawn = build_scene(self._engine, self.description), False
        self._complete = False
        self._autopilot: Autopilot | None = None
        air_rng, *target_rngs = rng.spawn(1 + len(self.target_names))
        states = self._targets.reset(target_rngs)
        self._step, self._t_s = 0, 0.0
        laws = [t.motion for t in self.description.targets]
        self._foresight = Foresight(laws, states, target_rngs, self.control_dt_s)
        if self._is_kinematic:
            camera_q = multiply(self._body_q, STRAIGHT_DOWN).reshape(-1, 4)
            poses = (self._start_p, self._body_q, self._camera_p, camera_q)
            self._kinematic.reset(self._scene.agents, *poses, air_rng)
        else:
            start = (self._start_p, self._yaw, self._body_q, self._offset)
            self._flight.reset(self._scene.agents, *start, air_rng)
        self._placed = False
        return self._observe((), self._motion_now())

    def step(self, command: CameraCommand) -> Snapshot:
        """Advance by one control period; see the protocol."""
        self._check_shapes(command)
        watch = self._hold(command)
        self._move_targets(watch)
        touched = self._kinematic.step() if self._is_kinematic else self._flight.step(watch)
        self._count_steps()
        return self._observe(tuple(sorted(touched)) if touched else (), self._motion_now())

    @property
    def can_steer(self) -> bool:
        """Whether agents are bodies with an inner loop, and not moved as commanded."""
        return not self._is_kinematic

    def fly(self, autopilot: Autopilot, periods: int) -> Flown:
        """Advance by several control periods of an autopilot; see the protocol."""
        flight, motion, square = self._flight, self._board(autopilot), 0.0
        contacts: list[tuple[float, tuple[tuple[str, str], ...]]] = []
        touching = False
        for _ in range(periods):
            found = flight.begin(self._targets.now)
            if found == INVALID:
                raise SimulationError(f"step {self._step}: a command is not finite: motion {motion}")
            watch = found != 0 or self._can_always_touch
            self._move_targets(watch)
            touched, before_s = flight.step(watch), self._t_s
            self._count_steps()
            unsound, squares = flight.end()
            if unsound >= 0:
                self._diverged(unsound, flight.bodies)
            square += squares
            autopilot.monitor.ended(self._t_s - before_s)
            touching = touching or bool(touched)
            contacts.append((self._t_s, tuple(sorted(touched)) if touched else ()))
        snapshot = self._observe(contacts[-1][1], motion.copy())
        return Flown(snapshot, square, tuple(contacts) if touching else ())

    def _board(self, autopilot: Autopilot) -> Array:
        """Return the motion that the autopilot reads, as it is now."""
        if autopilot is not self._autopilot:
            self._autopilot = autopilot
            own = (self._agent_radius, self._balls, self._offset, self._fixed, self._start_p)
            self._steered = self._flight.board(autopilot, len(self.camera_names), *own)
        self._steered[...] = self._motion
        return self._steered

    def _count_steps(self) -> None:
        self._step += self._substeps
        self._t_s = self._step / self._step_hz

    def _hold(self, command: CameraCommand) -> bool:
        """Take the command; whether anything may touch in its period, by distances and speeds alone."""
        if self._is_kinematic:
            found = 1 if self._kinematic.hold(command) else INVALID
        else:
            self._balls[:, :3] = self._targets.now[:, :3]
            found = self._flight.hold(command, self._agent_radius, self._balls)
        if found == INVALID:
            self._name_what_is_not_finite(command)
        return found != 0 or self._can_always_touch

    def foresee(self, target: int, t_s: Array) -> tuple[Array, Array]:
        """Return the true poses of a target at any times; see the protocol."""
        self._current()
        return self._foresight.poses(target, t_s)

    def _check_open(self) -> None:
        if self._engine.client < 0:
            raise WorldError("this world is closed; build a new one")

    def _check_shapes(self, command: CameraCommand) -> None:
        shape, a_world = self._command_shape, command.a_world
        if command.v_world.shape == shape == command.w_cam.shape and (
            a_world is None or a_world.shape == shape
        ):
            return
        for name in ("v_world", "w_cam", "a_world"):
            value = getattr(command, name)
            if value is not None and value.shape != shape:
                raise WorldError(f"command.{name} has shape {value.shape}, should be {shape}")

    def _name_what_is_not_finite(self, command: CameraCommand) -> None:
        for name in ("v_world", "w_cam", "a_world"):
            value = getattr(command, name)
            if value is not None and not np.isfinite(value).all():
                body = self.agent_names[int(np.nonzero(~np.isfinite(value))[0][0])]
                raise SimulationError(
                    f"step {self._step}: command.{name} of agent {body!r} is not finite: {value}"
                )

    def _diverged(self, k: int, bodies: Array) -> NoReturn:
        limits = self.description.physics
        raise SimulationError(
            f"step {self._step}: agent {self.agent_names[k]!r} diverged: position {bodies[k, :3]} m, "
            f"velocity {bodies[k, 7:10]} m/s (limits: {limits.range_limit_m:g} m from the start, "
            f"{limits.speed_limit_mps:g} m/s)"
        )

    def _move_targets(self, watch: bool) -> None:
        """Move the targets by a control period, and their bodies where something may touch them."""
        self._targets.advance(self._t_s, self._step)
        self._placed = False
        if watch:
            self._sync_targets()

    def _complete_scene(self) -> None:
        """Give bodies to the ground and the targets, if they have none yet."""
        if not self._complete:
            complete_scene(self._engine, self.description, self._scene)
            self._complete = True

    def _sync_targets(self) -> None:
        """Put the targets' bodies where the targets are: only what touches, looks or draws needs them there."""
        self._complete_scene()
        if not self._placed:
            self._placed = True
            for number, state in zip(self._scene.targets, self._targets.now, strict=True):
                self._engine.place(number, state[:3].tolist(), xyzw(state[3:7]))

    def _motion_now(self) -> Array:
        """Motion (N+C,13) of the agents, their cameras and the fixed ones, which rest."""
        if not self._is_kinematic:
            unsound, motion = self._flight.observe(self._offset, self._fixed, self._start_p)
            if unsound >= 0:
                self._diverged(unsound, self._flight.bodies)
            return motion
        bodies, limits = self._kinematic.bodies, self.description.physics
        unsound = first_unsound(bodies, self._start_p, limits.range_limit_m, limits.speed_limit_mps)
        if unsound >= 0:
            self._diverged(unsound, bodies)
        return np.concatenate([body_motion(bodies), self._kinematic.camera, self._fixed])

    def _observe(self, collisions: tuple[tuple[str, str], ...], motion: Array) -> Snapshot:
        n, targets = len(self.agent_names), self._targets.now
        self._motion = motion
        bodies, cameras = motion[:n], motion[n:]
        self._snapshot = Snapshot(
            t_s=self._t_s,
            step=self._step,
            agent_p_world=bodies[:, :3],
            agent_q_world=bodies[:, 3:7],
            agent_v_world=bodies[:, 7:10],
            agent_w_body=bodies[:, 10:13],
            camera_p_world=cameras[:, :3],
            camera_q_world=cameras[:, 3:7],
            camera_v_world=cameras[:, 7:10],
            camera_w_cam=cameras[:, 10:13],
            target_p_world=targets[:, :3],
            target_q_world=targets[:, 3:7],
            target_v_world=targets[:, 7:10],
            target_w_body=targets[:, 10:13],
            collisions=collisions,
        )
        self._boxes_fresh = False
        return self._snapshot

    def _current(self) -> Snapshot:
        if self._snapshot is None:
            raise WorldError("reset() the world before using it")
        return self._snapshot

    def rays_clear(self, origins: Array, points: Array) -> BoolArray:
        """Tell which sight lines nothing blocks; see the protocol."""
        now = self._current()
        self._sync_targets()
        if not self._boxes_fresh:  # the engine's bounding boxes lag one step behind the poses
            pb.performCollisionDetection(physicsClientId=self._engine.client)
            self._boxes_fresh = True
        sizes = (t.size_m for t in self.description.targets)
        poses = zip(now.target_p_world, now.target_q_world, sizes, strict=True)
        targets = dict(zip(self._scene.targets, poses, strict=True))
        return rays_clear(self._engine, origins, points, now.agent_p_world, self._agent_radius, targets)

    def render(self, camera: int, width: int, height: int) -> NDArray[np.uint8]:
        """Picture that a camera sees; see the protocol. An agent does not see itself."""
        now, model = self._current(), self._models[camera]
        self._sync_targets()
        if not self._drawn:
            draw_scenery(self._engine, self.description)
            self._drawn = True
        near = model.near_m
        if camera < len(self.agent_names):
            near = max(near, self._agent_radius + float(np.linalg.norm(self._offset)))
        view = view_matrix(now.camera_p_world[camera], now.camera_q_world[camera])
        projection = projection_matrix(model.intrinsics, near, max(3.0 * model.far_m, 2.0 * near))
        return picture(self._engine, view, projection, width, height)

    def set_state(self, snapshot: Snapshot) -> None:
        """Pose every body as in ``snapshot``; see the protocol."""
        self._current()
        self._complete_scene()
        for k, number in enumerate(self._scene.agents):
            self._engine.place(number, snapshot.agent_p_world[k].tolist(), xyzw(snapshot.agent_q_world[k]))
        for k, number in enumerate(self._scene.targets):
            self._engine.place(number, snapshot.target_p_world[k].tolist(), xyzw(snapshot.target_q_world[k]))
        self._snapshot, self._boxes_fresh, self._placed = snapshot, False, True

    def close(self) -> None:
        """Free the engine; see the protocol."""
        self._engine.close()
