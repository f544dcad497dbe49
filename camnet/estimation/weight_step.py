"""The implicit weight step as the estimator runs it: dense where data is, diagonal elsewhere.

| symbol | name | shape |
| --- | --- | --- |
| W | ``weights`` | (p, 8) |
| M = (I + dt kCL gamma (Psi + delta I))^-1 over the n touched kernels | ``inverse``, symmetric | (n, n) |
| kernel numbers of its rows | ``order`` | (n,) |
| 1 / (1 + dt kCL gamma delta) | ``fade``: M for every other kernel | - |
| Q, sigma, G^T eta_til | ``moment``, ``sigma``, ``error`` | (p, 8), (p,), (8,) |

``W+ = M (W + dt gamma (sigma (G^T eta_til)^T + kCL Q))``, then the projection: (8), (3-10), (4-18) as in
``concurrent_learning.implicit_step``, which is the readable form and the oracle of this one. Kernels that no window has
touched have no row in Psi, so M is diagonal there. The product runs over rows of the symmetric M with the outputs
outermost: unit stride everywhere, four rows at a time.
"""

from __future__ import annotations

import numpy as np

from camnet.compiled import cached_njit
from camnet.estimation.projection import project_step
from camnet.estimation.propagate import COLUMNS
from camnet.types import Array, IntArray

__all__ = ["symmetric_product", "weight_step"]


@cached_njit
def symmetric_product(matrix: Array, right: Array, out: Array) -> None:
    """Write ``right matrix`` (8, n) to ``out`` for a symmetric (n, n) matrix: the transpose of M R."""
    n = matrix.shape[0]
    whole = n - n % 4
    for o in range(right.shape[0]):
        for a in range(n):
            out[o, a] = 0.0
        for b in range(0, whole, 4):
            x0, x1, x2, x3 = right[o, b], right[o, b + 1], right[o, b + 2], right[o, b + 3]
            for a in range(n):
                out[o, a] += (
                    matrix[b, a] * x0 + matrix[b + 1, a] * x1 + matrix[b + 2, a] * x2 + matrix[b + 3, a] * x3
                )
        for b in range(whole, n):
            x0 = right[o, b]
            for a in range(n):
                out[o, a] += matrix[b, a] * x0


@cached_njit
def weight_step(
    weights: Array,
    inverse: Array,
    order: IntArray,
    fade: float,
    moment: Array,
    sigma: Array,
    error: Array,
    rate: float,
    kcl: float,
    outputs: int,
    bound: float,
    layer: float,
) -> Array:
    """Weights (p, 8) one step on; ``rate`` is dt gamma."""
    p = weights.shape[0]
    n = len(order)
    after = np.empty((p, COLUMNS))
    for k in range(p):
        s = rate * sigma[k]
        for o in range(COLUMNS):
            after[k, o] = weights[k, o] + s * error[o] + rate * kcl * moment[k, o]
    right = np.empty((COLUMNS, n))
    product = np.empty((COLUMNS, n))
    for a in range(n):
        for o in range(COLUMNS):
            right[o, a] = after[order[a], o]
    symmetric_product(inverse, right, product)
    if fade != 1.0:
        for k in range(p):
            for o in range(COLUMNS):
                after[k, o] *= fade
    for a in range(n):
        for o in range(COLUMNS):
            after[order[a], o] = product[o, a]
    project_step(weights, after, outputs, bound, layer)
    return after
