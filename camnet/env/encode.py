"""From beliefs to the target and neighbour fields of all agents' observations at once.

The fields and their units are those of `camnet.env.layout`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from camnet.env.beliefs import Beliefs
from camnet.env.layout import ObservationLayout
from camnet.geometry.rotations import yaw_of
from camnet.simulation.certificates import view_radius
from camnet.simulation.network import Network
from camnet.types import Array

__all__ = ["BeliefEncoder"]


class BeliefEncoder:
    """Writes what agents believe into their observations.

    Parameters
    ----------
    network : the network
    layout : where each field is
    """

    def __init__(self, network: Network, layout: ObservationLayout) -> None:
        self._network, self._layout = network, layout
        bounds = np.stack([region.bounds for region in network.regions[: network.n_agents]])
        self._centers = bounds.mean(axis=1)[:, None]  # (N,1,3)
        self._half = np.ptp(bounds, axis=1)[:, None] / 2
        self._width = self._half[..., :2].min(axis=2)  # (N,1)
        self._lookahead_s = network.scenario.handoff.lookahead_s
        self._speeds = np.array([target.v_max_mps for target in network.scenario.targets])
        self._view_radius = [view_radius(network, j) for j in range(network.n_agents)]

    def write(self, observations: NDArray[np.float32], beliefs: Beliefs) -> None:
        """Replace the target and neighbour fields of ``observations`` (N, D) by those of ``beliefs``."""
        n = len(observations)
        rows = np.concatenate([self._targets(beliefs).reshape(n, -1), self._near(beliefs)], axis=1)
        first = self._layout.size - rows.shape[1]
        observations[:, first:] = np.clip(rows, self._layout.low[first:], self._layout.high[first:])

    def _targets(self, beliefs: Beliefs) -> Array:
        """Fields (N, M, 24) of the targets, in the layout's order."""
        n, m = beliefs.seen.shape
        known = np.isfinite(beliefs.last_seen_s)
        yaw = yaw_of(beliefs.q_world)
        inside = np.array([self._network.containment(beliefs.p_world[j])[:, j] for j in range(n)])
        columns = np.concatenate(
            [
                np.ones((n, m, 1)),
                (beliefs.p_world - self._centers) / self._half,
                beliefs.v_world / self._speeds[:, None],
                np.stack([np.cos(yaw), np.sin(yaw)], axis=2),
                (beliefs.radius_m / self._width)[..., None],
                ((beliefs.t_s - beliefs.last_seen_s) / self._lookahead_s)[..., None],
                np.stack([beliefs.seen_by_me, beliefs.seen, inside], axis=2),
                self._entries(beliefs),
            ],
            axis=2,
        )
        return np.where(known[..., None], columns, 0.0)

    def _entries(self, beliefs: Beliefs) -> Array:
        """Fields (N, M, 10) of the predicted entries."""
        n, m = beliefs.seen.shape
        out = np.zeros((n, m, 10))
        for j, row in enumerate(beliefs.entries):
            for i, entry in enumerate(row):
                if entry is None:
                    continue
                out[j, i, 0] = 1.0 if entry.direct else 0.5
                out[j, i, 1:4] = (entry.p_world - self._centers[j, 0]) / self._half[j, 0]
                out[j, i, 4:7] = entry.v_world / self._speeds[i]
                out[j, i, 7] = (entry.t_s - beliefs.t_s) / self._lookahead_s
                out[j, i, 8] = entry.radius_m / self._width[j, 0]
                out[j, i, 9] = 1.0 - entry.radius_m / self._view_radius[j]
        return out

    def _near(self, beliefs: Beliefs) -> Array:
        """Fields (N, 4 K) of the nearest known agents."""
        n = len(beliefs.seen)
        out = np.zeros((n, self._layout.n_neighbours, 4))
        for j in range(n):
            offsets = beliefs.peers_p_world[j] - beliefs.own_p_world[j]
            distance = np.where(beliefs.peers_known[j], np.linalg.norm(offsets, axis=1), np.inf)
            for k, other in enumerate(np.argsort(distance, kind="stable")[: self._layout.n_neighbours]):
                if np.isfinite(distance[other]):
                    out[j, k] = [1.0, *(offsets[other] / self._half[j, 0])]
        return out.reshape(n, -1)
