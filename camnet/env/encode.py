"""From beliefs to the target and neighbour fields of all agents' observations at once, in one network or in many.

The fields and their units are those of `camnet.env.layout`.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from camnet.env.beliefs import Beliefs
from camnet.env.layout import ObservationLayout
from camnet.geometry.rotations import yaw_of
from camnet.simulation.certificates import view_radius
from camnet.simulation.entries import Entry
from camnet.simulation.network import Network
from camnet.types import Array, BoolArray

__all__ = ["BeliefEncoder", "BeliefRows", "packed_entries"]


class BeliefRows(NamedTuple):
    """`camnet.env.beliefs.Beliefs` as arrays alone, of any number of networks (...): N agents, M targets.

    Attributes
    ----------
    t_s : (...) now, s
    own_p_world : (..., N, 3) the agents' cameras, m
    p_world, v_world, q_world : (..., N, M, 3), (..., N, M, 3), (..., N, M, 4)
    radius_m, last_seen_s : (..., N, M)
    seen, seen_by_me : (..., N, M)
    entries : (..., N, M, 9) predicted entry into the own region: 1 direct, 0.5 touching, 0 none; time; point; velocity;
        radius
    peers_p_world, peers_known : (..., N, N, 3), (..., N, N)
    """

    t_s: Array
    own_p_world: Array
    p_world: Array
    v_world: Array
    q_world: Array
    radius_m: Array
    last_seen_s: Array
    seen: BoolArray
    seen_by_me: BoolArray
    entries: Array
    peers_p_world: Array
    peers_known: BoolArray


def packed_entries(entries: list[list[Entry | None]]) -> Array:
    """Entries (N, M, 9), as in `BeliefRows`, of ``entries[j][m]``."""
    packed = np.zeros((len(entries), len(entries[0]), 9))
    for row, out in zip(entries, packed, strict=True):
        for entry, numbers in zip(row, out, strict=True):
            if entry is not None:
                numbers[0], numbers[1] = 1.0 if entry.direct else 0.5, entry.t_s
                numbers[2:5], numbers[5:8], numbers[8] = entry.p_world, entry.v_world, entry.radius_m
    return packed


class BeliefEncoder:
    """Writes what agents believe into their observations.

    Parameters
    ----------
    network : the network
    layout : where each field is
    """

    def __init__(self, network: Network, layout: ObservationLayout) -> None:
        self._regions, self._layout = network.regions[: network.n_agents], layout
        bounds = np.stack([region.bounds for region in self._regions])
        self._centers = bounds.mean(axis=1)[:, None]  # (N,1,3)
        self._half = np.ptp(bounds, axis=1)[:, None] / 2
        self._width = self._half[..., :2].min(axis=2)  # (N,1)
        self._lookahead_s = network.scenario.handoff.lookahead_s
        self._speeds = np.array([target.v_max_mps for target in network.scenario.targets])
        self._view_radius = np.array([view_radius(network, j) for j in range(network.n_agents)])[:, None]

    def write(self, observations: NDArray[np.float32], beliefs: Beliefs) -> None:
        """Replace the target and neighbour fields of ``observations`` (N, D) by those of ``beliefs``."""
        b = beliefs
        rows = BeliefRows(
            np.asarray(b.t_s),
            b.own_p_world,
            b.p_world,
            b.v_world,
            b.q_world,
            b.radius_m,
            b.last_seen_s,
            b.seen,
            b.seen_by_me,
            packed_entries(b.entries),
            b.peers_p_world,
            b.peers_known,
        )
        self.write_rows(observations, rows)

    def write_rows(self, observations: NDArray[np.float32], beliefs: BeliefRows) -> None:
        """Do what `write` does for ``observations`` (..., N, D) of any number of networks."""
        shape = observations.shape[:-1]
        rows = np.concatenate([self._targets(beliefs).reshape(*shape, -1), self._near(beliefs)], axis=-1)
        first = self._layout.size - rows.shape[-1]
        observations[..., first:] = np.clip(rows, self._layout.low[first:], self._layout.high[first:])

    def inside(self, beliefs: BeliefRows) -> BoolArray:
        """Whether the agents' regions hold the believed positions (..., N, M)."""
        held = [region.contains(beliefs.p_world[..., j, :, :]) for j, region in enumerate(self._regions)]
        return np.stack(held, axis=-2)

    def _targets(self, b: BeliefRows) -> Array:
        """Fields (..., N, M, 24) of the targets, in the layout's order."""
        known, now, yaw = np.isfinite(b.last_seen_s), b.t_s[..., None, None], yaw_of(b.q_world)
        columns = np.concatenate(
            [
                np.ones((*known.shape, 1)),
                (b.p_world - self._centers) / self._half,
                b.v_world / self._speeds[:, None],
                np.stack([np.cos(yaw), np.sin(yaw)], axis=-1),
                (b.radius_m / self._width)[..., None],
                ((now - b.last_seen_s) / self._lookahead_s)[..., None],
                np.stack([b.seen_by_me, b.seen, self.inside(b)], axis=-1),
                self._entries(b.entries, now),
            ],
            axis=-1,
        )
        return np.where(known[..., None], columns, 0.0)

    def _entries(self, e: Array, now: Array) -> Array:
        """Fields (..., N, M, 10) of predicted entries (..., N, M, 9)."""
        columns = np.concatenate(
            [
                e[..., :1],
                (e[..., 2:5] - self._centers) / self._half,
                e[..., 5:8] / self._speeds[:, None],
                ((e[..., 1] - now) / self._lookahead_s)[..., None],
                (e[..., 8] / self._width)[..., None],
                (1.0 - e[..., 8] / self._view_radius)[..., None],
            ],
            axis=-1,
        )
        return np.where(e[..., :1] > 0.0, columns, 0.0)

    def _near(self, b: BeliefRows) -> Array:
        """Fields (..., N, 4 K) of the nearest known agents."""
        offsets = b.peers_p_world - b.own_p_world[..., :, None, :]
        distance = np.where(b.peers_known, np.linalg.norm(offsets, axis=-1), np.inf)
        nearest: NDArray[Any] = np.argsort(distance, axis=-1, kind="stable")[..., : self._layout.n_neighbours]
        there = np.isfinite(np.take_along_axis(distance, nearest, axis=-1))[..., None]
        away = np.take_along_axis(offsets, nearest[..., None], axis=-2) / self._half
        out = np.where(there, np.concatenate([np.ones(there.shape), away], axis=-1), 0.0)
        return out.reshape(*out.shape[:-2], -1)
