"""Flights of plans around obstacles by a quadrotor in the physics engine.

One agent in a room with a wall, boxes and pillars drawn at random has to cross it. References come from
`camnet.control.planner.pilot`, the sliding-mode law follows them, and the engine reports every contact.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from camnet.control.planner.obstacles import from_shape
from camnet.control.planner.pilot import pilots
from camnet.control.references import ReferenceGenerator
from camnet.control.settings import ControllerSettings
from camnet.control.sliding_mode import SlidingModeController
from camnet.geometry.regions import BoxRegion
from camnet.geometry.settings import Box, CameraModel, Cylinder, Intrinsics, Shape
from camnet.types import Array
from camnet.world.description import AgentSpec, OccluderSpec, WorldDescription
from camnet.world.protocol import CameraCommand
from camnet.world.pybullet import PyBulletWorld
from camnet.world.settings import PhysicsSettings

__all__ = ["Flight", "draw_room", "fly"]

_LENGTH, _WIDTH, _HEIGHT = 12.0, 6.0, 4.0
_CAMERA = CameraModel(
    name="gimbal_cam",
    intrinsics=Intrinsics(width_px=640, height_px=480, fx_px=420, fy_px=420, cx_px=320, cy_px=240),
)


@dataclass(frozen=True, eq=False, slots=True)
class Flight:
    """One crossing: contacts, whether and when (s) it arrived, least distance of the camera to a solid (m), path."""

    touched: tuple[tuple[str, str], ...]
    arrived: bool
    time_s: float
    clearance_m: float
    inside: bool
    detoured: bool
    path: Array


def draw_room(rng: np.random.Generator, count: int = 4) -> list[Shape]:
    """Boxes and pillars one behind the other along the room, the first one across the straight way."""
    shapes: list[Shape] = []
    for k in range(count):
        x = 3.0 + 6.0 * k / max(count - 1, 1) + rng.uniform(-0.3, 0.3)
        y = rng.uniform(-0.4, 0.4) if k == 0 else rng.uniform(-1.5, 1.5)
        if rng.random() < 0.5:
            shapes.append(
                Cylinder(type="cylinder", center_m=(x, y), radius_m=rng.uniform(0.2, 0.5), z_m=(0.0, 4.0))
            )
        else:
            wide, low = rng.uniform(0.3, 0.8), rng.uniform(1.5, 4.0)
            shapes.append(Box(min_m=(x - 0.25, y - wide, 0.0), max_m=(x + 0.25, y + wide, low)))
    return shapes


def fly(seed: int, limit_s: float = 40.0, actuation: str = "quadrotor") -> Flight:
    """Cross one random room; ends on arrival within 0.1 m or after ``limit_s``."""
    rng = np.random.default_rng(seed)
    shapes = draw_room(rng)
    region = BoxRegion("room", (0.0, -0.5 * _WIDTH, 0.0), (_LENGTH, 0.5 * _WIDTH, _HEIGHT))
    start, goal = np.array([0.8, rng.uniform(-1, 1), 1.5]), np.array([_LENGTH - 0.8, rng.uniform(-1, 1), 1.5])
    settings = ControllerSettings()
    agent = AgentSpec("quad", start, 0.0, _CAMERA, region)
    occluders = tuple(OccluderSpec(f"solid_{k}", shape) for k, shape in enumerate(shapes))
    physics = PhysicsSettings.model_validate({"actuation": actuation})
    world = PyBulletWorld(WorldDescription(physics, settings.rate_hz, (agent,), (), occluders))
    try:
        return _cross(world, settings, region, shapes, start, goal, limit_s, rng)
    finally:
        world.close()


def _cross(
    world: PyBulletWorld, settings: ControllerSettings, region: BoxRegion, shapes: list[Shape], start: Array,
    goal: Array, limit_s: float, rng: np.random.Generator,
) -> Flight:  # fmt: skip
    dt = world.control_dt_s
    generator = ReferenceGenerator(
        settings, [region], np.zeros(1), dt, pilots(settings, [region], shapes, dt)
    )
    controller = SlidingModeController(settings)
    now = world.reset(rng)
    state = generator.start(now.camera_p_world[:1])
    touched: set[tuple[str, str]] = set()
    path, arrived, steps, far = [now.camera_p_world[0]], False, 0, 0.0
    inside = True
    along = (goal - start) / np.linalg.norm(goal - start)
    while steps * dt < limit_s and not arrived:
        control = controller.control(
            now.camera_p_world[:1], now.camera_q_world[:1], generator.reference(state)
        )
        now = world.step(CameraCommand(control.v_world, control.w_cam, control.a_world))
        state = generator.step(state, goal[None], np.zeros((1, 2)))
        touched |= set(now.collisions)
        inside = inside and bool(region.contains(now.agent_p_world[0]))
        p = now.camera_p_world[0]
        path.append(p)
        away = p - start - ((p - start) @ along) * along
        far = max(far, float(np.linalg.norm(away)))
        arrived = float(np.linalg.norm(p - goal)) < 0.1
        steps += 1
    track = np.array(path)
    solids = [from_shape(shape) for shape in shapes]
    clearance = min(s.signed_distance(p) for s in solids for p in track[::3])
    return Flight(tuple(sorted(touched)), arrived, steps * dt, clearance, inside, far > 0.3, track)
