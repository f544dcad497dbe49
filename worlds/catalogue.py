"""The list of shipped worlds."""

from __future__ import annotations

import difflib
from dataclasses import dataclass
from pathlib import Path

from camnet.config import RecordedScenario, load_scenario, shipped_worlds
from camnet.errors import ConfigError

__all__ = ["WorldSummary", "describe", "names", "path"]


@dataclass(frozen=True, slots=True)
class WorldSummary:
    """What a world is and how many of each thing it holds."""

    name: str
    description: str
    path: Path
    regions: int
    agents: int
    fixed_cameras: int
    targets: int


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
        return WorldSummary(scenario.name, scenario.description, file, 0, 0, 0, 0)
    return WorldSummary(
        name=scenario.name,
        description=scenario.description,
        path=file,
        regions=len(scenario.regions),
        agents=len(scenario.agents),
        fixed_cameras=len(scenario.fixed_cameras),
        targets=len(scenario.targets),
    )
