"""Open the worlds of a training run on the batch back end."""

from __future__ import annotations

from dataclasses import dataclass

from camnet.agents import AgentContext, network_contexts
from camnet.env.batch_handoff import BatchHandoff
from camnet.training.rows import FeatureRows
from camnet.training.settings import TrainSettings

__all__ = ["WorldRows", "open_worlds"]


@dataclass(frozen=True, eq=False)
class WorldRows:
    """One world: its name, its rows, the fixed facts of the agents of one environment."""

    name: str
    rows: FeatureRows
    known: tuple[AgentContext, ...]


def open_worlds(settings: TrainSettings) -> list[WorldRows]:
    """Open every world with its share of the environments.

    Raises
    ------
    ConfigError
        A world does not exist, has no agents, or has something that the batch back end has not.
    """
    share = max(1, settings.environments // len(settings.worlds))
    return [_open(world, share, settings) for world in settings.worlds]


def _open(world: str, environments: int, settings: TrainSettings) -> WorldRows:
    env = BatchHandoff(
        world,
        environments=environments,
        filter_name=settings.estimator,
        threads=settings.threads,
        max_cycles=settings.max_cycles,
    )
    known = tuple(network_contexts(env.network, env.layout, env.settings.gaze_max_rad).values())
    return WorldRows(world, FeatureRows(env, known), known)
