"""Which entry of a full history stack gives way to a new one (parikh2018 Algorithm 1; Chowdhary 2010, ch. 6).

| symbol | name | shape |
| --- | --- | --- |
| Y_i | ``rows``: integrated regressors of the stack | (N, p) |
| Y | ``row``: candidate | (p,) |
| S | ``gram``: sum of Y_i^T Y_i | (p, p) |
| A = S + delta I | inverse kept by ``DOptimalRule`` | (p, p) |

``SmallestEigenvalueRule`` (printed): ``j* = argmax_j lambda_min(S - Y_j^T Y_j + Y^T Y)``, taken if it exceeds
``lambda_min(S)``; N eigendecompositions a candidate. ``DOptimalRule``: ``j* = argmax_j gain_j``, taken if the gain
exceeds 1, where by the matrix determinant lemma

    gain_j = det(A + Y^T Y - Y_j^T Y_j) / det A = (1 + h)(1 - h_j) + c_j^2,   h = Y A^-1 Y^T,  h_j = Y_j A^-1 Y_j^T,
    c_j = Y A^-1 Y_j^T.

h_j and A^-1 follow every change of the stack by rank-one updates, O(N p + p^2) a candidate.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from camnet.compiled import cached_njit
from camnet.types import Array

__all__ = ["DOptimalRule", "SelectionRule", "SmallestEigenvalueRule", "rank_one", "replacement_gains"]

#: rank-one changes after which a kept inverse is computed afresh, against the growth of rounding errors
REFRESH_EVERY = 500


class SelectionRule(Protocol):
    """Chooses the entry to replace; told of every change so that it can keep its own books."""

    name: str

    def added(self, index: int, row: Array, rows: Array, gram: Array) -> None:
        """``row`` was written to the free place ``index``; ``rows`` (n, p) and ``gram`` hold it already."""

    def replaced(self, index: int, old: Array, row: Array, rows: Array, gram: Array) -> None:
        """``row`` took the place of ``old``."""

    def rebuilt(self, rows: Array, gram: Array) -> None:
        """Entries were dropped; ``rows`` (n, p) are left."""

    def choose(self, row: Array, rows: Array, gram: Array) -> int:
        """Index of the entry that should give way, or -1 to refuse the candidate."""


class SmallestEigenvalueRule:
    """The printed rule, by brute force."""

    name = "lambda_min"

    def added(self, index: int, row: Array, rows: Array, gram: Array) -> None:
        """Nothing to keep."""

    def replaced(self, index: int, old: Array, row: Array, rows: Array, gram: Array) -> None:
        """Nothing to keep."""

    def rebuilt(self, rows: Array, gram: Array) -> None:
        """Nothing to keep."""

    def choose(self, row: Array, rows: Array, gram: Array) -> int:
        """See ``SelectionRule.choose``."""
        with_row = gram + np.outer(row, row)
        smallest = np.array([np.linalg.eigvalsh(with_row - np.outer(y, y))[0] for y in rows])
        best = int(np.argmax(smallest))
        return best if smallest[best] > np.linalg.eigvalsh(gram)[0] else -1


class DOptimalRule:
    """Largest determinant of ``S + delta I``."""

    name = "d_optimal"

    def __init__(self, capacity: int, size: int, delta: float) -> None:
        self._delta = delta
        self._inverse = np.eye(size) / delta
        self._leverage = np.zeros(capacity)
        self._changes = 0

    def added(self, index: int, row: Array, rows: Array, gram: Array) -> None:
        """See ``SelectionRule.added``."""
        _include(self._inverse, self._leverage, rows[:index], row, 1.0)
        self._leverage[index] = row @ self._inverse @ row
        self._count(rows, gram)

    def replaced(self, index: int, old: Array, row: Array, rows: Array, gram: Array) -> None:
        """See ``SelectionRule.replaced``."""
        _include(self._inverse, self._leverage, rows, row, 1.0)
        _include(self._inverse, self._leverage, rows, old, -1.0)
        self._leverage[index] = row @ self._inverse @ row
        self._count(rows, gram)

    def choose(self, row: Array, rows: Array, gram: Array) -> int:
        """See ``SelectionRule.choose``."""
        gains = replacement_gains(self._inverse, self._leverage[: len(rows)], rows, row)
        best = int(np.argmax(gains))
        return best if gains[best] > 1.0 else -1

    def _count(self, rows: Array, gram: Array) -> None:
        self._changes += 1
        if self._changes % REFRESH_EVERY == 0:
            self.rebuilt(rows, gram)

    def rebuilt(self, rows: Array, gram: Array) -> None:
        """See ``SelectionRule.rebuilt``."""
        self._inverse = np.asarray(np.linalg.inv(gram + self._delta * np.eye(len(gram))), dtype=np.float64)
        self._leverage[: len(rows)] = np.einsum("ij,ij->i", rows @ self._inverse, rows)


def replacement_gains(inverse: Array, leverage: Array, rows: Array, row: Array) -> Array:
    """Gain (N,) of replacing each row by ``row``; ``inverse`` is A^-1 of the present stack, ``leverage`` its h_j."""
    u = inverse @ row
    h = float(row @ u)
    c = rows @ u
    return np.asarray((1.0 + h) * (1.0 - leverage) + c * c)


@cached_njit
def rank_one(inverse: Array, row: Array, sign: float) -> Array:
    """Sherman-Morrison: turn A^-1 into (A + sign row row^T)^-1 in place; returns u = A^-1 row scaled for reuse.

    With the returned ``u`` (p,), any ``x^T A^-1 x`` changes by ``-sign (x^T u)^2``.
    """
    p = len(row)
    u = np.zeros(p)
    for k in range(p):
        if row[k] != 0.0:
            for i in range(p):
                u[i] += inverse[k, i] * row[k]
    h = 0.0
    for i in range(p):
        h += row[i] * u[i]
    scale = 1.0 / np.sqrt(max(1.0 + sign * h, 1e-12))
    for i in range(p):
        u[i] *= scale
    for i in range(p):
        if u[i] != 0.0:
            f = sign * u[i]
            for j in range(p):
                inverse[i, j] -= f * u[j]
    return u


def _include(inverse: Array, leverage: Array, rows: Array, row: Array, sign: float) -> None:
    """Rank-one change of A^-1 and of the leverages of ``rows``, in place."""
    u = rank_one(inverse, row, sign)
    leverage[: len(rows)] -= sign * (rows @ u) ** 2
