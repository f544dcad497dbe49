"""What is asked of the truth at every sensing step, in one compiled call: who is where, and who sees whom.

The parts are compiled functions that others use one by one: membership in boxes, who may see, the frusta, distances.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from camnet.geometry.spacing import least_distance
from camnet.sensing.visibility import see, who_may_see
from camnet.types import Array, BoolArray, IntArray

__all__ = ["first_seers", "survey"]


@njit(cache=True)
def survey(
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
) -> tuple[BoolArray, IntArray, BoolArray, float]:
    """Visible pairs (C,M), first region (M,) of each target (-1: none), agents (N,) outside their regions, spacing.

    Parameters
    ----------
    agent_p, camera_p, camera_q, target_p, target_q : the truth of N agents, C cameras, M targets
    low, high : (C,3) corners of the boxes about the regions
    exceptions : (M + N, C) who is not in a region though in its box: targets first
    working : (C,) which cameras work
    a, b, features, first : frusta and features, see `camnet.sensing.visibility`
    """
    n_targets, n_agents = target_p.shape[0], agent_p.shape[0]
    inside = np.empty((n_targets, camera_p.shape[0]), dtype=np.bool_)
    for m in range(n_targets):
        for c in range(camera_p.shape[0]):
            inside[m, c] = _in_box(target_p[m], low[c], high[c]) and not exceptions[m, c]
    outside = np.empty(n_agents, dtype=np.bool_)
    for j in range(n_agents):
        outside[j] = not _in_box(agent_p[j], low[j], high[j]) or exceptions[n_targets + j, j]
    allowed, region = who_may_see(inside, working, n_agents)
    visible = see(a, b, camera_p, camera_q, target_p, target_q, features, first, allowed)
    return visible, region, outside, least_distance(agent_p)


@njit(cache=True)
def _in_box(p: Array, low: Array, high: Array) -> bool:
    return bool(low[0] <= p[0] <= high[0] and low[1] <= p[1] <= high[1] and low[2] <= p[2] <= high[2])


@njit(cache=True)
def first_seers(visible: BoolArray) -> IntArray:
    """Return the first camera (M,) that sees each target, from ``visible`` (C,M); -1: none does."""
    out = np.full(visible.shape[1], -1, dtype=np.int64)
    for m in range(visible.shape[1]):
        for c in range(visible.shape[0] - 1, -1, -1):
            if visible[c, m]:
                out[m] = c
    return out
