"""Compiled twin of `camnet.env.observe.Observer.readable` (its test oracle): all agents' observations in one call.

What is shown is in arrays that are pinned (`Shown`).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from camnet.geometry.pinned import Pins
from camnet.geometry.triples import borrowing, matrix, quaternion
from camnet.types import Array, BoolArray

__all__ = ["NEIGHBOUR_FIELDS", "OWN_FIELDS", "SHOWN", "TARGET_FIELDS", "Shown", "write_observations"]

#: numbers about the agent itself, about one target, about one neighbour
OWN_FIELDS, TARGET_FIELDS, NEIGHBOUR_FIELDS = 14, 24, 4


class Shown(NamedTuple):
    """What N agents are shown of M targets.

    | array | row |
    | --- | --- |
    | ``agents`` (N,13), of an agent | region's centre and half-size (6), the same in the network (6), view radius |
    | ``estimates`` (M,14), of a target | p (3), v (3), q (4), error radius, time last seen, 1 if known, top speed |
    | ``entries`` (M,N,9), of a target into a region | 0 none, 0.5 touched, 1 direct; p (3), v (3), time, error radius |
    | ``scales`` (5,) | top reference speed, largest gaze, look-ahead, communication range, time now |
    | ``low``, ``high`` (C,3) | corners of the boxes about the regions, m |
    | ``least``, ``most`` (D,) | bounds of the observations |
    | ``flat`` (D,), ``distance`` (N,) | scratch |
    """

    agents: Array
    estimates: Array
    entries: Array
    scales: Array
    low: Array
    high: Array
    least: NDArray[np.float32]
    most: NDArray[np.float32]
    flat: Array
    distance: Array
    neighbours: int


SHOWN = Pins(Shown)
_shown = SHOWN.of


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
def write_observations(
    at: int, p: Array, q: Array, v: Array, exceptions: BoolArray, visible: BoolArray, out: NDArray[np.float32]
) -> None:
    """Write observations (N,D) of agents with cameras at p (C,3), q (C,4), v (C,3) to ``out``.

    ``exceptions`` (M,C): which estimates are not in a region though in the box about it; ``visible`` (C,M).
    """
    x = _shown(at)
    n, m, flat = x.agents.shape[0], x.estimates.shape[0], x.flat
    for j in range(n):
        for k in range(flat.shape[0]):
            flat[k] = 0.0
        _own(flat, j, p, q, v, x.agents[j], x.scales)
        for t in range(m):
            part = flat[OWN_FIELDS + TARGET_FIELDS * t : OWN_FIELDS + TARGET_FIELDS * (t + 1)]
            estimate, inside = x.estimates[t], not exceptions[t, j]
            for i in range(3):
                inside = inside and x.low[j, i] <= estimate[i] <= x.high[j, i]
            _target(part, estimate, x.entries[t, j], x.agents[j], x.scales, inside, visible[j, t])
            if estimate[12] > 0.0:
                for c in range(visible.shape[0]):
                    if visible[c, t]:
                        part[12] = 1.0
        _near(flat[OWN_FIELDS + TARGET_FIELDS * m :], j, p, x.agents, x.neighbours, x.scales[3], x.distance)
        for k in range(x.least.shape[0]):
            out[j, k] = min(max(flat[k], x.least[k]), x.most[k])
