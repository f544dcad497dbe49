"""Auction of targets: agents bid with the time until they could have a target in view; each target goes to one agent.

Bids are 0 for the agent that sees the target, a little more for one whose region it is predicted to be in, else the
predicted time until it enters the region. One round of sealed bids settled by the assignment of least total cost is
what a distributed auction of one item per bidder converges to (Bertsekas, "The auction algorithm: a distributed
relaxation method for the assignment problem", Annals of Operations Research 14, 1988). Winners act by the rule of
`camnet.agents.learned` on their target alone; the others loiter.

The bids reach the auctioneer without loss: this agent is a baseline for assignment, not for communication.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from camnet.agents.learned import Learned
from camnet.agents.policy import Action, AgentContext
from camnet.types import Array

__all__ = ["INSIDE", "NO_BID", "Auction"]

Observation = NDArray[np.float32] | Mapping[str, NDArray[np.float32]]
#: cost of a target that an agent cannot serve; anything below it is a bid
NO_BID = 1e6
#: a predicted position is worth a little less than a sighting
INSIDE = 1e-3


class Auction:
    """A team of agents that share targets out by auction.

    Parameters
    ----------
    known : fixed facts of every agent
    """

    def __init__(self, known: Mapping[str, AgentContext]) -> None:
        self._contexts = dict(known)
        self._rules = {name: Learned(context) for name, context in known.items()}

    def __call__(self, observations: Mapping[str, Observation]) -> dict[str, Action]:
        """Return an action for every observation."""
        flat = {name: self._flat(name, seen) for name, seen in observations.items()}
        return {
            name: self._rules[name](self._only(name, flat[name], target))
            for name, target in self._shared_out(flat).items()
        }

    def _flat(self, name: str, observation: Observation) -> NDArray[np.float32]:
        """Observation as one row."""
        if isinstance(observation, Mapping):
            return np.concatenate([observation[field] for field in self._contexts[name].layout.slices])
        return observation

    def _shared_out(self, observations: Mapping[str, NDArray[np.float32]]) -> dict[str, int]:
        """Return the target that each agent has won (-1: none)."""
        names = list(observations)
        won = dict.fromkeys(names, -1)
        if names:
            bids = np.array([self._bids(name, observations[name]) for name in names])
            for agent, target in zip(*linear_sum_assignment(bids), strict=True):
                if bids[agent, target] < NO_BID:
                    won[names[int(agent)]] = int(target)
        return won

    def _bids(self, name: str, observation: NDArray[np.float32]) -> Array:
        """Bid (M,) of one agent for every target, in look-ahead times."""
        layout = self._contexts[name].layout
        bids = np.full(layout.n_targets, NO_BID)
        for m in range(layout.n_targets):

            def value(field: str, target: int = m) -> float:
                return float(observation[layout.slices[f"target_{target}.{field}"]][0])

            if value("seen_by_me") > 0:
                bids[m] = 0.0
            elif value("inside") > 0 and value("radius") <= 1:
                bids[m] = INSIDE
            elif value("coming") > 0 and value("entry_radius") <= 1:
                bids[m] = INSIDE + value("entry_time")
        return bids

    def _only(self, name: str, observation: NDArray[np.float32], target: int) -> NDArray[np.float32]:
        """Observation in which no other target is known."""
        layout = self._contexts[name].layout
        shown = observation.copy()
        for m in range(layout.n_targets):
            if m != target:
                for field in ("known", "inside", "coming", "seen_by_me"):
                    shown[layout.slices[f"target_{m}.{field}"]] = 0.0
        return shown
