"""Building the bodies of a world: occluders, agents, targets, ground, roads."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from camnet.geometry.rotations import IDENTITY
from camnet.types import Array
from camnet.world.description import TargetSpec, WorldDescription
from camnet.world.pybullet.engine import Engine
from camnet.world.pybullet.shapes import box, cylinder, pieces, sheet

__all__ = ["TARGET_COLORS", "Scene", "build_scene", "complete_scene", "draw_scenery"]

#: colours of targets in turn, RGBA
TARGET_COLORS = ((0.85, 0.1, 0.1, 1.0), (0.1, 0.25, 0.85, 1.0), (0.75, 0.1, 0.75, 1.0), (0.9, 0.6, 0.0, 1.0))
_GROUND_COLOR = (0.62, 0.68, 0.58, 1.0)
_ROAD_COLOR = (0.35, 0.35, 0.38, 1.0)
_OCCLUDER_COLOR = (0.55, 0.5, 0.45, 1.0)
_AGENT_COLOR = (0.15, 0.15, 0.18, 1.0)
#: quadrilaterals in one mesh
_QUADS_MAX = 2000
#: longest edge of a ground tile, m, and how many tiles an edge may have
_TILE_M, _TILES_MAX = 10.0, 12


@dataclass(frozen=True, eq=False, slots=True)
class Scene:
    """Body numbers of agents (N) and, once they have bodies, targets (M)."""

    agents: list[int]
    targets: list[int]


def _extent(description: WorldDescription) -> tuple[Array, Array]:
    """Corner points (2,), (2,) of the ground to draw."""
    points = [a.start_p_world[:2] for a in description.agents] + [c.p_world[:2] for c in description.cameras]
    points += [np.array(p) for road in description.roads for p in road.points_m]
    cloud = np.array(points) if points else np.zeros((1, 2))
    return cloud.min(axis=0) - 15.0, cloud.max(axis=0) + 15.0


def _draw_ground(engine: Engine, description: WorldDescription) -> None:
    """Ground in tiles of two shades: the software renderer shades large triangles badly."""
    low, high = _extent(description)
    count = np.clip(np.ceil((high - low) / _TILE_M), 1, _TILES_MAX).astype(int)
    tile = (high - low) / count
    i, j = (x.ravel() for x in np.meshgrid(*(np.arange(n) for n in count), indexing="ij"))
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    flat = low + tile * (np.stack([i, j], axis=1)[:, None, :] + corners)
    quads = np.concatenate([flat, np.full((*flat.shape[:2], 1), -0.004)], axis=2)
    for odd, shade in ((0, 0.94), (1, 1.0)):
        chosen = quads[(i + j) % 2 == odd]
        if len(chosen):
            r, g, b, a = _GROUND_COLOR
            engine.add_picture(sheet(chosen), (r * shade, g * shade, b * shade, a))


def _draw_roads(engine: Engine, description: WorldDescription) -> None:
    quads = []
    for road in description.roads:
        points = np.array(road.points_m)
        ends = np.roll(points, -1, axis=0) if road.closed else points[1:]
        for a, b in zip(points[: len(ends)], ends, strict=True):
            along = (b - a) / max(float(np.hypot(*(b - a))), 1e-9)
            side = 0.5 * road.width_m * np.array([-along[1], along[0]])
            a, b = a - 0.3 * road.width_m * along, b + 0.3 * road.width_m * along
            quads.append([[*corner, 0.0] for corner in (a - side, b - side, b + side, a + side)])
    for k in range(0, len(quads), _QUADS_MAX):
        engine.add_picture(sheet(np.array(quads[k : k + _QUADS_MAX])), _ROAD_COLOR)


def _add_target(engine: Engine, k: int, target: TargetSpec) -> int:
    solid = box(np.array(target.size_m), np.zeros(3), lift=0.5 * target.size_m[2])
    waiting, color = (0.0, 0.0, -100.0), TARGET_COLORS[k % len(TARGET_COLORS)]
    if target.marker is not None:
        from camnet.world.pybullet.plate import add_marked  # OpenCV, for markers only

        return add_marked(engine, target.name, solid, waiting, color, target.marker)
    return engine.add(target.name, solid, waiting, IDENTITY, color)


def build_scene(engine: Engine, description: WorldDescription) -> Scene:
    """Create occluders and agents, which wait at the origin far below until they are placed; no targets yet."""
    for occluder in description.occluders:
        for solid in pieces(occluder.shape, occluder.name):
            engine.add(occluder.name, solid, solid.origin.tolist(), IDENTITY, _OCCLUDER_COLOR)
    quad = description.physics.quadrotor
    agents = [
        engine.add(
            agent.name,
            cylinder(quad.arm_m, quad.height_m, np.zeros(3)),
            (10.0 * k, 0.0, -100.0),
            IDENTITY,
            _AGENT_COLOR,
            quad.mass_kg,
        )
        for k, agent in enumerate(description.agents)
    ]
    return Scene(agents, [])


def complete_scene(engine: Engine, description: WorldDescription, scene: Scene) -> None:
    """Create ground and targets, which wait far below: the engine looks at them in every step, so only when needed."""
    engine.add_ground()
    scene.targets.extend(_add_target(engine, k, target) for k, target in enumerate(description.targets))


def draw_scenery(engine: Engine, description: WorldDescription) -> None:
    """Create what is only seen, ground and roads: the engine keeps books of it in every step, so not before it is."""
    _draw_ground(engine, description)
    _draw_roads(engine, description)
