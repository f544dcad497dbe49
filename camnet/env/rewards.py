"""The shared reward of one decision."""

from __future__ import annotations

import numpy as np

from camnet.env.settings import RewardSettings
from camnet.simulation.loop import NetworkSimulation

__all__ = ["SharedReward"]


class SharedReward:
    """Reward of the last decision from the truth; remembers which handoffs it has paid.

    Parameters
    ----------
    settings : weights
    dt_s : length of a decision, s
    """

    def __init__(self, settings: RewardSettings, dt_s: float) -> None:
        self.settings, self.dt_s = settings, dt_s
        self._paid: set[tuple[int, int]] = set()

    def __call__(self, simulation: NetworkSimulation) -> float:
        """Return the reward of the decision that has just ended."""
        weights, dt = self.settings, self.dt_s
        truth, controller = simulation.snapshot, simulation.network.scenario.controller
        top, outside = controller.reference_v_max_mps, simulation.agents_outside()
        squares = [(x * x + y * y + z * z) / top**2 for x, y, z in truth.agent_v_world.tolist()]
        effort: float = sum(min(s, 9.0) for s in squares) / len(squares)
        reward = weights.in_view * dt * float(simulation.visible.any(axis=0).mean())
        reward -= weights.effort * dt * effort
        reward -= weights.region_exit * dt * float(np.count_nonzero(outside))
        reward -= weights.collision * float(bool(truth.collisions))
        return reward + self._handoffs(simulation)

    def _handoffs(self, simulation: NetworkSimulation) -> float:
        """Pay each handoff once: when it is completed, or when its grace time is over."""
        grace, now, total = simulation.network.scenario.handoff.grace_s, simulation.snapshot.t_s, 0.0
        for m, tracker in enumerate(simulation.trackers):
            for k, handoff in enumerate(tracker.handoffs):
                if (m, k) in self._paid:
                    continue
                if handoff.completed(grace):
                    total += self.settings.reacquired * (1.0 - max(handoff.delay_s, 0.0) / grace)
                    self._paid.add((m, k))
                elif now - handoff.t_enter_s > grace:
                    total -= self.settings.lost
                    self._paid.add((m, k))
        return total
