"""The list of shipped worlds."""

from __future__ import annotations

import difflib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from camnet.config import RecordedScenario, load_scenario, shipped_worlds
from camnet.config.models import Scenario
from camnet.errors import ConfigError
from camnet.geometry.settings import Box, Cylinder, Shape

__all__ = ["WorldSummary", "describe", "names", "path"]


@dataclass(frozen=True, slots=True)
class WorldSummary:
    """What a world is and how many of each thing it holds.

    ``kind`` is ``mobile`` (agents only), ``fixed`` (fixed cameras only), ``mixed`` or ``recorded``; ``size_m`` is the
    extent along x and y of its regions, roads and fixed cameras, m.
    """

    name: str
    description: str
    path: Path
    kind: str
    regions: int
    agents: int
    fixed_cameras: int
    targets: int
    size_m: tuple[float, float]


def names() -> tuple[str, ...]:
    """Return the names of the shipped worlds, sorted."""
    return tuple(shipped_worlds())


def path(name: str) -> Path:
    """Return the world file of a shipped world.

    Raises
    ------
    ConfigError
        When no such world ships with camnet.
    """
    worlds = shipped_worlds()
    if name not in worlds:
        close = difflib.get_close_matches(name, worlds, 1)
        hint = f"did you mean {close[0]!r}?" if close else f"shipped worlds: {', '.join(worlds)}"
        raise ConfigError(f"world: value {name!r}: no such shipped world: {hint}")
    return worlds[name]


def describe(name: str) -> WorldSummary:
    """Load a shipped world and count what is in it.

    Raises
    ------
    ConfigError
        When no such world ships with camnet.
    """
    file = path(name)
    scenario = load_scenario(file)
    if isinstance(scenario, RecordedScenario):
        return WorldSummary(scenario.name, scenario.description, file, "recorded", 0, 0, 0, 0, (0.0, 0.0))
    return WorldSummary(
        name=scenario.name,
        description=scenario.description,
        path=file,
        kind=_kind(scenario),
        regions=len(scenario.regions),
        agents=len(scenario.agents),
        fixed_cameras=len(scenario.fixed_cameras),
        targets=len(scenario.targets),
        size_m=_size_m(scenario),
    )


def _kind(scenario: Scenario) -> str:
    if scenario.agents and scenario.fixed_cameras:
        return "mixed"
    return "fixed" if scenario.fixed_cameras else "mobile"


def _size_m(scenario: Scenario) -> tuple[float, float]:
    """Extent along x and y of regions, roads and fixed cameras, m."""
    points = [point for region in scenario.regions for point in _corners(region.shape)]
    points += [point for road in scenario.roads for point in road.points_m]
    points += [camera.pose.position_m[:2] for camera in scenario.fixed_cameras]
    low, high = np.min(points, axis=0), np.max(points, axis=0)
    return float(high[0] - low[0]), float(high[1] - low[1])


def _corners(shape: Shape) -> list[tuple[float, float]]:
    """Corners of a shape's bounding box, or its vertices, seen from above, m."""
    if isinstance(shape, Box):
        return [shape.min_m[:2], shape.max_m[:2]]
    if isinstance(shape, Cylinder):
        (x, y), r = shape.center_m, shape.radius_m
        return [(x - r, y - r), (x + r, y + r)]
    return [(vertex[0], vertex[1]) for vertex in shape.vertices_m]
