"""Agents that may leave their regions for a bounded time, to keep sight of a target (harris2020, future work).

| symbol | name | unit | meaning |
| --- | --- | --- | --- |
| B | ``budget_s`` | s | longest time outside |
| g | ``guard_m`` | m | depth at which an agent is surely inside: what its own pose may be off by, and half the margin |
| t_out | ``out_s`` | s | time since it was last surely inside |
| t_back | ``back_s`` | s | time that it needs to be surely inside again |

An agent that sees a target may go beyond its region while ``t_out + t_back <= B``, two decisions ahead. Then it comes
back and may not leave before it is surely inside. What an agent does by this rule is by its believed pose; what is
counted is the truth.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from camnet.control.references import ReferenceGenerator
from camnet.control.settings import ControllerSettings
from camnet.sensing.visibility import VisibilityTest
from camnet.simulation.network import Network
from camnet.types import BoolArray, Snapshot

if TYPE_CHECKING:
    from camnet.simulation.loop import NetworkSimulation

__all__ = ["ExitBudgets", "back_s"]

#: for turning round and for the last part of the way, where references are slow, s
_TURN_S = 1.0


def back_s(away_m: float, control: ControllerSettings) -> float:
    """Return how long an agent needs to be back, s, from ``away_m`` beyond the place where it is surely inside.

    It may be on its way out at full speed: it brakes, gathers speed, flies and slows down.
    """
    v, a = control.reference_v_max_mps, control.reference_a_max_mps2
    net = max(v - control.d_bar_mps, 0.1 * v)
    return (away_m + v * v / (2.0 * a)) / net + 2.0 * v / a + a / control.reference_jerk_max_mps3 + _TURN_S


@dataclass(slots=True)
class _Exit:
    """Clocks of one agent; ``outside_s``, ``longest_s``, ``count``, ``exceeded`` are of the truth."""

    budget_s: float
    reach_m: float
    out_s: float = 0.0
    may: bool = False
    spent: bool = False
    outside_s: float = 0.0
    longest_s: float = 0.0
    count: int = 0
    exceeded: int = 0
    spans: list[list[float]] = field(default_factory=list)


class ExitBudgets:
    """The agents with an exit budget."""

    def __init__(self, network: Network) -> None:
        self._network = network
        self.agents = {j: _Exit(*budget) for j, budget in network.exits.items()}
        self._dt = 1.0 / network.scenario.run.decision_hz
        self._sensing_s = 1.0 / network.scenario.sensing.rate_hz

    def free(self, j: int) -> bool:
        """Whether agent ``j`` may be beyond its region now."""
        return j in self.agents and self.agents[j].may

    def decide(self, simulation: NetworkSimulation, references: ReferenceGenerator) -> None:
        """Let agents go, or call them back."""
        control = self._network.scenario.controller
        for j, x in self.agents.items():
            depth = -float(self._network.regions[j].signed_distance(simulation.believed_p_world[j]))
            guard = self._own_m(simulation, j) + 0.5 * control.region_margin_m
            if depth >= guard:
                x.out_s, x.spent = 0.0, False
            else:
                x.out_s += self._dt
            needed = x.out_s + 2.0 * self._dt + back_s(max(guard - depth, 0.0), control)
            x.spent = x.spent or needed > x.budget_s
            x.may = bool(simulation.visible[j].any()) and not x.spent
            references.allow(j, x.reach_m if x.may else 0.0)

    def _own_m(self, simulation: NetworkSimulation, j: int) -> float:
        """Return what the agent's own position may be off by now, m."""
        if simulation.own is None or j not in self._network.outages:
            return 0.0
        since = float(simulation.own.lost_since_s[j])
        lost = simulation.snapshot.t_s - since if np.isfinite(since) else 0.0
        return self._network.outages[j].error_m(lost)

    def sees(self, now: Snapshot, test: VisibilityTest, working: BoolArray, visible: BoolArray) -> bool:
        """Add to ``visible`` (C,M), in place, what agents with leave see of targets outside their regions."""
        free = [j for j, x in self.agents.items() if x.may]
        if not free:
            return False
        everything = test.in_view(now)
        visible[free] |= everything[free] & working[free, None]
        return True

    def watch(self, t_s: float, outside: BoolArray) -> None:
        """Count the time that agents (N,) are truly outside, at a sensing instant."""
        for j, x in self.agents.items():
            if not outside[j]:
                x.outside_s = 0.0
                continue
            if x.outside_s == 0.0:
                x.count += 1
                x.spans.append([t_s, t_s])
            before, x.outside_s = x.outside_s, x.outside_s + self._sensing_s
            x.spans[-1][1] = t_s
            x.longest_s = max(x.longest_s, x.outside_s)
            x.exceeded += bool(before <= x.budget_s < x.outside_s)

    def summary(self) -> dict[str, Any]:
        """Figures of the run by agent, ready for JSON."""
        names = [agent.name for agent in self._network.scenario.agents]
        return {
            names[j]: {
                "budget_s": x.budget_s,
                "reach_m": x.reach_m,
                "exits": x.count,
                "longest_s": x.longest_s,
                "exceeded": x.exceeded,
                "spans_s": x.spans,
            }
            for j, x in self.agents.items()
        }
