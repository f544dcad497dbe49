"""Small dense linear algebra of the compiled kernels."""

from __future__ import annotations

import math

from camnet.compiled import cached_njit
from camnet.types import Array

__all__ = ["cholesky", "invert3"]


@cached_njit(error_model="numpy")
def cholesky(p: Array, low: Array) -> None:
    """Lower factor of ``p``; pivots that rounding made negative are raised to a hair above zero."""
    n = p.shape[0]
    for i in range(n):
        for j in range(i):
            acc = p[i, j]
            for m in range(j):
                acc -= low[i, m] * low[j, m]
            low[i, j] = acc / low[j, j]
            low[j, i] = 0.0
        acc = p[i, i]
        for m in range(i):
            acc -= low[i, m] * low[i, m]
        low[i, i] = math.sqrt(max(acc, 1e-14 * abs(p[i, i]) + 1e-300))


@cached_njit(error_model="numpy")
def invert3(a: Array, out: Array) -> None:
    """Inverse of a symmetric positive definite (3,3) by cofactors."""
    c00 = a[1, 1] * a[2, 2] - a[1, 2] * a[1, 2]
    c01 = a[0, 2] * a[1, 2] - a[0, 1] * a[2, 2]
    c02 = a[0, 1] * a[1, 2] - a[0, 2] * a[1, 1]
    inv = 1.0 / (a[0, 0] * c00 + a[0, 1] * c01 + a[0, 2] * c02)
    out[0, 0] = c00 * inv
    out[0, 1] = c01 * inv
    out[0, 2] = c02 * inv
    out[1, 0] = out[0, 1]
    out[1, 1] = (a[0, 0] * a[2, 2] - a[0, 2] * a[0, 2]) * inv
    out[1, 2] = (a[0, 1] * a[0, 2] - a[0, 0] * a[1, 2]) * inv
    out[2, 0] = out[0, 2]
    out[2, 1] = out[1, 2]
    out[2, 2] = (a[0, 0] * a[1, 1] - a[0, 1] * a[0, 1]) * inv
