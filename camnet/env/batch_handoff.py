"""The handoff environment, many at once, on the batch back end: arrays in, arrays out.

>>> from camnet.env.batch_handoff import BatchHandoff
>>> env = BatchHandoff("quickstart", environments=256, filter_name="frozen", max_cycles=600)
>>> observations = env.reset(seed=1)                    # (E, N, D) float32, fields as in `camnet.env.layout`
>>> step = env.step(actions)                            # actions (E, N, 5) in [-1, 1], as in `handoff_v0`

The same equations, seeds, observations and rewards as `camnet.env.handoff_v0` (the sensors' noise, who fails when and
which messages get lost are the same number for number), without PyBullet: nothing is rendered, and bodies that touch
do not push each other. Observations are flat arrays. Interfaces for training libraries are in
`camnet.env.batch_vector`.

An agent that fails keeps its row: in the step in which it fails the row has its last observation and
``BatchStep.failed`` is true; from then on ``BatchStep.alive`` is false, its observation is zero and its action is not
looked at. When the last agent of an environment fails, the episode is terminated.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from camnet.batch.frozen_model import FrozenModel, load_frozen
from camnet.batch.loop import DECISIONS, REWARD, TERMINATED, TIME
from camnet.batch.network import Shown
from camnet.batch.simulation import FILTERS, BatchSimulation
from camnet.batch.state import CYCLE, RETURN
from camnet.config.load import load_scenario
from camnet.config.models import Scenario
from camnet.copies import ExactCopies
from camnet.env.batch_failures import BatchFailures
from camnet.env.batch_messages import BatchMessages, Present, shared_rows
from camnet.env.batch_modes import batch_mode
from camnet.env.checks import Stage, checked_count, checked_rows, checked_seed
from camnet.env.encode import BeliefEncoder, BeliefRows
from camnet.env.layout import ObservationLayout
from camnet.env.messages import messages_are_perfect
from camnet.env.presets import preset_options
from camnet.env.settings import EnvSettings, RewardSettings, merged_settings
from camnet.errors import ConfigError
from camnet.simulation.network import Network, build_network
from camnet.types import Array, BoolArray, IntArray

__all__ = ["BatchHandoff", "BatchStep", "batch_filter"]


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
    failed : (E, N) agents that failed in this step
    alive : (E, N) agents that work, in the episode that ``observations`` are of
    """

    observations: NDArray[np.float32]
    rewards: Array
    terminated: BoolArray
    truncated: BoolArray
    finished: dict[int, dict[str, Any]]
    last: NDArray[np.float32]
    failed: BoolArray
    alive: BoolArray


