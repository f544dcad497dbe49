"""Nearest lessons and their weights: adaptive-bandwidth kernel regression (Loftsgaarden and Quesenberry 1965).

| symbol | name | shape | meaning |
| --- | --- | --- | --- |
| x | ``query`` | (d,) | scaled features: exit position, exit velocity, logarithm of the time taken |
| x_j | ``features`` | (n, d) | those of the lessons |
| c_j | ``penalty`` | (n,) | added to a lesson's squared distance |
| d2_j | ``distance2`` | (k,) | ``|x - x_j|^2 + c_j - b [same target] - a exp(-|t - t_j| / tau)``, ascending |
| w_j | weights | (k,) | ``exp(-(d2_j - d2_1) / max(d2_r - d2_1, floor))`` |
"""

from __future__ import annotations

import numpy as np

from camnet.compiled import cached_njit
from camnet.types import Array, IntArray

__all__ = ["nearest_lessons", "nearest_lessons_reference", "vote_weights"]


@cached_njit
def nearest_lessons(
    query: Array,
    query_t_s: float,
    query_target: int,
    features: Array,
    penalty: Array,
    lesson_t_s: Array,
    lesson_target: IntArray,
    bonuses: tuple[float, float, float],
    count: int,
) -> tuple[IntArray, Array]:
    """Find the ``count`` nearest lessons: indices (k,), squared distances (k,), nearest first; k <= count.

    Parameters
    ----------
    query : (d,) only the first d columns of ``features`` count
    query_t_s, query_target : time and target of the exit
    features, penalty, lesson_t_s, lesson_target : (n, >= d), (n,), (n,), (n,) the lessons
    bonuses : same target b, recency a, its time constant tau in s
    count : how many
    """
    n, d = len(features), len(query)
    same, recent, tau = bonuses
    k = min(count, n)
    best = np.full(k, np.inf)
    index = np.zeros(k, np.int64)
    worst = 0
    for j in range(n):
        s = penalty[j]
        if lesson_target[j] == query_target:
            s -= same
        for a in range(d):
            s += (query[a] - features[j, a]) ** 2
        if s - recent >= best[worst]:
            continue
        s -= recent * np.exp(-abs(query_t_s - lesson_t_s[j]) / tau)
        if s < best[worst]:
            best[worst] = s
            index[worst] = j
            worst = int(np.argmax(best))
    order = np.argsort(best)
    return index[order], best[order]


def nearest_lessons_reference(
    query: Array,
    query_t_s: float,
    query_target: int,
    features: Array,
    penalty: Array,
    lesson_t_s: Array,
    lesson_target: IntArray,
    bonuses: tuple[float, float, float],
    count: int,
) -> tuple[IntArray, Array]:
    """`nearest_lessons` as it reads."""
    same, recent, tau = bonuses
    distance2 = (
        np.sum((features[:, : len(query)] - query) ** 2, axis=1)
        + penalty
        - same * (lesson_target == query_target)
        - recent * np.exp(-np.abs(query_t_s - lesson_t_s) / tau)
    )
    order = np.argsort(distance2, kind="stable")[:count]
    return order, distance2[order]


def vote_weights(distance2: Array, rank: int, floor: float) -> Array:
    """Weights (k,) of lessons at ascending squared distances (k,); the nearest has weight 1."""
    above = distance2 - distance2[0]
    return np.asarray(np.exp(-above / max(above[min(rank, len(above)) - 1], floor)))
