r"""Value of the MAP objective (27)-(30), and the curved step that lowers it.

A Gauss-Newton correction d of the states satisfies the transitions to first order only, and Q is so small in position
that the second-order rest dominates the objective: along s + d it hardly ever falls, whatever its length. The step is
therefore taken in the disturbances: the first state moves by d_0, every disturbance to its value eps_i = -Q_i lam_{i+1} of
the linear solution, and the states follow by the exact flow,

    s_{i+1} = f(s_i) + (1 - a) eps_i + a eps_i*          (21) with the disturbance of the step of length a

so that the transition part of the objective is exactly as the linear solution says and only the observation part,
which is not stiff, sees the curvature. Halving a until the objective does not rise makes every update a descent.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from camnet.estimation.adate.chain import invert3
from camnet.estimation.pls.noise import transition

__all__ = ["objective", "roll", "squared_norm"]


@njit(cache=True, error_model="numpy")
def squared_norm(e, cov, low):  # type: ignore[no-untyped-def]
    """e' cov^-1 e by Cholesky; inf when ``cov`` is not positive definite. ``low`` (10,10) is scratch."""
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


@njit(cache=True, error_model="numpy")
def objective(n, par, s, tau, rest, q, z, r, seen, mean, cov):  # type: ignore[no-untyped-def]
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


@njit(cache=True, error_model="numpy")
def roll(n, par, s, nxt, tau, rest, q, d, lam, length, out):  # type: ignore[no-untyped-def]
    """Trajectory ``out`` (n,10) after a step of ``length`` in the disturbances.

    Parameters
    ----------
    s, nxt : trajectory (n,10) and its flow (n-1,10)
    q, d, lam : transition covariances, corrections and multipliers of `chain.backward`
    """
    jac = np.empty((6, 7))
    for m in range(10):
        out[0, m] = s[0, m] + length * d[0, m]
    for i in range(n - 1):
        transition(par, out[i], tau[i], rest, out[i + 1], jac)
        for m in range(10):
            new = 0.0
            for a in range(10):
                new -= q[i, m, a] * lam[i + 1, a]
            out[i + 1, m] += (1.0 - length) * (s[i + 1, m] - nxt[i, m]) + length * new
