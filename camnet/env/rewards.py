"""The shared reward of one decision."""

from __future__ import annotations

import numpy as np

from camnet.env.settings import RewardSettings
from camnet.simulation.loop import NetworkSimulation

__all__ = ["SharedReward"]


class SharedReward:
    """Reward of the last decision from the truth; remembers which handoffs it has yet to pay.

    Parameters
    ----------
    settings : weights
    dt_s : length of a decision, s
    """

    def __init__(self, settings: RewardSettings, dt_s: float) -> None:
        self.settings, self.dt_s = settings, dt_s
        self._known: dict[int, int] = {}  # of how many handoffs of each target it knows
        self._open: list[tuple[int, int]] = []  # target and number of those that are not paid yet

    def __call__(self, simulation: NetworkSimulation) -> float:
        """Return the reward of the decision that has just ended."""
        weights, dt = self.settings, self.dt_s
        truth, controller = simulation.snapshot, simulation.network.scenario.controller
        top, outside = controller.reference_v_max_mps, simulation.agents_outside()
        squares = [(x * x + y * y + z * z) / top**2 for x, y, z in truth.agent_v_world.tolist()]
        effort: float = sum(min(s, 9.0) for s in squares) / len(squares)
        targets = range(len(simulation.trackers))
        seen = sum(simulation.seen_by(m) >= 0 for m in targets)
        reward = weights.in_view * dt * (seen / len(targets))
        reward -= weights.effort * dt * effort
        reward -= weights.region_exit * dt * float(np.count_nonzero(outside))
        reward -= weights.collision * float(bool(truth.collisions))
        return reward + self._handoffs(simulation)

    def _handoffs(self, simulation: NetworkSimulation) -> float:
        """Pay each handoff once: when it is completed, or when its grace time is over."""
        grace, now, total = simulation.network.scenario.handoff.grace_s, simulation.snapshot.t_s, 0.0
        for m, tracker in enumerate(simulation.trackers):
            known = self._known.get(m, 0)
            if known < len(tracker.handoffs):
                self._open += [(m, k) for k in range(known, len(tracker.handoffs))]
                self._known[m] = len(tracker.handoffs)
        for m, k in self._open.copy():
            handoff = simulation.trackers[m].handoffs[k]
            if handoff.completed(grace):
                total += self.settings.reacquired * (1.0 - max(handoff.delay_s, 0.0) / grace)
                self._open.remove((m, k))
            elif now - handoff.t_enter_s > grace:
                total -= self.settings.lost
                self._open.remove((m, k))
        return total
