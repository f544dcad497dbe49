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
from numpy.typing import NDArray

from camnet.geometry.triples import borrowing, matrix, quaternion
from camnet.types import Array, BoolArray

__all__ = ["NEIGHBOUR_FIELDS", "OWN_FIELDS", "TARGET_FIELDS", "write_observations"]

#: numbers about the agent itself, about one target, about one neighbour
OWN_FIELDS, TARGET_FIELDS, NEIGHBOUR_FIELDS = 14, 24, 4


@borrowing
def _own(flat: Array, j: int, p: Array, q: Array, v: Array, agent: Array, scales: Array) -> None:
    r = matrix(quaternion(q, j, 0))
    axis = (r[0][2], r[1][2], r[2][2])
    down = max(-axis[2], 0.0)
    for i in range(3):
        flat[i] = (p[j, i] - agent[i]) / agent[3 + i]
        flat[3 + i] = v[j, i] / scales[0]
        flat[8 + i] = agent[6 + i]
        flat[11 + i] = agent[9 + i]
    flat[6] = math.atan2(axis[0], down) / scales[1]
    flat[7] = math.atan2(axis[1], down) / scales[1]


@borrowing
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


@borrowing
def _near(
    flat: Array, j: int, p: Array, agents: Array, neighbours: int, range_m: float, distance: Array
) -> None:
    """Nearest agents in range, nearest first, of equally near ones the first; ``distance`` (N,) is overwritten."""
    for i in range(agents.shape[0]):
        x, y, z = p[i, 0] - p[j, 0], p[i, 1] - p[j, 1], p[i, 2] - p[j, 2]
        distance[i] = math.sqrt(x * x + y * y + z * z)
    distance[j] = math.inf
    for k in range(neighbours):
        other = 0
        for i in range(1, agents.shape[0]):
            if distance[i] < distance[other]:
                other = i
        if distance[other] > range_m:
            return
        flat[4 * k] = 1.0
        for i in range(3):
            flat[4 * k + 1 + i] = (p[other, i] - p[j, i]) / agents[j, 3 + i]
        distance[other] = math.inf


@borrowing
def _write(
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
    flat: Array,
    distance: Array,
    out: NDArray[np.float32],
) -> None:
    n, m = agents.shape[0], estimates.shape[0]
    for j in range(n):
        for k in range(flat.shape[0]):
            flat[k] = 0.0
        _own(flat, j, p, q, v, agents[j], scales)
        for t in range(m):
            part = flat[OWN_FIELDS + TARGET_FIELDS * t : OWN_FIELDS + TARGET_FIELDS * (t + 1)]
            _target(part, estimates[t], entries[t, j], agents[j], scales, inside[t, j], visible[j, t])
            if estimates[t, 12] > 0.0:
                for c in range(visible.shape[0]):
                    if visible[c, t]:
                        part[12] = 1.0
        _near(flat[OWN_FIELDS + TARGET_FIELDS * m :], j, p, agents, neighbours, scales[3], distance)
        for k in range(low.shape[0]):
            out[j, k] = min(max(flat[k], low[k]), high[k])


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
    out = np.empty((len(agents), len(low)), dtype=np.float32)
    places = (p, q, v, agents, estimates, entries, inside, visible, scales, neighbours, low, high)
    _write(*places, np.empty(len(low)), np.empty(len(agents)), out)
    return out
