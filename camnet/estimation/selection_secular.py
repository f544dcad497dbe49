"""Exact smallest-eigenvalue selection with one eigendecomposition a candidate (Golub 1973; Bunch et al. 1978).

| symbol | name | shape |
| --- | --- | --- |
| A = S + Y^T Y = Q diag(d) Q^T, d ascending | ``values``, ``vectors`` | (p,), (p, p) |
| Y_j | ``rows`` | (N, p) |
| z_j = Q^T Y_j^T | ``projected`` | (N, p) |
| delta_j = d_1 - lambda_min(A - Y_j^T Y_j) | ``drops`` | (N,) |

The eigenvalues of ``A - Y_j^T Y_j`` are the roots of a secular equation; the smallest one lies ``delta_j`` below d_1:

    phi(delta) = sum_i z_i^2 / (d_i - d_1 + delta) = 1,        z_1^2 <= delta <= |z|^2.

1/phi is concave and rises (it is a harmonic mean of rising lines), so that Newton's method for ``1/phi = 1`` started on
the left, at z_1^2, never overshoots and needs no bracket. Where z_1 = 0 and ``phi(0) <= 1`` the equation deflates:
delta = 0.

Leaving terms out of phi makes its root smaller. The k lowest eigenvectors alone thus give a lower bound of every
delta_j at the cost of N p k; the full equation is solved in the order of these bounds until the next bound is above
the best root. The entry found is the one that solving all N equations would give.

Below rounding, ``p eps lambda_max``, smallest eigenvalues differ by noise alone; there the choice is left to the
D-optimal rule, and the rule that ran is recorded.
"""

from __future__ import annotations

import math

import numpy as np

from camnet.compiled import cached_njit
from camnet.estimation.selection import DOptimalRule
from camnet.types import Array

__all__ = ["SecularEigenvalueRule", "drops", "rounding_floor", "smallest_after_downdates"]

#: lowest eigenvectors that bound each drop from below
BOUND_VECTORS = 8
#: equations solved in full at a time
CHUNK = 32
#: Newton steps after which the last iterate stands; quadratic convergence needs far fewer
MAX_STEPS = 60
_EPS = float(np.finfo(float).eps)


def rounding_floor(size: int, largest: float) -> float:
    """Smallest eigenvalues (p, p) matrices of norm ``largest`` are known to no better than this."""
    return size * _EPS * largest


@cached_njit
def drops(projected: Array, shifts: Array) -> Array:
    """Root delta (N,) of each secular equation: z_j in the rows of ``projected`` (N, k), ``shifts`` d_i - d_1 (k,)."""
    n, k = projected.shape
    out = np.empty(n)
    squares = np.empty(k)
    for j in range(n):
        delta = 0.0
        for i in range(k):
            squares[i] = projected[j, i] * projected[j, i]
            if shifts[i] == 0.0:
                # a multiple smallest eigenvalue: its directions count together
                delta += squares[i]
        for _ in range(MAX_STEPS):
            phi, slope = 0.0, 0.0
            for i in range(k):
                if squares[i] > 0.0:
                    term = squares[i] / (shifts[i] + delta)
                    phi += term
                    slope += term / (shifts[i] + delta)
            if phi <= 1.0:
                break
            # Newton on 1/phi = 1
            step = (phi - 1.0) * phi / slope
            delta += step
            if step <= 2.0 * _EPS * delta:
                break
        out[j] = delta
    return out


def smallest_after_downdates(matrix: Array, rows: Array) -> Array:
    """Smallest eigenvalue (N,) of ``matrix - row^T row`` for each row: (p, p) and (N, p)."""
    values, vectors = np.linalg.eigh(matrix)
    return np.asarray(values[0] - drops(rows @ vectors, values - values[0]))


def _least_drop(rows: Array, values: Array, vectors: Array) -> tuple[int, float]:
    """Index of the row with the least drop and that drop; the first of equals."""
    shifts = values - values[0]
    k = min(BOUND_VECTORS, len(values))
    bound = drops(rows @ np.ascontiguousarray(vectors[:, :k]), shifts[:k])
    order = np.argsort(bound, kind="stable")
    best, least = -1, math.inf
    for first in range(0, len(order), CHUNK):
        picked = order[first : first + CHUNK]
        if bound[picked[0]] > least:
            break
        found = drops(rows[picked] @ vectors, shifts)
        low = float(found.min())
        index = int(picked[found == low].min())
        if low < least or (low == least and index < best):
            best, least = index, low
    return best, least


class SecularEigenvalueRule:
    """``SmallestEigenvalueRule`` with one eigendecomposition; D-optimal where the eigenvalues are noise.

    ``ran`` counts the candidates that each rule decided; ``name`` is the rule that decided the last one.
    """

    def __init__(self, capacity: int, size: int, delta: float) -> None:
        self._fallback = DOptimalRule(capacity, size, delta)
        self._present: float | None = None
        self._proposed: float | None = None
        self.name = "lambda_min"
        self.ran = {"lambda_min": 0, "d_optimal": 0}

    def added(self, index: int, row: Array, rows: Array, gram: Array) -> None:
        """See ``SelectionRule.added``."""
        self._fallback.added(index, row, rows, gram)
        self._present = None

    def replaced(self, index: int, old: Array, row: Array, rows: Array, gram: Array) -> None:
        """See ``SelectionRule.replaced``."""
        self._fallback.replaced(index, old, row, rows, gram)
        self._present = self._proposed

    def rebuilt(self, rows: Array, gram: Array) -> None:
        """See ``SelectionRule.rebuilt``."""
        self._fallback.rebuilt(rows, gram)
        self._present = None

    def choose(self, row: Array, rows: Array, gram: Array) -> int:
        """See ``SelectionRule.choose``."""
        self._proposed = None
        diagonal = gram.diagonal() + row * row
        # lambda_min <= least and lambda_max >= largest diagonal entry
        if diagonal.min() > rounding_floor(len(row), float(diagonal.max())):
            values, vectors = np.linalg.eigh(gram + np.outer(row, row))
            floor = rounding_floor(len(row), float(values[-1]))
            if values[0] > floor:
                best, drop = _least_drop(rows, values, vectors)
                if values[0] - drop > floor:
                    return self._decide(best, float(values[0]) - drop, gram)
        self.name = "d_optimal"
        self.ran[self.name] += 1
        return self._fallback.choose(row, rows, gram)

    def _decide(self, best: int, smallest: float, gram: Array) -> int:
        self.name = "lambda_min"
        self.ran[self.name] += 1
        if self._present is None:
            self._present = float(np.linalg.eigvalsh(gram)[0])
        if smallest <= self._present:
            return -1
        self._proposed = smallest
        return best
