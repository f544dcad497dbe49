"""The handoff problem as a multi-agent environment (PettingZoo).

>>> from camnet.env import handoff_v0
>>> env = handoff_v0.parallel_env(world="quickstart")
>>> observations, infos = env.reset(seed=1)

Agents are the mobile cameras, one per operating region; fixed cameras are part of the world. What an action is:
`camnet.env.actions`. Observations field by field: `camnet.env.layout`. Rewards and their bound:
`camnet.env.settings`. Late and lost messages: `camnet.env.messages`. Options of ``reset``: `camnet.env.curriculum`.

An agent that fails is terminated at that step and gone from then on; the episode goes on while anybody works. It ends
for all when bodies collide or a target is lost for too long (if so set), and is truncated at ``max_cycles``. A step
after the end returns five empty dictionaries.

Environments can be copied (`copy.deepcopy`, `pickle`): a copy goes on like the original, in a physics client of its
own. The client is freed by ``close``, or when nobody holds the environment any more.
"""

from __future__ import annotations

from collections.abc import Sequence, Set
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray
from pettingzoo import AECEnv, ParallelEnv

from camnet.batch.row_bank import RowFilters, rows_can
from camnet.config.load import load_scenario
from camnet.config.models import Scenario
from camnet.control.setpoints import Setpoint
from camnet.copies import ExactCopies
from camnet.env.actions import SetpointMode, action_mode
from camnet.env.aec import HandoffAEC, OrderedAEC
from camnet.env.beliefs import Beliefs, shared_beliefs
from camnet.env.checks import Stage, checked_seed, named_actions
from camnet.env.curriculum import changed_scenario, changed_settings, read_options
from camnet.env.encode import BeliefEncoder
from camnet.env.failures import Failures
from camnet.env.infos import EpisodeInfos
from camnet.env.map_view import MapView
from camnet.env.messages import Messages, messages_are_perfect
from camnet.env.observe import Observer
from camnet.env.presets import preset_options
from camnet.env.rewards import SharedReward
from camnet.env.settings import EnvSettings, merged_settings
from camnet.env.state import StateEncoder
from camnet.errors import ConfigError
from camnet.simulation.coordination import Task
from camnet.simulation.loop import NetworkSimulation, Setpoints
from camnet.simulation.network import build_network
from camnet.world.pybullet import PyBulletWorld

__all__ = ["HandoffEnv", "env", "parallel_env", "raw_env"]

Observation = NDArray[np.float32] | dict[str, NDArray[np.float32]]
Action = Any


