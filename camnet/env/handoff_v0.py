"""The handoff problem as a multi-agent environment (PettingZoo).

>>> from camnet.env import handoff_v0
>>> env = handoff_v0.parallel_env(world="quickstart")
>>> observations, infos = env.reset(seed=1)

Agents are the mobile cameras, one per operating region. An action is a setpoint in [-1, 1]^5: position in the
own region (3; 0 is its centre, +-1 its faces less the safety margin) and gaze (pan, tilt). The sliding-mode
controller flies it. Observations are described field by field in `camnet.env.layout`.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray
from pettingzoo import AECEnv, ParallelEnv
from pettingzoo.utils import wrappers
from pettingzoo.utils.conversions import parallel_to_aec

from camnet.config.load import load_scenario
from camnet.config.models import Scenario
from camnet.env.layout import Observation
from camnet.env.observe import Observer
from camnet.env.rewards import SharedReward
from camnet.env.settings import EnvSettings
from camnet.env.state import StateEncoder
from camnet.errors import ConfigError
from camnet.report.frame import MapPainter
from camnet.simulation.loop import Setpoints
from camnet.simulation.run import open_simulation

__all__ = ["HandoffEnv", "env", "parallel_env", "raw_env"]

Action = NDArray[np.float32]


class HandoffEnv(ParallelEnv[str, Observation, Action]):
    """Handoff environment, parallel form.

    Parameters
    ----------
    world : name of a shipped world, path of a world file or recipe, or a scenario
    overrides : settings to change, as ``key=value``
    filter_name : the estimator that the observations come from (`camnet.simulation.filters.FILTERS`)
    render_mode : ``None``, ``"rgb_array"`` or ``"human"``
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
        scenario = world if isinstance(world, Scenario) else load_scenario(world, overrides)
        if not isinstance(scenario, Scenario) or not scenario.agents:
            raise ConfigError(
                f"world = {world!r}: the handoff environment needs a network with at least one agent"
            )
        self.settings = _env_settings(settings, options)
        self.max_cycles = self.settings.max_cycles
        self.render_mode = render_mode
        self.simulation = open_simulation(scenario, scenario.seed, (filter_name,))
        self.observer = Observer(self.simulation, self.settings)
        self._state = StateEncoder(self.simulation)
        self._painter: MapPainter | None = None
        self._seed = scenario.seed
        self.possible_agents = [agent.name for agent in scenario.agents]
        self.agents: list[str] = []
        self.observation_spaces = {name: self.observer.layout.space() for name in self.possible_agents}
        self.action_spaces = {
            name: spaces.Box(-1.0, 1.0, (5,), dtype=np.float32) for name in self.possible_agents
        }
        self.state_space = self._state.space()

    def observation_space(self, agent: str) -> spaces.Box:
        """Space of one agent's observations (the same object every time)."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> spaces.Box:
        """Space of one agent's actions (the same object every time)."""
        return self.action_spaces[agent]

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Observation], dict[str, dict[str, Any]]]:
        """Start an episode; without a seed the next one of the sequence is taken."""
        self._seed = self._seed + 1 if seed is None else seed
        self.simulation.reset(self._seed)
        self.agents = list(self.possible_agents)
        self._cycle = 0
        self._reward = SharedReward(
            self.settings.reward, 1.0 / self.simulation.network.scenario.run.decision_hz
        )
        return self._observations(), {name: {} for name in self.agents}

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
            An action is missing, has the wrong shape or is not finite.
        """
        if not self.agents:
            return {}, {}, {}, {}, {}
        self.simulation.advance(self.setpoints(actions))
        self._cycle += 1
        reward = self._reward(self.simulation)
        terminated = self._terminated()
        truncated = self._cycle >= self.max_cycles and not terminated
        observations, names = self._observations(), self.agents
        infos = {name: self._info(terminated or truncated) for name in names}
        if terminated or truncated:
            self.agents = []
        return (
            observations,
            dict.fromkeys(names, reward),
            dict.fromkeys(names, terminated),
            dict.fromkeys(names, truncated),
            infos,
        )

    def setpoints(self, actions: dict[str, Action]) -> Setpoints:
        """Return the setpoints that actions ask for: positions in the world, gaze angles."""
        missing = [name for name in self.agents if name not in actions]
        if missing:
            raise ConfigError(f"actions: none given for {missing}; every live agent needs one")
        flat = np.array([np.asarray(actions[name], dtype=float).reshape(-1) for name in self.possible_agents])
        if flat.shape != (len(self.possible_agents), 5) or not np.isfinite(flat).all():
            raise ConfigError(f"actions = {actions!r}: each must be 5 finite numbers in [-1, 1]")
        flat = np.clip(flat, -1.0, 1.0)
        n = len(self.possible_agents)
        margin = self.simulation.network.scenario.controller.region_margin_m
        reach = np.maximum(self.observer.half_sizes[:n] - margin, 0.0)
        return Setpoints(
            self.observer.centers[:n] + flat[:, :3] * reach, flat[:, 3:] * self.settings.gaze_max_rad
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
        observations = self.observer.observe(self.simulation, self.simulation.entries())
        return dict(zip(self.possible_agents, observations, strict=True))

    def _info(self, last: bool) -> dict[str, Any]:
        return {"episode": self.simulation.statistics.episode(self.simulation)} if last else {}

    def state(self) -> NDArray[np.float32]:
        """Return the true state of the network, for centralised critics; see `camnet.env.state`."""
        return self._state.encode(self.simulation)

    def render(self) -> NDArray[np.uint8] | None:
        """Map of the network as an RGB array; shown in a window in ``human`` mode."""
        if self.render_mode is None:
            return None
        if self._painter is None:
            self._painter = MapPainter(self.simulation.network)
        image = self._painter.paint_simulation(self.simulation)
        if self.render_mode == "rgb_array":
            return image
        self._painter.show(image)
        return None

    def close(self) -> None:
        """Free the physics engine."""
        self.simulation.world.close()


def _env_settings(settings: EnvSettings | None, options: dict[str, Any]) -> EnvSettings:
    if "max_steps" in options:  # the same thing under its plainer name
        options = {**options, "max_cycles": options["max_steps"]}
        del options["max_steps"]
    unknown = sorted(set(options) - set(EnvSettings.model_fields))
    if unknown:
        known = ", ".join(EnvSettings.model_fields)
        raise ConfigError(f"unknown option {unknown[0]!r} of the handoff environment; known are {known}")
    base = EnvSettings() if settings is None else settings
    try:
        return EnvSettings.model_validate({**base.model_dump(), **options})
    except ValueError as error:
        raise ConfigError(f"options of the handoff environment: {error}") from error


def parallel_env(**options: Any) -> HandoffEnv:  # noqa: ANN401 - parameters of HandoffEnv
    """Return the environment in parallel form; see `HandoffEnv` for the options."""
    return HandoffEnv(**options)


def raw_env(**options: Any) -> AECEnv[str, Observation, Action]:  # noqa: ANN401 - parameters of HandoffEnv
    """Return the environment in agent-environment-cycle form, without wrappers."""
    return parallel_to_aec(HandoffEnv(**options))


def env(**options: Any) -> AECEnv[str, Observation, Action]:  # noqa: ANN401 - parameters of HandoffEnv
    """Return the environment in agent-environment-cycle form, checking the order of calls."""
    return wrappers.OrderEnforcingWrapper(raw_env(**options))
