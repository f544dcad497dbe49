r"""One Gauss-Newton step of the sparse MAP over a chain of states (li2019, (27)-(34)), O(window).

Objective over the states s_0 .. s_n of the window, quadratic about the current trajectory:

    |s_0 - m|^2_{P^-1} + sum |s_{i+1} - f(s_i)|^2_{Q_i^-1} + sum |z_i - H s_i|^2_{R_i^-1}

| symbol | name | shape | equation |
| --- | --- | --- | --- |
| s | trajectory, 10 states | (n,10) | |
| Phi_i = [I X; 0 V; 0 0 I] | `jac` holds X over V | (n-1,6,7) | (24) |
| f_i | flow of s_i | (n-1,10) | (17), (20) |
| Q_i, R_i | transition and combined observation covariance | (n-1,10,10), (n,3,3) | (30) |
| m, P | prior on s_0: what the frozen part of the trajectory says | (10,), (10,10) | (27) |
| d | correction of the trajectory | (n,10) | |
| lam_i | multiplier of the i-th transition: Q_i^-1 (s_{i+1} - f_i - Phi_i d_i) = -lam_{i+1} | (n,10) | |

**Departure.** (31)-(34) form M = H'R^-1H + Phi'Q^-1Phi + Q^-1 and factor it. Q has a condition number of 1e4 to 1e8
(it goes with tau^5 in position and tau in power), and adapting Q makes that worse: forming Q^-1 loses the
digits that the
covariances need. The same minimum is found here from the equivalent saddle-point system, whose block elimination
is a forward pass of covariances in Joseph form and a backward pass of multipliers: no inverse of Q is formed and every
covariance stays positive definite. `solve_normal_equations` is the block-tridiagonal Cholesky solution of (31) itself;
the two are tested to agree, and it serves as the oracle.
The prior (m, P) is the exact marginal of the frozen states, where (34) takes the last frozen state as known.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from camnet.compiled import cached_njit
from camnet.estimation.kalman.linalg import invert3
from camnet.types import Array, BoolArray

__all__ = ["backward", "forward", "full_phi", "solve_normal_equations"]


@cached_njit(error_model="numpy")
def _observe(
    pred_d: Array, pred_p: Array, y: Array, r: Array, d: Array, p: Array, gain: Array, s_inv: Array
) -> None:
    """Joseph update of (pred_d, pred_p) with the innovation ``y`` (3,) of covariance pred_p[:3,:3] + r."""
    total = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            total[i, j] = pred_p[i, j] + r[i, j]
    invert3(total, s_inv)
    for i in range(10):
        for j in range(3):
            gain[i, j] = pred_p[i, 0] * s_inv[0, j] + pred_p[i, 1] * s_inv[1, j] + pred_p[i, 2] * s_inv[2, j]
        d[i] = pred_d[i] + gain[i, 0] * y[0] + gain[i, 1] * y[1] + gain[i, 2] * y[2]
    ap = np.empty((10, 10))  # (I - K H) P
    for i in range(10):
        for j in range(10):
            ap[i, j] = pred_p[i, j] - (
                gain[i, 0] * pred_p[0, j] + gain[i, 1] * pred_p[1, j] + gain[i, 2] * pred_p[2, j]
            )
    kr = np.empty((10, 3))  # K R - (I - K H) P H', so that P+ = ap + kr K'
    for i in range(10):
        for j in range(3):
            kr[i, j] = gain[i, 0] * r[0, j] + gain[i, 1] * r[1, j] + gain[i, 2] * r[2, j] - ap[i, j]
    for i in range(10):
        for j in range(i + 1):
            p[i, j] = ap[i, j] + kr[i, 0] * gain[j, 0] + kr[i, 1] * gain[j, 1] + kr[i, 2] * gain[j, 2]
            p[j, i] = p[i, j]


@cached_njit(error_model="numpy")
def _predict(d: Array, p: Array, jac: Array, q: Array, offset: Array, pred_d: Array, pred_p: Array) -> None:
    """Phi d + offset and Phi P Phi' + Q with the block form of Phi."""
    t = np.empty((6, 10))
    for i in range(3):
        acc = d[i]
        acc2 = 0.0
        for m in range(7):
            acc += jac[i, m] * d[3 + m]
            acc2 += jac[3 + i, m] * d[3 + m]
        pred_d[i] = acc + offset[i]
        pred_d[3 + i] = acc2 + offset[3 + i]
    for i in range(6, 10):
        pred_d[i] = d[i] + offset[i]
    for i in range(6):
        for j in range(10):
            t[i, j] = p[i, j] if i < 3 else 0.0
        for m in range(7):
            f = jac[i, m]
            for j in range(10):
                t[i, j] += f * p[3 + m, j]
    for i in range(6):
        for j in range(i + 1):
            acc = t[i, j] if j < 3 else 0.0
            for m in range(7):
                acc += t[i, 3 + m] * jac[j, m]
            pred_p[i, j] = acc + q[i, j]
            pred_p[j, i] = pred_p[i, j]
        for j in range(6, 10):
            pred_p[i, j] = t[i, j] + q[i, j]
            pred_p[j, i] = pred_p[i, j]
    for i in range(6, 10):
        for j in range(6, 10):
            pred_p[i, j] = p[i, j] + q[i, j]


