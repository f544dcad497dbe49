"""What is asked of the truth at every sensing step, in one compiled call: who is where, and who sees whom.

`camnet.sensing.visibility` has the parts one by one, which are the test oracles: membership in regions, who may see,
the frusta.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from camnet.geometry.triples import Triple, borrowing, into, matrix, norm, out_of, quaternion, triple
from camnet.types import Array, BoolArray, IntArray

__all__ = ["first_seers", "survey"]


@borrowing
def _in_box(p: Array, k: int, low: Array, high: Array, c: int) -> bool:
    return bool(
        low[c, 0] <= p[k, 0] <= high[c, 0]
        and low[c, 1] <= p[k, 1] <= high[c, 1]
        and low[c, 2] <= p[k, 2] <= high[c, 2]
    )


@borrowing
def _in_frustum(a: Array, b: Array, c: int, point: Triple) -> bool:
    beyond = 0
    for k in range(6):
        beyond += a[c, k, 0] * point[0] + a[c, k, 1] * point[1] + a[c, k, 2] * point[2] > b[c, k]
    return beyond == 0


@borrowing
def _sees(
    c: int,
    m: int,
    camera_p: Array,
    camera_q: Array,
    target_p: Array,
    target_q: Array,
    a: Array,
    b: Array,
    features: Array,
    first: IntArray,
) -> bool:
    """Whether all features of target ``m`` are in the frustum of camera ``c``."""
    turn, view = matrix(quaternion(target_q, m, 0)), matrix(quaternion(camera_q, c, 0))
    for f in range(first[m], first[m + 1]):
        arm = out_of(turn, triple(features, f, 0))
        way = (
            target_p[m, 0] + arm[0] - camera_p[c, 0],
            target_p[m, 1] + arm[1] - camera_p[c, 1],
            target_p[m, 2] + arm[2] - camera_p[c, 2],
        )
        if not _in_frustum(a, b, c, into(view, way)):
            return False
    return True


@borrowing
def _survey(
    agent_p: Array,
    camera_p: Array,
    camera_q: Array,
    target_p: Array,
    target_q: Array,
    low: Array,
    high: Array,
    exceptions: BoolArray,
    working: BoolArray,
    a: Array,
    b: Array,
    features: Array,
    first: IntArray,
    visible: BoolArray,
    outside: BoolArray,
    who: IntArray,
) -> float:
    """Write what `survey` returns; the least distance between two agents, m."""
    n_targets, n_agents = target_p.shape[0], agent_p.shape[0]
    for m in range(n_targets):
        who[0, m] = who[1, m] = -1
        for c in range(camera_p.shape[0] - 1, -1, -1):
            inside = _in_box(target_p, m, low, high, c) and not exceptions[m, c]
            if inside:
                who[0, m] = c
            may = working[c] and (inside or c >= n_agents)
            visible[c, m] = may and _sees(c, m, camera_p, camera_q, target_p, target_q, a, b, features, first)
            if visible[c, m]:
                who[1, m] = c
    least = math.inf
    for j in range(n_agents):
        outside[j] = not _in_box(agent_p, j, low, high, j) or exceptions[n_targets + j, j]
        x = triple(agent_p, j, 0)
        for i in range(j):
            y = triple(agent_p, i, 0)
            least = min(least, norm((x[0] - y[0], x[1] - y[1], x[2] - y[2])))
    return least


def survey(
    agent_p: Array,
    camera_p: Array,
    camera_q: Array,
    target_p: Array,
    target_q: Array,
    *facts: Any,  # noqa: ANN401 - as listed
) -> tuple[BoolArray, BoolArray, IntArray, float]:
    """Visible pairs (C,M), agents (N,) outside their regions, region and seer (2,M) of the targets, least distance.

    Of several regions or cameras the first counts; -1: none. The distance is that between two agents, m.

    Parameters
    ----------
    agent_p, camera_p, camera_q, target_p, target_q : the truth of N agents, C cameras, M targets
    facts : corners (C,3), (C,3) of the boxes about the regions; who (M + N, C) is not in a region though in its box,
        targets first; which cameras (C,) work; frusta and features (`camnet.sensing.visibility.VisibilityTest.packed`)
    """
    cameras, targets = len(camera_p), len(target_p)
    visible = np.empty((cameras, targets), dtype=np.bool_)
    outside = np.empty(len(agent_p), dtype=np.bool_)
    who = np.empty((2, targets), dtype=np.int64)
    truth = (agent_p, camera_p, camera_q, target_p, target_q)
    everything: tuple[Any, ...] = (*truth, *facts, visible, outside, who)
    return visible, outside, who, _survey(*everything)


def first_seers(visible: BoolArray) -> list[int]:
    """Return the first camera that sees each target, from ``visible`` (C,M); -1: none does."""
    seers: list[int] = np.where(visible.any(axis=0), visible.argmax(axis=0), -1).tolist()
    return seers