class HandoffEnv(ExactCopies, ParallelEnv[str, Observation, Action]):
    """Handoff environment, parallel form.

    Parameters
    ----------
    world : name of a shipped world, path of a world file or recipe, a scenario, or an id of `camnet.env.presets`, whose
        options then are the defaults
    overrides : settings to change, as ``key=value``
    filter_name : the estimator that the observations come from (`camnet.simulation.filters.FILTERS`)
    render_mode : ``None``, ``"rgb_array"`` or ``"human"``: a window, drawn by ``reset`` and ``step``
    settings : how the network is shown and rewarded
    options : single fields of ``settings`` by name, e.g. ``max_cycles=200``
    """

    metadata = {  # noqa: RUF012 - PettingZoo's convention
        "name": "handoff_v0",
        "render_modes": ["rgb_array", "human"],
        "render_fps": 10,
        "is_parallelizable": True,
    }

    def __init__(
        self,
        world: str | Path | Scenario = "quickstart",
        *,
        overrides: Sequence[str] = (),
        filter_name: str = "learned",
        render_mode: str | None = None,
        settings: EnvSettings | None = None,
        **options: Any,  # noqa: ANN401 - fields of EnvSettings
    ) -> None:
        if render_mode not in (None, "rgb_array", "human"):
            raise ConfigError(f"render_mode = {render_mode!r}: give None, 'rgb_array' or 'human'")
        world, options = preset_options(world, options)
        scenario = world if isinstance(world, Scenario) else load_scenario(world, overrides)
        if not isinstance(scenario, Scenario) or not scenario.agents:
            raise ConfigError(
                f"world = {world!r}: the handoff environment needs a network with at least one agent"
            )
        self.settings = merged_settings(settings, options)
        self.max_cycles = self.settings.max_cycles
        self.render_mode = render_mode
        self.possible_agents = [agent.name for agent in scenario.agents]
        self.agents: list[str] = []
        self._scenario, self._filter_name = scenario, filter_name
        self._seed = scenario.seed
        self._stage, self._view = Stage(), MapView("camnet handoff_v0")
        self._open(scenario)
        layout = self.observer.layout
        dictionary = self.settings.observation_form == "dict"
        self.observation_spaces: dict[str, spaces.Space[Any]] = {
            name: layout.dict_space() if dictionary else layout.space() for name in self.possible_agents
        }
        self.action_spaces = {name: self._mode.space() for name in self.possible_agents}
        self.state_space = self._state.space()

    def _open(self, scenario: Scenario) -> None:
        """Build the simulation of a scenario and everything that looks at it."""
        self.simulation = _open_simulation(scenario, self._filter_name, self.settings)
        self.observer = Observer(self.simulation, self.settings)
        self._state = StateEncoder(self.simulation)
        self._mode = action_mode(self.simulation, self.settings, self.possible_agents)
        self._encoder = BeliefEncoder(self.simulation.network, self.observer.layout)
        self._failures = Failures(self.settings.failures, self.possible_agents, self._dt_s)

    @property
    def _dt_s(self) -> float:
        return 1.0 / self.simulation.network.scenario.run.decision_hz

    def observation_space(self, agent: str) -> spaces.Space[Any]:
        """Space of one agent's observations (the same object every time)."""
        return self.observation_spaces[self._known(agent)]

    def action_space(self, agent: str) -> spaces.Space[Any]:
        """Space of one agent's actions (the same object every time)."""
        return self.action_spaces[self._known(agent)]

    def _known(self, agent: str) -> str:
        if agent not in self.possible_agents:
            raise ConfigError(f"agent {agent!r}: no such agent; there are {', '.join(self.possible_agents)}")
        return agent

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Observation], dict[str, dict[str, Any]]]:
        """Start an episode; without a seed the next one of the sequence is taken.

        Raises
        ------
        ConfigError
            An option that is unknown or out of range (`camnet.env.curriculum` lists them), a seed that is no whole
            number from 0 on, or the environment is closed.
        """
        self._stage.open("reset")
        chosen = read_options(options)
        self._seed = self._seed + 1 if seed is None else checked_seed(seed)
        scenario, settings = changed_scenario(self._scenario, chosen), changed_settings(self.settings, chosen)
        if scenario != self.simulation.network.scenario:
            before = self.simulation.world
            self._open(scenario)
            before.close()
        self._last_cycle = self.max_cycles if chosen.max_cycles is None else chosen.max_cycles
        self.simulation.reset(self._seed)
        self._mode.reset()
        self._start_episode(settings)
        self.agents = list(self.possible_agents)
        self._cycle = 0
        self._reward = SharedReward(self.settings.reward, self._dt_s)
        self._tell = EpisodeInfos(self.settings.info_form == "flat", self.simulation)
        self._stage.begin()
        self._draw()
        return self._observations(), self._infos(self.agents)

    def _start_episode(self, settings: EnvSettings) -> None:
        """Set up messages and failures; both draw from generators of their own."""
        message_rng, failure_rng = (
            np.random.default_rng(child) for child in np.random.SeedSequence([self._seed, 1]).spawn(2)
        )
        self._failures = Failures(settings.failures, self.possible_agents, self._dt_s)
        self._failures.reset(failure_rng)
        perfect = messages_are_perfect(self.simulation.network, settings) and not self._failures.possible
        self._messages = None if perfect else Messages(self.simulation, settings, message_rng)
        self._beliefs = self._exchanged()

    def _exchanged(self) -> Beliefs | None:
        """Return what everybody believes now; None where all share one belief and nothing but observations needs it."""
        if self._messages is not None:
            return self._messages.exchange(self.simulation)
        return self._common() if self.settings.action_mode == "assign" else None

    def _common(self) -> Beliefs:
        return shared_beliefs(self.simulation, self.settings.communication_range_m)

    def beliefs(self) -> Beliefs:
        """Return what every agent believes now."""
        self._stage.begun("beliefs")
        if self._messages is not None and self._beliefs is not None:
            return self._beliefs
        return self._common()

    def step(
        self, actions: dict[str, Action]
    ) -> tuple[
        dict[str, Observation],
        dict[str, float],
        dict[str, bool],
        dict[str, bool],
        dict[str, dict[str, Any]],
    ]:
        """Fly one decision period.

        Raises
        ------
        ConfigError
            An action is missing, not in its space or of nobody; the environment is closed or was never reset. Nothing
            has moved then.
        """
        self._stage.begun("step")
        given = named_actions(actions, self.agents, self.possible_agents)
        if not self.agents:
            return {}, {}, {}, {}, {}
        names = self.agents
        self._mode.fly(self.simulation, given, self._beliefs)
        self._cycle += 1
        self.simulation.statistics.after_decision(self.simulation)
        reward = self._reward(self.simulation)
        failed = self._fail()
        terminated = self._terminated() or len(failed) == len(names)
        truncated = self._cycle >= self._last_cycle and not terminated
        over = terminated or truncated
        self._beliefs = self._exchanged()
        observations = self._observations()
        self.agents = [] if over else [name for name in names if name not in failed]
        self._draw()
        return (
            observations,
            dict.fromkeys(names, reward),
            {name: terminated or name in failed for name in names},
            {name: truncated and name not in failed for name in names},
            self._infos(names, over, failed),
        )

    def check_open(self, call: str) -> None:
        """Raise ConfigError where the environment is closed; ``call`` is named in the message."""
        self._stage.open(call)

    def check_begun(self, call: str) -> None:
        """Raise ConfigError unless the environment was reset and is not closed; ``call`` is named in the message."""
        self._stage.begun(call)

    def check_action(self, agent: str, action: Action) -> None:
        """Raise ConfigError unless ``action`` is one that ``agent`` can take now."""
        self._stage.begun("step")
        self._mode.check(self._known(agent), action)

    def _fail(self) -> set[str]:
        """Let agents fail; return the names of those that failed in this decision."""
        if not self._failures.possible:
            return set()
        alive = self._failures.draw(self.simulation.snapshot.t_s)
        self.simulation.working[: len(alive)] = alive & (self.settings.cameras == "on")
        return {name for j, name in enumerate(self.possible_agents) if not alive[j] and name in self.agents}

    def setpoints(self, actions: dict[str, Action]) -> Setpoints:
        """Return the setpoints that actions of mode ``setpoint`` ask for: positions in the world, gaze angles."""
        if not isinstance(self._mode, SetpointMode):
            raise ConfigError(f"action_mode = {self.settings.action_mode!r}: only 'setpoint' has setpoints")
        self._stage.begun("setpoints")
        return self._mode.setpoints(
            self.simulation, named_actions(actions, self.agents, self.possible_agents)
        )

    def action_of(self, agent: str, task: Task, setpoint: Setpoint) -> Action:
        """Return the action, in this environment's mode, that comes nearest to a task of the built-in system."""
        return self._mode.encode(
            self.simulation, self.possible_agents.index(self._known(agent)), task, setpoint
        )

    def _terminated(self) -> bool:
        if self.settings.terminate_on_collision and self.simulation.snapshot.collisions:
            return True
        limit = self.settings.lost_limit_s
        if limit is None:
            return False
        now = self.simulation.snapshot.t_s
        return any(
            now - f.estimate.last_seen_s > limit for f in self.simulation.driving if f.estimate.region >= 0
        )

    def _observations(self) -> dict[str, Observation]:
        """Observations of the agents that were live in this step."""
        rows = self.observer.observe(self.simulation, self.simulation.entries())
        if self._messages is not None and self._beliefs is not None:
            told = np.array(rows)
            self._encoder.write(told, self._beliefs)
            rows = list(told)
        live = zip(self.possible_agents, rows, strict=True)
        if self.settings.observation_form == "dict":
            return {name: self.observer.layout.named(row) for name, row in live if name in self.agents}
        return {name: row for name, row in live if name in self.agents}

    def _infos(
        self, names: Sequence[str], last: bool = False, failed: Set[str] = frozenset()
    ) -> dict[str, dict[str, Any]]:
        """Certificates at every step, masks in mode ``assign``, who has failed, the figures of a whole episode."""
        infos = self._tell(self.simulation, names, last, failed)
        if self.settings.action_mode == "assign":
            for j, name in enumerate(self.possible_agents):
                if name in infos:
                    infos[name]["action_mask"] = self._mode.mask(self._beliefs, j)
        return infos

    def state(self) -> NDArray[np.float32]:
        """Return the true state of the network, for centralised critics; see `camnet.env.state`."""
        self._stage.begun("state")
        return self._state.encode(self.simulation)

    def render(self) -> NDArray[np.uint8] | None:
        """Map of the network as an RGB array; in ``human`` mode nothing, as `reset` and `step` draw it in a window.

        Raises
        ------
        ConfigError
            The environment is closed or was never reset.
        """
        self._stage.begun("render")
        return self._view.image(self.simulation) if self.render_mode == "rgb_array" else None

    def _draw(self) -> None:
        if self.render_mode == "human":
            self._view.show(self.simulation)

    def close(self) -> None:
        """Free the physics engine and the window; nothing happens where that was done before."""
        self._stage.close()
        self._view.close()
        self.simulation.world.close()


