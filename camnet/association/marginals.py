"""Probabilities of one-to-one assignments: every entry belongs to one exit, an exit has at most one entry.

| symbol | name | meaning |
| --- | --- | --- |
| W_ij | ``weights`` | likelihood of exit i with entry j over that of exit i without entry |
| mu_ij, nu_ij | messages | from exit i to entry j, and back |

``p(A) ~ prod_(i,j in A) W_ij`` over all assignments A in which every entry has an exit. The probability of one pair
is a ratio of permanents; loopy belief propagation finds it nearly, and converges (Williams and Lau 2014, eqs.
32-34):

``mu_ij = W_ij / (1 + sum_(k != j) W_ik nu_ik)``,  ``nu_ij = 1 / sum_(l != i) mu_lj``,  ``p_ij = mu_ij / sum_l
mu_lj``.

Small problems are summed over exactly by `exact_marginals`, column by column over sets of exits (Ryser's idea of
1963 as dynamic programming).
"""

from __future__ import annotations

import numpy as np

from camnet.compiled import cached_njit
from camnet.types import Array

__all__ = ["assignment_marginals", "exact_marginals"]

_ROUNDS = 60
_SMALL = 1e-12


@cached_njit
def assignment_marginals(weights: Array) -> Array:
    """Probability (n, k) that entry j belongs to exit i, from weights (n, k) >= 0; columns sum to 1.

    A column's scale does not matter; a column needs a positive weight.
    """
    n, k = weights.shape
    w = np.empty((n, k))
    for j in range(k):
        largest = 0.0
        for i in range(n):
            largest = max(largest, weights[i, j])
        for i in range(n):
            w[i, j] = max(weights[i, j] / largest, 1e-9)
    mu, nu = w.copy(), np.ones((n, k))
    for _ in range(_ROUNDS):
        change = 0.0
        for i in range(n):
            total = 0.0
            for j in range(k):
                total += w[i, j] * nu[i, j]
            for j in range(k):
                new = w[i, j] / max(1.0 + total - w[i, j] * nu[i, j], 1.0)
                change = max(change, abs(new - mu[i, j]))
                mu[i, j] = new
        for j in range(k):
            total = 0.0
            for i in range(n):
                total += mu[i, j]
            for i in range(n):
                nu[i, j] = 1.0 / max(total - mu[i, j], _SMALL)
        if change < 1e-9:
            break
    for j in range(k):
        total = 0.0
        for i in range(n):
            total += mu[i, j]
        for i in range(n):
            mu[i, j] /= total
    return mu


def exact_marginals(weights: Array) -> Array:
    """`assignment_marginals` without approximation, for at most about fifteen entries: O(n 2^k)."""
    n, k = weights.shape
    size = 1 << k
    before = np.zeros((n + 1, size))
    before[0, 0] = 1.0
    masks = np.arange(size)
    for i in range(n):
        before[i + 1] = before[i]
        for j in range(k):
            has = masks & (1 << j) != 0
            before[i + 1, masks[has]] += weights[i, j] * before[i, masks[has] ^ (1 << j)]
    after = np.zeros((n + 1, size))
    after[n, 0] = 1.0
    for i in reversed(range(n)):
        after[i] = after[i + 1]
        for j in range(k):
            has = masks & (1 << j) != 0
            after[i, masks[has]] += weights[i, j] * after[i + 1, masks[has] ^ (1 << j)]
    out = np.zeros((n, k))
    full = size - 1
    for i in range(n):
        for j in range(k):
            free = masks[masks & (1 << j) == 0]
            rest = full ^ (1 << j) ^ free
            out[i, j] = weights[i, j] * float(before[i, free] @ after[i + 1, rest])
    return np.asarray(out / before[n, full])
