"""The handoff environment, many at once, on the batch back end: arrays in, arrays out.

>>> from camnet.env.batch_handoff import BatchHandoff
>>> env = BatchHandoff("quickstart", environments=256, filter_name="frozen", max_cycles=600)
>>> observations = env.reset(seed=1)                    # (E, N, D) float32, fields as in `camnet.env.layout`
>>> step = env.step(actions)                            # actions (E, N, 5) in [-1, 1], as in `handoff_v0`

The same equations, seeds, observations and rewards as `camnet.env.handoff_v0` (the sensors' noise is the same number
for number), without PyBullet: nothing is rendered, and bodies that touch do not push each other. Interfaces for
training libraries are in `camnet.env.batch_vector`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from camnet.batch.frozen_model import FrozenModel, load_frozen
from camnet.batch.loop import REWARD, TERMINATED
from camnet.batch.network import Shown
from camnet.batch.simulation import BatchSimulation
from camnet.batch.state import CYCLE, RETURN
from camnet.config.load import load_scenario
from camnet.config.models import Scenario
from camnet.env.layout import ObservationLayout
from camnet.env.settings import EnvSettings, RewardSettings
from camnet.errors import ConfigError
from camnet.simulation.network import Network, build_network
from camnet.types import Array, BoolArray

__all__ = ["BatchHandoff", "BatchStep"]

#: fields of the environment's settings that this back end follows; the others must keep their defaults
_FOLLOWED = (
    "max_cycles",
    "gaze_max_rad",
    "neighbours",
    "communication_range_m",
    "terminate_on_collision",
    "lost_limit_s",
    "reward",
    "region_guard",
)


@dataclass(frozen=True, eq=False, slots=True)
class BatchStep:
    """What a step returns, for E environments with N agents.

    Attributes
    ----------
    observations : (E, N, D) float32; of the next episode where one has ended
    rewards : (E,) shared by an environment's agents
    terminated, truncated : (E,)
    finished : figures of the episodes that have ended, by environment: ``return``, ``length`` and those of
        `camnet.simulation.statistics.RunStatistics.episode`
    last : (E, N, D) the last observations of the episodes that have ended; elsewhere the present ones
    """

    observations: NDArray[np.float32]
    rewards: Array
    terminated: BoolArray
    truncated: BoolArray
    finished: dict[int, dict[str, Any]]
    last: NDArray[np.float32]


class BatchHandoff:
    """E handoff environments, stepped together.

    Parameters
    ----------
    world : name of a shipped world, path of a world file or recipe, or a scenario
    environments : E
    overrides : settings to change, as ``key=value``
    filter_name : ``learned``, ``frozen``, ``ekf`` or ``oracle``: where the agents' estimates come from
    model : for ``frozen``: what was learned before, or a file of learned models (default: a warm-up of 200 s)
    threads : how many threads work (default: one a processor)
    auto_reset : start the next episode as soon as one ends
    settings : how the network is shown and rewarded
    options : single fields of ``settings`` by name, e.g. ``max_cycles=200``

    Raises
    ------
    ConfigError
        World or settings ask for something that this back end has not; the message names it.
    """

    def __init__(
        self,
        world: str | Path | Scenario = "quickstart",
        environments: int = 64,
        *,
        overrides: Sequence[str] = (),
        filter_name: str = "frozen",
        model: FrozenModel | Path | str | None = None,
        threads: int | None = None,
        auto_reset: bool = True,
        settings: EnvSettings | None = None,
        **options: Any,  # noqa: ANN401 - fields of EnvSettings
    ) -> None:
        scenario = world if isinstance(world, Scenario) else load_scenario(world, overrides)
        if not isinstance(scenario, Scenario):
            raise ConfigError(f"world = {world!r}: the handoff environment needs a network")
        self.settings = _checked(settings, options)
        self.network: Network = build_network(scenario)
        self.max_cycles, self.auto_reset = self.settings.max_cycles, auto_reset
        held = load_frozen(self.network, model) if isinstance(model, str | Path) else model
        duration_s = self.max_cycles / scenario.run.decision_hz
        self.simulation = BatchSimulation(
            self.network, _shown(self.settings), environments, filter_name, held, threads, duration_s
        )
        self.environments, self.n_agents = environments, self.network.n_agents
        self.possible_agents = [agent.name for agent in scenario.agents]
        neighbours = self.simulation.model.neighbours
        self.layout = ObservationLayout(self.network.n_targets, neighbours)
        self._seed = scenario.seed
        self._running = np.zeros(environments, dtype=bool)

    def reset(
        self,
        seeds: Sequence[int] | None = None,
        *,
        seed: int | None = None,
        environments: Sequence[int] | None = None,
    ) -> NDArray[np.float32]:
        """Start episodes; return all observations (E, N, D), a copy.

        Parameters
        ----------
        seeds : one for each environment that is started
        seed : where ``seeds`` are not given, the first of consecutive ones; without either the sequence goes on
        environments : which to start (default: all)
        """
        chosen = (
            np.arange(self.environments) if environments is None else np.asarray(environments, dtype=np.int64)
        )
        if seeds is None:
            first = self._seed + 1 if seed is None else seed
            seeds = range(first, first + len(chosen))
        if len(seeds) != len(chosen):
            raise ConfigError(f"seeds: {len(seeds)} given for {len(chosen)} environments")
        if len(seeds):
            self._seed = max(seeds)
        self.simulation.reset(chosen, [int(s) for s in seeds])
        self._running[chosen] = True
        return self.simulation.observations.copy()

    def step(self, actions: NDArray[Any]) -> BatchStep:
        """Fly one decision period with actions (E, N, 5) in [-1, 1]; see `camnet.env.handoff_v0`.

        Raises
        ------
        ConfigError
            The actions have another shape or are not finite, or an environment was not started.
        """
        flat = np.asarray(actions)
        shape = (self.environments, self.n_agents, 5)
        if flat.shape != shape or not np.isfinite(flat).all():
            raise ConfigError(f"actions of shape {flat.shape}: finite numbers of shape {shape} were expected")
        if not self._running.all():
            e = int(np.argmin(self._running))
            raise ConfigError(f"environment {e}: its episode has ended or not begun; call reset first")
        simulation = self.simulation
        simulation.step(flat)
        rewards = simulation.outcome[:, REWARD].copy()
        terminated = simulation.outcome[:, TERMINATED] > 0.0
        truncated = (simulation.gather("clock")[:, CYCLE] >= self.max_cycles) & ~terminated
        last = simulation.observations.copy()
        ended = np.flatnonzero(terminated | truncated)
        finished = {int(e): self._figures(int(e)) for e in ended}
        self._running[ended] = False
        observations = last
        if ended.size and self.auto_reset:
            observations = self.reset(environments=ended.tolist())
        return BatchStep(observations, rewards, terminated, truncated, finished, last)

    def _figures(self, e: int) -> dict[str, Any]:
        clock = self.simulation.clock(e)
        return {"return": float(clock[RETURN]), "length": int(clock[CYCLE]), **self.simulation.episode(e)}

    def close(self) -> None:
        """End the threads."""
        self.simulation.close()


def _checked(settings: EnvSettings | None, options: dict[str, Any]) -> EnvSettings:
    """Return settings with single options in place; those that this back end does not follow must be the defaults."""
    if "max_steps" in options:
        options = {**options, "max_cycles": options["max_steps"]}
        del options["max_steps"]
    unknown = sorted(set(options) - set(EnvSettings.model_fields))
    if unknown:
        known = ", ".join(EnvSettings.model_fields)
        raise ConfigError(f"unknown option {unknown[0]!r} of the handoff environment; known are {known}")
    base = EnvSettings() if settings is None else settings
    try:
        full = EnvSettings.model_validate({**base.model_dump(), **options})
    except ValueError as error:
        raise ConfigError(f"options of the handoff environment: {error}") from error
    default = EnvSettings()
    for name in EnvSettings.model_fields:
        if name not in _FOLLOWED and getattr(full, name) != getattr(default, name):
            raise ConfigError(
                f"{name} = {getattr(full, name)!r}: the batch back end has {getattr(default, name)!r} only"
            )
    return full


def _shown(settings: EnvSettings) -> Shown:
    r: RewardSettings = settings.reward
    return Shown(
        gaze_max_rad=settings.gaze_max_rad,
        neighbours=settings.neighbours,
        communication_range_m=settings.communication_range_m,
        rewards=(r.in_view, r.reacquired, r.lost, r.effort, r.region_exit, r.collision),
        terminate_on_collision=settings.terminate_on_collision,
        lost_limit_s=math.inf if settings.lost_limit_s is None else settings.lost_limit_s,
    )
