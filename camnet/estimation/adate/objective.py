"""Value of the MAP objective (27)-(30): what the Gauss-Newton steps minimise.

The value is not used to accept steps. Q is so small in position that the second-order error of the transitions
dominates the
objective anywhere off the solution, and a descent rule cuts every step to nothing (measured); the steps close
the transitions to first order instead and converge in one to three iterations. `AdaptiveTrajectoryEstimator`
tests the closure.
"""

from __future__ import annotations

import math

import numpy as np

from camnet.compiled import cached_njit
from camnet.estimation.kalman.linalg import invert3
from camnet.estimation.pls.noise import transition
from camnet.types import Array, BoolArray

__all__ = ["objective", "squared_norm"]


@cached_njit(error_model="numpy")
def squared_norm(e: Array, cov: Array, low: Array) -> float:
    """E' cov^-1 e by Cholesky; inf when ``cov`` is not positive definite. ``low`` (10,10) is scratch."""
    n = e.shape[0]
    total = 0.0
    for i in range(n):
        for j in range(i):
            acc = cov[i, j]
            for m in range(j):
                acc -= low[i, m] * low[j, m]
            low[i, j] = acc / low[j, j]
        acc = cov[i, i]
        for m in range(i):
            acc -= low[i, m] * low[i, m]
        if not acc > 0.0:
            return math.inf
        low[i, i] = math.sqrt(acc)
    y = np.empty(n)
    for i in range(n):
        acc = e[i]
        for m in range(i):
            acc -= low[i, m] * y[m]
        y[i] = acc / low[i, i]
        total += y[i] * y[i]
    return total


@cached_njit(error_model="numpy")
def objective(
    n: int,
    par: Array,
    s: Array,
    tau: Array,
    rest: bool,
    q: Array,
    z: Array,
    r: Array,
    seen: BoolArray,
    mean: Array,
    cov: Array,
) -> float:
    """Sum of the squared normalised prior, transition and observation errors of a trajectory (n,10)."""
    low = np.empty((10, 10))
    nxt = np.empty(10)
    jac = np.empty((6, 7))
    inv = np.empty((3, 3))
    total = squared_norm(s[0] - mean, cov, low)
    for i in range(n):
        if i + 1 < n:
            transition(par, s[i], tau[i], rest, nxt, jac)
            for m in range(10):
                nxt[m] = s[i + 1, m] - nxt[m]
            total += squared_norm(nxt, q[i], low)
        if seen[i]:
            invert3(r[i], inv)
            for a in range(3):
                for b in range(3):
                    total += (z[i, a] - s[i, a]) * inv[a, b] * (z[i, b] - s[i, b])
    return total
