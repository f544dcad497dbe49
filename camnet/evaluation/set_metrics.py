"""Distances between a set of estimates and a set of true targets at one instant, and identity switches over time.

| symbol | name | meaning |
| --- | --- | --- |
| c | `cutoff_m` | a distance beyond it counts as c: what a missed or a false target costs |
| p | `order` | outliers weigh more the larger it is |
| alpha | 2 | GOSPA's share of a missed or false target: c^p / alpha each |

OSPA: Schuhmacher, Vo & Vo, "A consistent metric for performance evaluation of multi-object filters", IEEE TSP 56(8),
2008, eq. (3). GOSPA: Rahmathullah, Garcia-Fernandez & Svensson, "Generalized optimal sub-pattern assignment
metric", FUSION 2017, eq. (1) with alpha = 2. Identity switches: Bernardin & Stiefelhagen, "Evaluating multiple object
tracking performance: the CLEAR MOT metrics", 2008: a target whose matched estimate is not the one it was matched
with last; matches that hold within the cutoff are kept, as there.

The assignment is SciPy's. The tracking libraries that have these figures (Stone Soup, motmetrics) take minutes for what
an evaluation asks here, once for every decision of every episode; Stone Soup is the oracle in the tests.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import linear_sum_assignment

from camnet.types import Array

__all__ = ["IdentityCounter", "gospa", "ospa"]


def _distances(truth: Array, estimates: Array) -> Array:
    return np.asarray(np.linalg.norm(truth[:, None, :] - estimates[None, :, :], axis=2))


def _least_cost(truth: Array, estimates: Array, cutoff_m: float, order: float) -> float:
    """Smallest sum over a full assignment of the smaller set of min(d, c)^p."""
    cost = np.minimum(_distances(truth, estimates), cutoff_m) ** order
    rows, columns = linear_sum_assignment(cost)
    return float(cost[rows, columns].sum())


def ospa(truth: Array, estimates: Array, cutoff_m: float, order: float = 2.0) -> float:
    """OSPA distance, m, of true positions (n, 3) and estimated ones (k, 3); 0 when both are empty."""
    n, k = len(truth), len(estimates)
    if n == 0 or k == 0:
        return 0.0 if n == k else cutoff_m
    total = _least_cost(truth, estimates, cutoff_m, order) + cutoff_m**order * abs(n - k)
    return float((total / max(n, k)) ** (1.0 / order))  # OSPA (3)


def gospa(truth: Array, estimates: Array, cutoff_m: float, order: float = 2.0) -> float:
    """GOSPA distance, m (alpha = 2): not divided by the number of targets; missed and false ones cost c^p / 2 each."""
    n, k = len(truth), len(estimates)
    least = _least_cost(truth, estimates, cutoff_m, order) if n and k else 0.0
    # an assigned pair at or beyond the cutoff costs c^p: one missed and one false target
    return float((least + cutoff_m**order / 2.0 * abs(n - k)) ** (1.0 / order))  # GOSPA (1)


class IdentityCounter:
    """Counts identity switches of one episode.

    Parameters
    ----------
    cutoff_m : a target and an estimate farther apart than this do not match
    """

    def __init__(self, cutoff_m: float) -> None:
        self.cutoff_m = cutoff_m
        self.switches = 0
        self._partner: dict[int, int] = {}

    def add(self, truth: Array, estimates: Array, labels: list[int]) -> None:
        """Match true positions (n, 3) with estimates (k, 3), whose ``labels`` (k) are the estimators' names."""
        if not len(truth) or not len(estimates):
            return
        distance = _distances(truth, estimates)
        free_rows, free_columns = set(range(len(truth))), set(range(len(labels)))
        for row, label in self._partner.items():
            column = labels.index(label) if label in labels else -1
            if column in free_columns and distance[row, column] <= self.cutoff_m:
                free_rows.discard(row)
                free_columns.discard(column)
        self._match_rest(distance, sorted(free_rows), sorted(free_columns), labels)

    def partner_of(self, row: int) -> int:
        """Label that target ``row`` was matched with last (-1: never)."""
        return self._partner.get(row, -1)

    def _match_rest(self, distance: Array, rows: list[int], columns: list[int], labels: list[int]) -> None:
        if not rows or not columns:
            return
        left = distance[np.ix_(rows, columns)]
        far = 1e6 * self.cutoff_m
        for i, j in zip(*linear_sum_assignment(np.where(left <= self.cutoff_m, left, far)), strict=True):
            if left[i, j] > self.cutoff_m:
                continue
            row, label = rows[int(i)], labels[columns[int(j)]]
            self.switches += self._partner.get(row, label) != label
            self._partner[row] = label
