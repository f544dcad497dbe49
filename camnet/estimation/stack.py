"""History stack of integral windows (parikh2018 (8), (9); harris2020 (3-11), (4-19)).

| symbol | name | shape | unit |
| --- | --- | --- | --- |
| Y_i | ``rows`` | (N, p) | s |
| Deta_i - F_i | ``increments``: with the unit output in the last column | (N, m) | m, rad, s |
| sum Y_i^T Y_i | ``gram`` | (p, p) | s^2 |
| sum Y_i^T (Deta_i - F_i) | ``moment`` | (p, m) | m s, rad s |
| T | ``excited_s``: since when lambda_min >= lambda_lo (3-19) holds without a break | - | s |

A window may carry a weight in (0, 1] (inverse variance relative to a measured window): row and increment are stored
multiplied by its root. Instantaneous data (Y_k = sigma^T, eta'_k of (3-13), (4-20)) fit the same structure.
"""

from __future__ import annotations

import math

import numpy as np

from camnet.compiled import cached_njit
from camnet.estimation.selection import SelectionRule
from camnet.types import Array, BoolArray

__all__ = ["Change", "HistoryStack", "is_excited"]

#: a change of a stack: rows that entered (+1) and left (-1)
Change = tuple[tuple[Array, float], ...]


@cached_njit
def _accumulate(gram: Array, moment: Array, y: Array, d: Array, sign: float) -> None:
    """Add or take away one window's share of both sums."""
    for i in range(len(y)):
        if y[i] != 0.0:
            share = sign * y[i]
            for j in range(len(y)):
                gram[i, j] += share * y[j]
            for j in range(len(d)):
                moment[i, j] += share * d[j]


def is_excited(gram: Array, threshold: float) -> bool:
    """(3-19): lambda_min(S) >= lambda_lo exactly when S - lambda_lo I has a Cholesky factor."""
    if float(gram.diagonal().min()) < threshold:
        return False
    try:
        np.linalg.cholesky(gram - threshold * np.eye(len(gram)))
    except np.linalg.LinAlgError:
        return False
    return True


class HistoryStack:
    """At most ``capacity`` weighted windows over p kernels and m outputs."""

    def __init__(
        self, capacity: int, size: int, outputs: int, rule: SelectionRule, excitation_threshold: float
    ) -> None:
        self._rule = rule
        self._threshold = excitation_threshold
        self._rows = np.zeros((capacity, size))
        self._increments = np.zeros((capacity, outputs))
        self._entered_s = np.zeros(capacity)
        self.gram = np.zeros((size, size))
        self.moment = np.zeros((size, outputs))
        self.count = 0
        self.refused = 0
        self.excited_s = math.inf
        self._stale = True
        self._lambda_min = 0.0

    @property
    def rows(self) -> Array:
        """The (n, p) regressors held."""
        return self._rows[: self.count]

    @property
    def increments(self) -> Array:
        """The (n, m) increments held."""
        return self._increments[: self.count]

    @property
    def entered_s(self) -> Array:
        """Time (n,) at which each window held was offered, s."""
        return self._entered_s[: self.count]

    @property
    def rule_name(self) -> str:
        """Name of the selection rule that runs."""
        return self._rule.name

    def offer(self, t_s: float, row: Array, increment: Array, weight: float = 1.0) -> Change:
        """Add a window if there is room, else let the rule decide; returns the rows that entered and left."""
        root = math.sqrt(weight)
        y, d = root * row, root * increment
        if self.count < len(self._rows):
            index, self.count = self.count, self.count + 1
            change: Change = ((y, 1.0),)
            self._write(index, y, d)
            self._rule.added(index, y, self.rows, self.gram)
        else:
            index = self._rule.choose(y, self.rows, self.gram)
            if index < 0:
                self.refused += 1
                return ()
            old = self._rows[index].copy()
            _accumulate(self.gram, self.moment, old, self._increments[index], -1.0)
            change = ((y, 1.0), (old, -1.0))
            self._write(index, y, d)
            self._rule.replaced(index, old, y, self.rows, self.gram)
        self._entered_s[index] = t_s
        self._stale = True
        self._check_excitation(t_s)
        return change

    def forget(self, entries: BoolArray) -> None:
        """Drop the windows marked in ``entries`` (n,); sums, books and the excitation time start from what is left."""
        keep = np.flatnonzero(~entries)
        n = len(keep)
        for array in (self._rows, self._increments, self._entered_s):
            array[:n] = array[keep]
        self.count = n
        self.gram[:] = self.rows.T @ self.rows
        self.moment[:] = self.rows.T @ self.increments
        self._rule.rebuilt(self.rows, self.gram)
        self.excited_s = math.inf
        self._stale = True

    def _write(self, index: int, y: Array, d: Array) -> None:
        self._rows[index] = y
        self._increments[index] = d
        _accumulate(self.gram, self.moment, y, d, 1.0)

    def _check_excitation(self, t_s: float) -> None:
        """(3-19); a change of the stack may end it as well as begin it."""
        if not is_excited(self.gram, self._threshold):
            self.excited_s = math.inf
        elif math.isinf(self.excited_s):
            self.excited_s = t_s

    def lambda_min(self) -> float:
        """Smallest eigenvalue of ``gram``; computed when the stack has changed since."""
        if self._stale:
            self._lambda_min = float(np.linalg.eigvalsh(self.gram)[0])
            self._stale = False
        return self._lambda_min

    def lambda_min_visited(self, share: float = 0.05) -> float:
        """Return the same over the kernels that data has reached: diagonal above ``share`` of the largest."""
        diagonal = self.gram.diagonal()
        keep = np.flatnonzero(diagonal > share * max(float(diagonal.max()), 1e-300))
        return float(np.linalg.eigvalsh(self.gram[np.ix_(keep, keep)])[0]) if len(keep) else 0.0
