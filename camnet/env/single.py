"""One agent of the handoff environment as a Gymnasium environment; the others follow given policies.

>>> import gymnasium, camnet.env
>>> env = gymnasium.make("camnet/Handoff-Single-v0", world="quickstart", agent="camera_2")
>>> observation, info = env.reset(seed=1)
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from camnet.copies import ExactCopies
from camnet.env.actions import setpoint_of
from camnet.env.beliefs import tasks
from camnet.env.checks import checked_seed
from camnet.env.handoff_v0 import HandoffEnv
from camnet.errors import ConfigError

__all__ = ["SingleAgentEnv", "Team", "built_in"]

#: acts for agents by name: observations in, actions out
Team = Callable[[Mapping[str, Any]], Mapping[str, Any]]


def built_in(env: HandoffEnv) -> Team:
    """Return the handoff rule of the built-in system, in whatever action mode ``env`` has."""
    return _BuiltIn(env)


class _BuiltIn:
    """See `built_in`."""

    def __init__(self, env: HandoffEnv) -> None:
        self._env = env

    def __call__(self, observations: Mapping[str, Any]) -> dict[str, Any]:
        env = self._env
        beliefs = env.beliefs()
        chosen = tasks(env.simulation, beliefs)
        actions = {}
        for name in observations:
            j = env.possible_agents.index(name)
            setpoint = setpoint_of(env.simulation, beliefs, j, chosen[j])
            actions[name] = env.action_of(name, chosen[j], setpoint)
        return actions


class SingleAgentEnv(ExactCopies, gymnasium.Env[Any, Any]):
    """Gymnasium environment of one agent; copies go on like the original, with the others' policies copied too.

    An episode ends when it ends for this agent: with everybody's, or when it fails itself.

    Parameters
    ----------
    agent : name of the agent to control; None takes the first
    others : builds what acts for all others from the environment, anew at every reset; the built-in system by
        default, and e.g. ``lambda env: camnet.agents.make_team("nearest", env)``
    render_mode : as in `HandoffEnv`
    options : of `HandoffEnv`
    """

    metadata = {"render_modes": ["rgb_array", "human"], "render_fps": 10}  # noqa: RUF012 - Gymnasium's convention

    def __init__(
        self,
        agent: str | None = None,
        others: Callable[[HandoffEnv], Team] | None = None,
        render_mode: str | None = None,
        **options: Any,  # noqa: ANN401 - parameters of HandoffEnv
    ) -> None:
        self.network_env = HandoffEnv(render_mode=render_mode, **options)
        names = self.network_env.possible_agents
        self.agent = names[0] if agent is None else agent
        if self.agent not in names:
            self.network_env.close()
            raise ConfigError(f"agent = {agent!r}: no such agent; there are {', '.join(names)}")
        self.render_mode = render_mode
        self._build_others = built_in if others is None else others
        self.observation_space = self.network_env.observation_space(self.agent)
        self.action_space = self.network_env.action_space(self.agent)
        self._observations: dict[str, Any] = {}

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Start an episode; its seed is drawn from this environment's generator."""
        self.network_env.check_open("reset")
        super().reset(seed=None if seed is None else checked_seed(seed))
        episode_seed = int(self.np_random.integers(2**31))
        self._observations, infos = self.network_env.reset(seed=episode_seed, options=options)
        self._others = self._build_others(self.network_env)
        return self._observations[self.agent], infos[self.agent]

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:  # noqa: ANN401
        """Fly one decision period with ``action`` for this agent, and the others by their policies.

        Raises
        ------
        ConfigError
            The action is not in its space, the episode has ended for this agent, or the environment is closed or was
            never reset. Nothing has moved then.
        """
        self.network_env.check_action(self.agent, action)
        if self.agent not in self.network_env.agents:
            raise ConfigError(f"step: {self.agent} is gone: reset() starts the next episode")
        others = {name: seen for name, seen in self._observations.items() if name in self._live()}
        actions = {**self._others(others), self.agent: action}
        observations, rewards, terminations, truncations, infos = self.network_env.step(actions)
        self._observations = observations
        name = self.agent
        return observations[name], float(rewards[name]), terminations[name], truncations[name], infos[name]

    def _live(self) -> set[str]:
        return {name for name in self.network_env.agents if name != self.agent}

    def render(self) -> NDArray[np.uint8] | None:
        """Map of the network as an RGB array; in ``human`` mode nothing, as `reset` and `step` draw it in a window."""
        return self.network_env.render()

    def close(self) -> None:
        """Free the physics engine and the window; nothing happens where that was done before."""
        self.network_env.close()
