"""Estimates that arrive late, or not at all, in many environments at once: the rules of `camnet.env.messages`.

| symbol | meaning |
| --- | --- |
| E, N, M, C | environments, agents, targets, cameras (the agents' first) |
| D | delay of a message, decisions |
| news | (M, 17) estimates of a network, laid out as `camnet.batch.state.ESTIMATE`; ``seen``: by any camera now |

What is under way is a ring of D + 1 posts an environment: the post of exchange k lies in slot k modulo D + 1.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from camnet.batch.state import ESTIMATE
from camnet.env.batch_chance import Chance
from camnet.env.encode import BeliefRows
from camnet.env.messages import heard_lately
from camnet.env.settings import EnvSettings
from camnet.simulation.network import Network
from camnet.types import Array, BoolArray, IntArray

__all__ = ["BatchMessages", "Present", "shared_rows"]

_ENTRY = 9


class Present(NamedTuple):
    """What K environments are like after a decision, as the batch back end has it.

    Attributes
    ----------
    t_s : (K,) time, s
    estimate, entries : (K, M, 17), (K, M, C, 9) as in `camnet.batch.state.State`
    visible : (K, C, M) which camera sees which target
    cameras_p : (K, C, 3) m
    working : (K, C)
    """

    t_s: Array
    estimate: Array
    entries: Array
    visible: BoolArray
    cameras_p: Array
    working: BoolArray

    def news(self) -> Array:
        """Estimates (K, M, 17) with what is truly seen."""
        news = self.estimate.copy()
        news[..., ESTIMATE["seen"]] = self.visible.any(axis=1)
        return news


class _Post(NamedTuple):
    """Everything sent at one decision, and who is to get it; see `camnet.env.messages`."""

    t_s: Array
    news: Array
    entries: Array
    gets_target: BoolArray
    peers_p: Array
    gets_peer: BoolArray


def _rooms(e: int, slots: int, n: int, m: int) -> _Post:
    return _Post(
        np.zeros((e, slots)),
        np.zeros((e, slots, m, 17)),
        np.zeros((e, slots, n, m, _ENTRY)),
        np.zeros((e, slots, n, m), dtype=bool),
        np.zeros((e, slots, n, 3)),
        np.zeros((e, slots, n, n), dtype=bool),
    )


def _own_entries(now: Present, agents: int) -> Array:
    """Predicted entries (K, N, M, 9) into the agents' own regions."""
    return np.swapaxes(now.entries[:, :, :agents], 1, 2)


def shared_rows(now: Present, agents: int) -> BeliefRows:
    """Beliefs of ``agents`` agents that all know the same, for whoever asks nothing about other agents."""
    k, m = now.estimate.shape[:2]
    held = np.broadcast_to(now.news()[:, None], (k, agents, m, 17))
    nobody = np.zeros((k, agents, agents), dtype=bool)
    return _rows(now, held, _own_entries(now, agents), np.zeros((*nobody.shape, 3)), nobody)


def _rows(now: Present, held: Array, entries: Array, peers_p: Array, peers_known: BoolArray) -> BeliefRows:
    n = held.shape[1]
    return BeliefRows(
        t_s=now.t_s,
        own_p_world=now.cameras_p[:, :n],
        p_world=held[..., ESTIMATE["p"]],
        v_world=held[..., ESTIMATE["v"]],
        q_world=held[..., ESTIMATE["q"]],
        radius_m=held[..., ESTIMATE["radius"]],
        last_seen_s=held[..., ESTIMATE["last_seen"]],
        seen=held[..., ESTIMATE["seen"]] > 0.0,
        seen_by_me=now.visible[:, :n],
        entries=entries,
        peers_p_world=peers_p,
        peers_known=peers_known,
    )