def _open_simulation(scenario: Scenario, filter_name: str, settings: EnvSettings) -> NetworkSimulation:
    """Build network and world; the learning estimator is in rows of arrays where its settings allow."""
    network = build_network(scenario)
    if network.uncertain:
        raise ConfigError(
            f"world {scenario.name!r}: {network.uncertain} is for camnet simulate and certify; the environment's "
            "agents know "
            "their poses and the targets' sizes, and stay in their regions"
        )
    makers = {"learned": RowFilters()} if filter_name == "learned" and rows_can(network) else {}
    world = PyBulletWorld(network.description)
    every, on = settings.score == "v1", settings.cameras == "on"
    return NetworkSimulation(network, world, (filter_name,), scenario.seed, makers, every, on)


def parallel_env(**options: Any) -> HandoffEnv:  # noqa: ANN401 - parameters of HandoffEnv
    """Return the environment in parallel form; see `HandoffEnv` for the options."""
    return HandoffEnv(**options)


def raw_env(**options: Any) -> AECEnv[str, Observation, Action]:  # noqa: ANN401 - parameters of HandoffEnv
    """Return the environment in agent-environment-cycle form, without wrappers."""
    return HandoffAEC(HandoffEnv(**options))


def env(**options: Any) -> AECEnv[str, Observation, Action]:  # noqa: ANN401 - parameters of HandoffEnv
    """Return the environment in agent-environment-cycle form, checking the order of calls."""
    return OrderedAEC(raw_env(**options))