@cached_njit(error_model="numpy")
def forward(
    n: int,
    s: Array,
    nxt: Array,
    jac: Array,
    q: Array,
    z: Array,
    r: Array,
    seen: BoolArray,
    mean: Array,
    cov: Array,
    pred_d: Array,
    pred_p: Array,
    filt_d: Array,
    filt_p: Array,
    gain: Array,
    s_inv: Array,
    y: Array,
) -> None:
    """Eliminate the window's states in order of time; see the module's table for the symbols.

    Parameters
    ----------
    n : number of states
    s, nxt, jac, q : trajectory (n,10), flow (n-1,10), derivative (n-1,6,7), transition covariance (n-1,10,10)
    z, r, seen : combined observation (n,3), its covariance (n,3,3), whether there is one (n,)
    mean, cov : prior on the first state (10,), (10,10)
    pred_d, pred_p, filt_d, filt_p, gain, s_inv, y : outputs, one row a state
    """
    offset = np.empty(10)
    for i in range(n):
        if i == 0:
            for m in range(10):
                pred_d[0, m] = mean[m] - s[0, m]
                for j in range(10):
                    pred_p[0, m, j] = cov[m, j]
        else:
            for m in range(10):
                offset[m] = nxt[i - 1, m] - s[i, m]
            _predict(filt_d[i - 1], filt_p[i - 1], jac[i - 1], q[i - 1], offset, pred_d[i], pred_p[i])
        if seen[i]:
            for m in range(3):
                y[i, m] = z[i, m] - s[i, m] - pred_d[i, m]
            _observe(pred_d[i], pred_p[i], y[i], r[i], filt_d[i], filt_p[i], gain[i], s_inv[i])
        else:
            for m in range(10):
                filt_d[i, m] = pred_d[i, m]
                for j in range(10):
                    filt_p[i, m, j] = pred_p[i, m, j]


@cached_njit(error_model="numpy")
def backward(
    n: int,
    jac: Array,
    seen: BoolArray,
    pred_d: Array,
    pred_p: Array,
    gain: Array,
    s_inv: Array,
    y: Array,
    d: Array,
    lam: Array,
) -> None:
    """Back-substitute: corrections ``d`` (n,10) of all states and multipliers ``lam`` (n,10)."""
    hat = np.zeros(10)
    for i in range(n - 1, -1, -1):
        for m in range(10):
            lam[i, m] = hat[m]
        if seen[i]:
            for m in range(3):
                acc = s_inv[i, m, 0] * y[i, 0] + s_inv[i, m, 1] * y[i, 1] + s_inv[i, m, 2] * y[i, 2]
                for j in range(10):
                    acc += gain[i, j, m] * hat[j]
                lam[i, m] -= acc
        for m in range(10):
            acc = pred_d[i, m]
            for j in range(10):
                acc -= pred_p[i, m, j] * lam[i, j]
            d[i, m] = acc
        if i > 0:
            for m in range(3):
                hat[m] = lam[i, m]
            for m in range(7):
                acc = lam[i, 3 + m] if m >= 3 else 0.0
                for j in range(6):
                    acc += jac[i - 1, j, m] * lam[i, j]
                hat[3 + m] = acc


def full_phi(jac: Array) -> Array:
    """Phi (10,10) from its blocks (6,7)."""
    phi = np.eye(10)
    phi[:6, 3:] = jac
    return phi


def solve_normal_equations(
    s: Array, nxt: Array, jac: Array, q: Array, z: Array, r: Array, seen: Array, mean: Array, cov: Array
) -> tuple[Array, Array]:
    """Correction of the trajectory by block-tridiagonal Cholesky of (31)-(33): the readable oracle.

    Returns
    -------
    d (n,10) and the covariance (10,10) of the last state
    """
    n = len(s)
    diag = [np.zeros((10, 10)) for _ in range(n)]
    rhs = [np.zeros(10) for _ in range(n)]
    lower: list[Array] = []
    diag[0] += np.linalg.inv(cov)
    rhs[0] += np.linalg.solve(cov, mean - s[0])
    for i in range(n):
        if seen[i]:
            w = np.linalg.inv(r[i])
            diag[i][:3, :3] += w  # (32)
            rhs[i][:3] += w @ (z[i] - s[i, :3])
        if i + 1 < n:
            phi, w = full_phi(jac[i]), np.linalg.inv(q[i])
            e = nxt[i] - s[i + 1]
            diag[i] += phi.T @ w @ phi
            diag[i + 1] += w
            lower.append(-w @ phi)  # (33) with the sign of the derivative of the objective
            rhs[i] -= phi.T @ w @ e
            rhs[i + 1] += w @ e
    factors: list[tuple[Array, bool]] = []
    for i in range(n):
        if i:
            half = cho_solve(factors[-1], lower[i - 1].T)
            diag[i] = diag[i] - lower[i - 1] @ half
            rhs[i] = rhs[i] - half.T @ rhs[i - 1]
        factors.append(cho_factor(0.5 * (diag[i] + diag[i].T)))
    d = np.zeros((n, 10))
    d[-1] = cho_solve(factors[-1], rhs[-1])
    for i in range(n - 2, -1, -1):
        d[i] = cho_solve(factors[i], rhs[i] - lower[i].T @ d[i + 1])
    return d, cho_solve(factors[-1], np.eye(10))