class BatchMessages:
    """What the N agents of E environments have heard so far.

    Parameters
    ----------
    network : the network
    settings : delay, loss, range
    environments : E
    """

    def __init__(self, network: Network, settings: EnvSettings, environments: int) -> None:
        e, n, m = environments, network.n_agents, network.n_targets
        self._settings = settings
        self._speeds = np.array([t.v_max_mps for t in network.scenario.targets])
        self._delay = math.ceil(settings.message_delay_s * network.scenario.run.decision_hz - 1e-9)
        self._chance = Chance(e, n * m + n * n)
        self._posts, self._made = _rooms(e, self._delay + 1, n, m), np.zeros(e, dtype=np.int64)
        self._sent_s, self._held = np.zeros((e, n, m)), np.zeros((e, n, m, 17))
        self._entries = np.zeros((e, n, m, _ENTRY))
        self._peers_p, self._peers_sent_s = np.zeros((e, n, n, 3)), np.zeros((e, n, n))

    def reset(self, e: int, rng: np.random.Generator) -> None:
        """Let nobody in environment ``e`` have heard anything; ``rng`` decides which messages get lost."""
        self._chance.reset(e, rng)
        self._made[e] = 0
        self._sent_s[e] = -np.inf
        self._held[e] = 0.0
        self._held[e, ..., ESTIMATE["p"]] = np.nan
        self._held[e, ..., 3], self._held[e, ..., ESTIMATE["radius"]] = 1.0, np.inf
        self._held[e, ..., ESTIMATE["last_seen"]], self._held[e, ..., ESTIMATE["region"]] = -np.inf, -1.0
        self._entries[e] = 0.0
        self._peers_p[e], self._peers_sent_s[e] = 0.0, -np.inf

    def exchange(self, rows: IntArray, now: Present) -> BeliefRows:
        """Send and deliver what is due in the environments ``rows`` (K,); return what everybody there now believes."""
        n = self._held.shape[1]
        news, entries = now.news(), _own_entries(now, n)
        keeper = news[..., ESTIMATE["region"]].astype(np.int64)  # (K, M)
        self._post(rows, now, news, entries, keeper)
        self._deliver(rows)
        keeps = keeper[:, None] == np.arange(n)[:, None]
        first_hand = (now.visible[:, :n] | keeps) & now.working[:, :n, None] & (keeper >= 0)[:, None]
        self._take(rows, now.t_s, news, entries, first_hand)
        sent, held = self._sent_s[rows], self._held[rows]
        age = np.where(np.isfinite(sent), now.t_s[:, None, None] - sent, 0.0)
        held[..., ESTIMATE["p"]] += age[..., None] * held[..., ESTIMATE["v"]]
        held[..., ESTIMATE["radius"]] += age * self._speeds
        silence_s = now.t_s[:, None, None] - self._peers_sent_s[rows]
        heard = heard_lately(silence_s, self._settings.message_delay_s)
        return _rows(now, held, self._entries[rows], self._peers_p[rows], heard)

    def _post(self, rows: IntArray, now: Present, news: Array, entries: Array, keeper: IntArray) -> None:
        """Draw who gets what is sent now; as many draws whatever there is to send."""
        k, n, m = (len(rows), *self._sent_s.shape[1:])
        kept = self._chance.draw(rows) >= self._settings.message_loss
        kept_target, kept_peer = kept[:, : n * m].reshape(k, n, m), kept[:, n * m :].reshape(k, n, n)
        some = np.maximum(keeper, 0)
        keeps = (keeper >= 0) & np.take_along_axis(now.working, some, axis=1)
        distance = np.linalg.norm(now.cameras_p[:, :n, None] - now.cameras_p[:, None], axis=3)
        in_range = distance <= self._settings.communication_range_m  # receiver, sender
        at_hand = np.take_along_axis(in_range, np.broadcast_to(some[:, None], (k, n, m)), axis=2)
        others = now.working[:, None, :n] & ~np.eye(n, dtype=bool)
        posts, slot = self._posts, self._made[rows] % (self._delay + 1)
        posts.t_s[rows, slot], posts.news[rows, slot] = now.t_s, news
        posts.entries[rows, slot] = entries
        posts.gets_target[rows, slot] = kept_target & keeps[:, None] & at_hand
        posts.peers_p[rows, slot] = now.cameras_p[:, :n]
        posts.gets_peer[rows, slot] = kept_peer & others & in_range[..., :n]
        self._made[rows] += 1

    def _deliver(self, rows: IntArray) -> None:
        """Hand over what was sent ``D`` decisions ago, where there was so much time."""
        due = rows[self._made[rows] > self._delay]
        if not due.size:
            return
        slot = (self._made[due] - 1 - self._delay) % (self._delay + 1)
        parts: list[Any] = [part[due, slot] for part in self._posts]
        post = _Post(*parts)
        self._take(due, post.t_s, post.news, post.entries, post.gets_target)
        heard = post.gets_peer
        self._peers_p[due] = np.where(heard[..., None], post.peers_p[:, None], self._peers_p[due])
        self._peers_sent_s[due] = np.where(heard, post.t_s[:, None, None], self._peers_sent_s[due])

    def _take(self, rows: IntArray, t_s: Array, news: Array, entries: Array, who: BoolArray) -> None:
        """Let the agents and targets in ``who`` (K, N, M) hold news of ``t_s`` (K,) where it is the newest."""
        who = who & (t_s[:, None, None] >= self._sent_s[rows])
        self._sent_s[rows] = np.where(who, t_s[:, None, None], self._sent_s[rows])
        self._held[rows] = np.where(who[..., None], news[:, None], self._held[rows])
        self._entries[rows] = np.where(who[..., None], entries, self._entries[rows])