class BatchHandoff(ExactCopies):
    """E handoff environments, stepped together; copies go on like the original, on threads of their own.

    Parameters
    ----------
    world : name of a shipped world, path of a world file or recipe, a scenario, or an id of `camnet.env.presets`,
        whose options then are the defaults
    environments : E
    overrides : settings to change, as ``key=value``
    filter_name : ``learned``, ``frozen``, ``ekf`` or ``oracle``: where the agents' estimates come from; with one target
        also ``learned_shared``, which then is ``learned``
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
        environments = checked_count("environments", environments)
        threads = None if threads is None else checked_count("threads", threads)
        world, options = preset_options(world, options)
        scenario = world if isinstance(world, Scenario) else load_scenario(world, overrides)
        if not isinstance(scenario, Scenario):
            raise ConfigError(f"world = {world!r}: the handoff environment needs a network")
        self.settings = _checked(settings, options)
        self.network: Network = build_network(scenario)
        if self.network.n_agents == 0:
            raise ConfigError(f"world {scenario.name!r} has no agents: an environment needs at least one")
        self.max_cycles, self.auto_reset = self.settings.max_cycles, auto_reset
        self.environments, self.n_agents = environments, self.network.n_agents
        self.possible_agents = [agent.name for agent in scenario.agents]
        self._all, self._seed = np.arange(environments), scenario.seed
        #: seeds of the present episodes
        self.seeds: list[int] = [scenario.seed] * environments
        self._running, self._stage = np.zeros(environments, dtype=bool), Stage()
        self._open_rules()
        held = load_frozen(self.network, model) if isinstance(model, str | Path) else model
        duration_s = self.max_cycles / scenario.run.decision_hz
        shown = _shown(self.settings, self._mode.in_world)
        self.simulation = BatchSimulation(
            self.network,
            shown,
            environments,
            batch_filter(filter_name, self.network),
            held,
            threads,
            duration_s,
        )
        self.layout = ObservationLayout(self.network.n_targets, self.simulation.model.neighbours)
        self._encoder = BeliefEncoder(self.network, self.layout)

    def _open_rules(self) -> None:
        """Set up what actions mean, who fails, and who hears what."""
        settings, network, e = self.settings, self.network, self.environments
        dt_s = self._dt_s = 1.0 / network.scenario.run.decision_hz
        self._failures = BatchFailures(settings.failures, self.possible_agents, dt_s, e)
        failing = self._failures.possible
        self._mode = batch_mode(network, settings, e, failing)
        #: space of one agent's actions
        self.action_space = self._mode.space()
        perfect = messages_are_perfect(network, settings) and not failing
        self._messages = None if perfect else BatchMessages(network, settings, e)
        self._beliefs: BeliefRows | None = None

    @property
    def alive(self) -> BoolArray:
        """Which agents (E, N) work now."""
        return self._failures.alive.copy()

    @property
    def agents_can_fail(self) -> bool:
        """Whether anybody can fail at all."""
        return self._failures.possible

    def action_masks(self) -> NDArray[np.int8] | None:
        """Which actions (E, N, A) mean something now; None where all do, as in modes other than ``assign``."""
        return None if self._beliefs is None else self._mode.mask(self._beliefs)

    def reset(
        self,
        seeds: Sequence[int] | None = None,
        *,
        seed: int | None = None,
        environments: Sequence[int] | None = None,
    ) -> NDArray[np.float32]:
        """Start episodes; return all observations (E, N, D).

        Parameters
        ----------
        seeds : one for each environment that is started
        seed : where ``seeds`` are not given, the first of consecutive ones; without either the sequence goes on
        environments : which to start (default: all)

        Raises
        ------
        ConfigError
            A seed is no whole number from 0 on, there is no such environment, or the environments are closed.
        """
        self._stage.open("reset")
        chosen = checked_rows("environments", environments, self.environments)
        if seeds is None:
            first = self._seed + 1 if seed is None else checked_seed(seed)
            seeds = range(first, first + len(chosen))
        if len(seeds) != len(chosen):
            raise ConfigError(f"seeds: {len(seeds)} given for {len(chosen)} environments")
        numbers = [checked_seed(s) for s in seeds]
        if numbers:
            self._seed = max(numbers)
        self._start(chosen, numbers)
        self._stage.begin()
        return self.simulation.observations

    def begin_again(self, seeds: Mapping[int, int]) -> NDArray[np.float32]:
        """Start the episodes of ``seeds`` (environment to seed) anew, beside the sequence of `reset`.

        Returns all observations (E, N, D), as `reset` does.
        """
        self._start(np.array(list(seeds), dtype=np.int64), list(seeds.values()))
        return self.simulation.observations

    def _start(self, chosen: IntArray, seeds: list[int]) -> None:
        """Start episodes: physics, failures and messages, which draw from generators of their own."""
        for e, seed in zip(chosen.tolist(), seeds, strict=True):
            self.seeds[e] = seed
        self.simulation.reset(chosen, seeds)
        self._mode.reset(chosen)
        if self._messages is not None:
            for e, seed in zip(chosen.tolist(), seeds, strict=True):
                children = np.random.SeedSequence([seed, 1]).spawn(2)
                self._messages.reset(e, np.random.default_rng(children[0]))
                self._failures.reset(e, np.random.default_rng(children[1]))
        self._running[chosen] = True
        self._exchange(chosen)

    def step(self, actions: NDArray[Any]) -> BatchStep:
        """Fly one decision period with actions (E, N, 5) in [-1, 1] or, in mode ``assign``, (E, N) whole numbers.

        Raises
        ------
        ConfigError
            The actions are not in their space, an environment was not started, or all are closed. Nothing has moved
            then.
        """
        self._stage.begun("step")
        if not self._running.all():
            e = int(np.argmin(self._running))
            raise ConfigError(f"environment {e}: its episode has ended or not begun; call reset first")
        simulation, before = self.simulation, self.alive
        cameras = simulation.gather("cameras") if self._mode.in_world else _NO_CAMERAS
        simulation.step(self._mode.ask(actions, before, cameras, self._beliefs))
        failed = self._fail()
        self._exchange(self._all)
        if not before.all():
            simulation.observations[~before] = 0.0
        rewards = simulation.outcome[:, REWARD].copy()
        terminated = simulation.outcome[:, TERMINATED] > 0.0
        if self._failures.possible:
            terminated |= ~self._failures.alive.any(axis=1)
        truncated = (simulation.outcome[:, DECISIONS] >= self.max_cycles) & ~terminated
        last = simulation.observations
        ended = np.flatnonzero(terminated | truncated)
        finished = {int(e): self._figures(int(e)) for e in ended}
        self._running[ended] = False
        observations = last
        if ended.size and self.auto_reset:
            observations = self.reset(environments=ended.tolist())
        return BatchStep(observations, rewards, terminated, truncated, finished, last, failed, self.alive)

    def _fail(self) -> BoolArray:
        """Let agents fail; return who did in this decision (E, N)."""
        if not self._failures.possible:
            return np.zeros((self.environments, self.n_agents), dtype=bool)
        failed = self._failures.draw(self.simulation.outcome[:, TIME])
        if failed.any():
            self.simulation.set_working(self._failures.alive & (self.settings.cameras == "on"))
        return failed

    def _exchange(self, rows: IntArray) -> None:
        """Let the agents of the environments ``rows`` hear what is due, and show them what they then believe."""
        if self._messages is None and not self._mode.needs_beliefs:
            return
        now = self._present(rows)
        if self._messages is None:
            beliefs = shared_rows(now, self.n_agents)
        else:
            beliefs = self._messages.exchange(rows, now)
            shown = self.simulation.observations[rows]
            self._encoder.write_rows(shown, beliefs)
            self.simulation.observations[rows] = shown
        if self._beliefs is None or len(rows) == self.environments:
            self._beliefs = beliefs
        else:
            self._beliefs = _replaced(self._beliefs, rows, beliefs)

    def _present(self, rows: IntArray) -> Present:
        simulation = self.simulation
        cameras = simulation.gather("cameras")[rows, :, :3]
        working = np.ones(cameras.shape[:2], dtype=bool)
        working[:, : self.n_agents] = self._failures.alive[rows]
        return Present(
            t_s=simulation.outcome[rows, TIME],
            estimate=simulation.gather("estimate")[rows],
            entries=simulation.gather("entries")[rows],
            visible=simulation.gather("visible")[rows] > 0,
            cameras_p=cameras,
            working=working,
        )

    def _figures(self, e: int) -> dict[str, Any]:
        clock = self.simulation.clock(e)
        length = int(clock[CYCLE])
        over = {"return": float(clock[RETURN]), "length": length, "duration_s": length * self._dt_s}
        return {**over, **self.simulation.episode(e)}

    def close(self) -> None:
        """End the threads; nothing happens where that was done before."""
        self._stage.close()
        self.simulation.close()


def batch_filter(name: str, network: Network) -> str:
    """Return what the batch back end calls an estimator of `camnet.simulation.filters`.

    Raises
    ------
    ConfigError
        It has no such estimator, or not for so many targets.
    """
    if name == "learned_shared":
        if network.n_targets == 1:
            return "learned"  # nobody to share with
        raise ConfigError(
            f"filter_name = 'learned_shared' with {network.n_targets} targets: on the batch back end every target has "
            "a model of its own"
        )
    if name not in FILTERS:
        raise ConfigError(f"filter_name = {name!r}: the batch back end has {', '.join(FILTERS)}")
    return name


#: stands for the cameras where nobody asks where they are
_NO_CAMERAS = np.zeros((0, 0, 13))


def _replaced(beliefs: BeliefRows, rows: IntArray, new: BeliefRows) -> BeliefRows:
    """Beliefs with those of the environments ``rows`` renewed."""
    parts: list[Any] = [np.array(part) for part in beliefs]
    for part, value in zip(parts, new, strict=True):
        part[rows] = value
    return BeliefRows(*parts)


def _checked(settings: EnvSettings | None, options: dict[str, Any]) -> EnvSettings:
    """Return settings with single options in place; those that this back end does not follow must be the defaults."""
    full = merged_settings(settings, options)
    if full.observation_form != "flat":
        raise ConfigError(
            f"observation_form = {full.observation_form!r}: the batch back end has 'flat' only; "
            "`camnet.env.layout.ObservationLayout.named` names the parts of a row"
        )
    return full


def _shown(settings: EnvSettings, in_world: bool) -> Shown:
    r: RewardSettings = settings.reward
    return Shown(
        gaze_max_rad=settings.gaze_max_rad,
        neighbours=settings.neighbours,
        communication_range_m=settings.communication_range_m,
        rewards=(r.in_view, r.reacquired, r.lost, r.effort, r.region_exit, r.collision),
        terminate_on_collision=settings.terminate_on_collision,
        lost_limit_s=math.inf if settings.lost_limit_s is None else settings.lost_limit_s,
        in_world=in_world,
        every_entry=settings.score == "v1",
        cameras_on=settings.cameras == "on",
    )
