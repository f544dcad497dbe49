"""Open the worlds of a training run on the batch back end."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from camnet.agents import AgentContext, network_contexts
from camnet.agents.together import build_together
from camnet.env.batch_handoff import BatchHandoff
from camnet.env.batch_vector import sb3_vec_env
from camnet.training.rows import FeatureRows, Rule
from camnet.training.settings import TrainSettings

__all__ = ["WorldRows", "open_worlds", "rule_on_rows"]


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
    known = network_contexts(env.network, env.layout, env.settings.gaze_max_rad)
    base = rule_on_rows(settings.residual_of, known, environments) if settings.residual_of else None
    rows = FeatureRows(sb3_vec_env(env), tuple(known.values()), base, settings.residual_scale)
    return WorldRows(world, rows, tuple(known.values()))


def rule_on_rows(agent: str, known: Mapping[str, AgentContext], environments: int, seed: int = 0) -> Rule:
    """Built-in agent ``agent`` on the rows of so many environments."""
    team = build_together(agent, known, range(seed, seed + environments))
    everybody = np.ones((environments, len(known)), dtype=bool)

    def act(shown: NDArray[np.float32]) -> NDArray[np.float32]:
        return team(shown.reshape(environments, len(known), -1), everybody).reshape(len(shown), -1)

    return act
