"""Compiled twin of `camnet.env.observe.Observer.readable` (its test oracle): all agents' observations in one call.

| array | row |
| --- | --- |
| ``estimates`` (M,14), of a target | p (3), v (3), q (4), error radius, time last seen, 1 if known, top speed |
| ``entries`` (M,N,9), of a target into a region | 0 none, 0.5 touched, 1 direct; p (3), v (3), time, error radius |
| ``agents`` (N,13), of an agent | region's centre and half-size (6), the same in the network (6), view radius |
| ``scales`` (5,) | top reference speed, largest gaze, look-ahead, communication range, time now |
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from camnet.geometry.rotations_compiled import to_matrix
from camnet.types import Array, BoolArray

__all__ = ["NEIGHBOUR_FIELDS", "OWN_FIELDS", "TARGET_FIELDS", "write_observations"]

#: numbers about the agent itself, about one target, about one neighbour
OWN_FIELDS, TARGET_FIELDS, NEIGHBOUR_FIELDS = 14, 24, 4


@njit(cache=True)
def _own(flat: Array, p: Array, q: Array, v: Array, agent: Array, scales: Array) -> None:
    axis = to_matrix(q)[:, 2]
    down = max(-axis[2], 0.0)
    for i in range(3):
        flat[i] = (p[i] - agent[i]) / agent[3 + i]
        flat[3 + i] = v[i] / scales[0]
        flat[8 + i] = agent[6 + i]
        flat[11 + i] = agent[9 + i]
    flat[6] = math.atan2(axis[0], down) / scales[1]
    flat[7] = math.atan2(axis[1], down) / scales[1]


@njit(cache=True)
def _target(
    flat: Array, estimate: Array, entry: Array, agent: Array, scales: Array, inside: bool, seen_by_me: bool
) -> None:
    if estimate[12] == 0.0:
        return
    w, x, y, z = estimate[6], estimate[7], estimate[8], estimate[9]
    yaw = math.atan2(2.0 * (x * y + w * z), 1.0 - 2.0 * (y * y + z * z))
    width = min(agent[3], agent[4])
    flat[0] = 1.0
    for i in range(3):
        flat[1 + i] = (estimate[i] - agent[i]) / agent[3 + i]
        flat[4 + i] = estimate[3 + i] / estimate[13]
    flat[7], flat[8] = math.cos(yaw), math.sin(yaw)
    flat[9] = estimate[10] / width
    flat[10] = (scales[4] - estimate[11]) / scales[2]
    flat[11] = 1.0 if seen_by_me else 0.0
    flat[13] = 1.0 if inside else 0.0
    if entry[0] > 0.0:
        flat[14] = entry[0]
        for i in range(3):
            flat[15 + i] = (entry[1 + i] - agent[i]) / agent[3 + i]
            flat[18 + i] = entry[4 + i] / estimate[13]
        flat[21] = (entry[7] - scales[4]) / scales[2]
        flat[22] = entry[8] / width
        flat[23] = 1.0 - entry[8] / agent[12]


@njit(cache=True)
def _near(flat: Array, j: int, p: Array, agents: Array, neighbours: int, range_m: float) -> None:
    """Nearest agents in range, nearest first, of equally near ones the first."""
    n = agents.shape[0]
    distance = np.empty(n)
    for i in range(n):
        x, y, z = p[i, 0] - p[j, 0], p[i, 1] - p[j, 1], p[i, 2] - p[j, 2]
        distance[i] = math.sqrt(x * x + y * y + z * z)
    distance[j] = math.inf
    for k in range(neighbours):
        other = int(np.argmin(distance))
        if distance[other] > range_m:
            return
        flat[4 * k] = 1.0
        for i in range(3):
            flat[4 * k + 1 + i] = (p[other, i] - p[j, i]) / agents[j, 3 + i]
        distance[other] = math.inf


@njit(cache=True)
def write_observations(
    p: Array,
    q: Array,
    v: Array,
    agents: Array,
    estimates: Array,
    entries: Array,
    inside: BoolArray,
    visible: BoolArray,
    scales: Array,
    neighbours: int,
    low: NDArray[np.float32],
    high: NDArray[np.float32],
) -> NDArray[np.float32]:
    """Observations (N,D) of agents with cameras at p (C,3), q (C,4), v (C,3).

    ``inside`` (M,C): whether the estimate lies in the region; ``visible`` (C,M); ``low``, ``high`` (D,) are the bounds.
    """
    n, m = agents.shape[0], estimates.shape[0]
    out = np.empty((n, low.shape[0]), dtype=np.float32)
    flat = np.empty(low.shape[0])
    for j in range(n):
        flat[:] = 0.0
        _own(flat, p[j], q[j], v[j], agents[j], scales)
        for t in range(m):
            part = flat[OWN_FIELDS + TARGET_FIELDS * t : OWN_FIELDS + TARGET_FIELDS * (t + 1)]
            _target(part, estimates[t], entries[t, j], agents[j], scales, inside[t, j], visible[j, t])
            if estimates[t, 12] > 0.0 and np.any(visible[:, t]):
                part[12] = 1.0
        _near(flat[OWN_FIELDS + TARGET_FIELDS * m :], j, p[:n], agents, neighbours, scales[3])
        for k in range(low.shape[0]):
            out[j, k] = min(max(flat[k], low[k]), high[k])
    return out
