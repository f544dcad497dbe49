"""Agents that act on estimates which arrive late, or not at all.

Who knows what:

- The camera that measured a target last keeps its estimate (while it works) and has it at once, and so has every
  agent whose own camera sees the target now.
- At every decision that camera sends the estimate, with the predicted entry into each region, to all agents within
  ``communication_range_m`` of it (one hop, nothing is passed on). Each agent also sends its position; who has not been
  heard for 2 s counts as absent.
- A message arrives ``message_delay_s`` later, rounded up to whole decisions. Each is lost with probability
  ``message_loss``, for every receiver and target on its own.
- Between messages an agent holds the last one it got and moves it on at constant velocity; the error radius grows by
  the target's top speed times the age of the message. A predicted entry stays as it was sent: its time is absolute.
- When the keeper fails, nobody sends that target's estimate until somebody sees the target again.

What the network has learned is common to all: a message carries a prediction, not a model. With no delay, no loss and
everybody in range all of this comes to one shared estimate, and is left out.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np

from camnet.env.beliefs import Beliefs, shared_beliefs
from camnet.env.settings import EnvSettings
from camnet.simulation.entries import Entry
from camnet.simulation.loop import NetworkSimulation
from camnet.simulation.network import Network
from camnet.types import Array, BoolArray

__all__ = ["SILENCE_S", "Messages", "heard_lately", "messages_are_perfect"]

#: an agent that was not heard for so long (beyond the delay) is left out of the neighbours
SILENCE_S = 2.0


def heard_lately(silence_s: Array, delay_s: float) -> BoolArray:
    """Whether whom one has not heard for so long is still among the neighbours."""
    # all times are multiples of a decision: at the very end of the silence rounding must not decide
    return np.asarray(silence_s <= SILENCE_S + delay_s + 1e-9)


def messages_are_perfect(network: Network, settings: EnvSettings) -> bool:
    """Whether every message arrives at once: no delay, no loss, and the whole network in range."""
    if settings.message_delay_s > 0.0 or settings.message_loss > 0.0:
        return False
    return float(np.linalg.norm(np.ptp(network.bounds, axis=0))) <= settings.communication_range_m


@dataclass(frozen=True, eq=False, slots=True)
class _Post:
    """Everything sent at one decision, and who is to get it: estimates (N,M), positions (N,N)."""

    t_s: float
    shared: Beliefs
    gets_target: BoolArray
    gets_peer: BoolArray


class Messages:
    """What N agents have heard so far.

    Parameters
    ----------
    simulation : the running network
    settings : delay, loss, range
    rng : decides which messages are lost
    """

    def __init__(
        self, simulation: NetworkSimulation, settings: EnvSettings, rng: np.random.Generator
    ) -> None:
        network = simulation.network
        n, m = network.n_agents, network.n_targets
        self._settings, self._rng = settings, rng
        self._speeds = np.array([t.v_max_mps for t in network.scenario.targets])
        rate = network.scenario.run.decision_hz
        self._delay = math.ceil(settings.message_delay_s * rate - 1e-9)
        self._under_way: deque[_Post] = deque()
        self._sent_s = np.full((n, m), -np.inf)
        self._p, self._v, self._q = np.full((n, m, 3), np.nan), np.zeros((n, m, 3)), np.zeros((n, m, 4))
        self._q[..., 0] = 1.0
        self._radius, self._last_seen = np.full((n, m), np.inf), np.full((n, m), -np.inf)
        self._region, self._seen = np.full((n, m), -1.0), np.zeros((n, m), dtype=bool)
        self._entries: list[list[Entry | None]] = [[None] * m for _ in range(n)]
        self._peers_p, self._peers_sent_s = np.zeros((n, n, 3)), np.full((n, n), -np.inf)

    def exchange(self, simulation: NetworkSimulation) -> Beliefs:
        """Send and deliver what is due at this decision; return what everybody now believes."""
        shared = shared_beliefs(simulation, math.inf)
        self._under_way.append(self._post(simulation, shared))
        while len(self._under_way) > self._delay:
            self._deliver(self._under_way.popleft())
        self._take(shared, shared.t_s, _first_hand(simulation, shared))
        age = np.where(np.isfinite(self._sent_s), shared.t_s - self._sent_s, 0.0)
        return Beliefs(
            t_s=shared.t_s,
            own_p_world=shared.own_p_world,
            p_world=self._p + age[..., None] * self._v,
            v_world=self._v.copy(),
            q_world=self._q.copy(),
            radius_m=self._radius + age * self._speeds,
            last_seen_s=self._last_seen.copy(),
            region=self._region.copy(),
            seen=self._seen.copy(),
            seen_by_me=shared.seen_by_me,
            entries=[list(row) for row in self._entries],
            peers_p_world=self._peers_p.copy(),
            peers_known=heard_lately(shared.t_s - self._peers_sent_s, self._settings.message_delay_s),
        )

    def _post(self, simulation: NetworkSimulation, shared: Beliefs) -> _Post:
        """Draw who gets what is sent now; as many draws whatever there is to send."""
        n, (_, m) = len(self._p), self._sent_s.shape
        kept_target = self._rng.random((n, m)) >= self._settings.message_loss
        kept_peer = self._rng.random((n, n)) >= self._settings.message_loss
        p_cameras = simulation.snapshot.camera_p_world
        keeper = shared.region[0].astype(int)
        keeps = (keeper >= 0) & simulation.working[keeper]
        distance = np.linalg.norm(p_cameras[:n, None] - p_cameras, axis=2)  # receiver, sender
        in_range = distance <= self._settings.communication_range_m
        return _Post(
            shared.t_s,
            shared,
            kept_target & keeps & in_range[:, keeper],
            kept_peer & shared.peers_known & in_range[:, :n],
        )

    def _deliver(self, post: _Post) -> None:
        self._take(post.shared, post.t_s, post.gets_target)
        heard = post.gets_peer
        self._peers_p[heard] = post.shared.peers_p_world[heard]
        self._peers_sent_s[heard] = post.t_s

    def _take(self, news: Beliefs, t_s: float, who: BoolArray) -> None:
        """Let the agents and targets in ``who`` (N,M) hold ``news`` of ``t_s`` where it is the newest."""
        who = who & (t_s >= self._sent_s)
        self._sent_s[who] = t_s
        self._p[who], self._v[who], self._q[who] = news.p_world[who], news.v_world[who], news.q_world[who]
        self._radius[who], self._last_seen[who] = news.radius_m[who], news.last_seen_s[who]
        self._region[who], self._seen[who] = news.region[who], news.seen[who]
        for j, m in np.argwhere(who).tolist():
            self._entries[j][m] = news.entries[j][m]


def _first_hand(simulation: NetworkSimulation, shared: Beliefs) -> BoolArray:
    """Which agents (N,M) have the newest estimate of a target without any message."""
    n = len(shared.seen_by_me)
    known = shared.region[0] >= 0
    keeps = shared.region[0][None] == np.arange(n)[:, None]
    working = np.asarray(simulation.working)[:n, None]
    return np.asarray((shared.seen_by_me | keeps) & working & known)
