"""The agent-environment-cycle form: PettingZoo's conversion, with faults told where they are made.

The conversion collects actions and hands them over when the last agent has acted. Here each is checked when it is
given, and calls out of order are errors of the same kind as in the parallel form.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from pettingzoo.utils.conversions import parallel_to_aec_wrapper
from pettingzoo.utils.wrappers import OrderEnforcingWrapper

from camnet.errors import ConfigError

__all__ = ["HandoffAEC", "OrderedAEC"]


class HandoffAEC(parallel_to_aec_wrapper):
    """`camnet.env.handoff_v0.HandoffEnv` agent by agent."""

    def step(self, action: Any) -> None:  # noqa: ANN401 - of the agent whose turn it is
        """Take the action of the agent whose turn it is; after the last one a decision is flown.

        Raises
        ------
        ConfigError
            The action is not in its space (None: for an agent whose episode has ended); the environment is closed or
            was never reset.
        """
        self.env.check_begun("step")
        if not self.agents:
            return
        agent = self.agent_selection
        if not (self.terminations[agent] or self.truncations[agent]):
            self.env.check_action(agent, action)
        elif action is not None:
            raise ConfigError(f"action of {agent} = {action!r}: its episode has ended; None was expected")
        super().step(action)

    def observe(self, agent: str) -> Any:  # noqa: ANN401 - in either form
        """Return the last observation of an agent."""
        self.env.check_begun("observe")
        self.env.observation_space(agent)  # names who is no agent
        return super().observe(agent)

    def last(self, observe: bool = True) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Return what the agent whose turn it is is shown, and what it earned since it acted."""
        self.env.check_begun("last")
        result: tuple[Any, float, bool, bool, dict[str, Any]] = super().last(observe)
        return result


class OrderedAEC(OrderEnforcingWrapper):
    """The same behind PettingZoo's checks of the order of calls; before a reset the environment itself objects."""

    def step(self, action: Any) -> None:  # noqa: ANN401 - of the agent whose turn it is
        """See `HandoffAEC.step`."""
        self.env.env.check_begun("step")
        super().step(action)

    def observe(self, agent: str) -> Any:  # noqa: ANN401 - in either form
        """See `HandoffAEC.observe`."""
        self.env.env.check_begun("observe")
        return super().observe(agent)

    def state(self) -> NDArray[np.float32]:
        """Return the true state of the network."""
        self.env.env.check_begun("state")
        state: NDArray[np.float32] = super().state()
        return state

    def render(self) -> NDArray[np.uint8] | None:
        """Return the map."""
        self.env.env.check_begun("render")
        image: NDArray[np.uint8] | None = super().render()
        return image
