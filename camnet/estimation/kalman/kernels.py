r"""Compiled steps of the Kalman family: prediction (linearised or by sigma points), Joseph update, fixed-lag smoothing.

| symbol | name | shape |
| --- | --- | --- |
| x, P | state and covariance | (n,), (n,n) |
| xp, Pp | their prediction | |
| C | cov(x_k, x_{k+1}) given the data to k | (n,n) |
| G = C Pp^-1 | smoother gain (Rauch, Tung and Striebel 1965) | (n,n) |

The observation is a position, z = x[0:3] + noise: linear, so the unscented update equals the Kalman update and only the
prediction differs between the filters. Several observations of one step are independent and taken one after the other.
Updates are in Joseph form, P = (I - K H) P (I - K H)' + K R K', sigma points have weights that are never
negative: covariances
stay positive definite.
"""

from __future__ import annotations

import math

import numpy as np

from camnet.compiled import cached_njit
from camnet.estimation.kalman.linalg import cholesky, invert3
from camnet.estimation.pls.noise import process_covariance, transition
from camnet.types import Array

__all__ = ["observe", "predict_linearised", "predict_unscented", "smooth_lag", "smoother_gain"]


@cached_njit(error_model="numpy")
def predict_linearised(
    kind: int,
    par: Array,
    f: Array,
    q: Array,
    tau: float,
    rest: bool,
    x: Array,
    p: Array,
    xp: Array,
    pp: Array,
    c: Array,
) -> None:
    """Prediction through the derivative of the motion; fills xp, pp and c = P F'.

    Parameters
    ----------
    kind, par, f, q : see `camnet.estimation.kalman.models.kernel_model`
    tau, rest : step in s and constant-velocity limit, for the steering models
    x, p : state (n,) and covariance (n,n)
    """
    n = x.shape[0]
    if kind == 0:
        for i in range(n):
            acc = 0.0
            for j in range(n):
                acc += f[i, j] * x[j]
            xp[i] = acc
    else:
        jac = np.empty((6, 7))
        resting = transition(par, x, tau, rest, xp, jac)
        process_covariance(par, x, xp, tau, resting, jac, q)
        for i in range(6):
            for j in range(7):
                f[i, 3 + j] = jac[i, j]
    for i in range(n):  # c' = F P, row by row, skipping the zeros of F
        for j in range(n):
            c[j, i] = 0.0
    t = np.zeros((n, n))
    for i in range(n):
        for m in range(n):
            w = f[i, m]
            if w != 0.0:
                for j in range(n):
                    t[i, j] += w * p[m, j]
    for i in range(n):
        for j in range(n):
            pp[i, j] = q[i, j]
            c[j, i] = t[i, j]
    for j in range(n):
        for m in range(n):
            w = f[j, m]
            if w != 0.0:
                for i in range(n):
                    pp[j, i] += w * c[m, i]
    for i in range(n):
        for j in range(i):
            pp[i, j] = 0.5 * (pp[i, j] + pp[j, i])
            pp[j, i] = pp[i, j]


@cached_njit(error_model="numpy")
def predict_unscented(
    kind: int,
    par: Array,
    f: Array,
    q: Array,
    tau: float,
    rest: bool,
    scaling: Array,
    x: Array,
    p: Array,
    xp: Array,
    pp: Array,
    c: Array,
) -> None:
    """Prediction by 2n + 1 scaled sigma points (Wan and van der Merwe 2000); fills xp, pp and c.

    ``scaling`` (3,): alpha, beta, kappa. Other parameters as in `predict_linearised`.
    """
    n = x.shape[0]
    lam = scaling[0] ** 2 * (n + scaling[2]) - n
    side = 0.5 / (n + lam)
    w_mean = lam / (n + lam)
    w_cov = w_mean + 1.0 - scaling[0] ** 2 + scaling[1]
    root = math.sqrt(n + lam)
    low = np.empty((n, n))
    cholesky(p, low)
    pts = np.empty((2 * n + 1, n))
    jac = np.empty((6, 7))
    s = x.copy()
    if kind == 1:
        resting = transition(par, x, tau, rest, pts[0], jac)
        process_covariance(par, x, pts[0], tau, resting, jac, q)
    for k in range(2 * n + 1):
        if k > 0:
            j = (k - 1) // 2
            sign = root if k % 2 else -root
            for m in range(n):
                s[m] = x[m] + sign * low[m, j]
        if kind == 0:
            for i in range(n):
                acc = 0.0
                for j in range(n):
                    acc += f[i, j] * s[j]
                pts[k, i] = acc
        elif k > 0:
            transition(par, s, tau, rest, pts[k], jac)
    for i in range(n):
        acc = 0.0
        for k in range(1, 2 * n + 1):
            acc += pts[k, i]
        xp[i] = w_mean * pts[0, i] + side * acc
    for k in range(2 * n + 1):
        for i in range(n):
            pts[k, i] -= xp[i]
    for i in range(n):
        for j in range(n):
            pp[i, j] = q[i, j]
            c[i, j] = 0.0
    for k in range(2 * n + 1):
        w = w_cov if k == 0 else side
        for i in range(n):
            a = w * pts[k, i]
            for j in range(n):
                pp[i, j] += a * pts[k, j]
    for col in range(n):  # the two points of a column differ by 2 root L_col
        for i in range(col, n):
            a = side * root * low[i, col]
            for j in range(n):
                c[i, j] += a * (pts[2 * col + 1, j] - pts[2 * col + 2, j])


@cached_njit(error_model="numpy")
def observe(x: Array, p: Array, obs: Array, cov: Array) -> None:
    """Take the positions ``obs`` (m,3) with covariances ``cov`` (m,3,3) into (x, p) in place, in Joseph form."""
    n = x.shape[0]
    total = np.empty((3, 3))
    inv = np.empty((3, 3))
    gain = np.empty((n, 3))
    ap = np.empty((n, n))
    kr = np.empty((n, 3))
    for k in range(obs.shape[0]):
        for i in range(3):
            for j in range(3):
                total[i, j] = p[i, j] + cov[k, i, j]
        invert3(total, inv)
        e0, e1, e2 = obs[k, 0] - x[0], obs[k, 1] - x[1], obs[k, 2] - x[2]
        for i in range(n):
            for j in range(3):
                gain[i, j] = p[i, 0] * inv[0, j] + p[i, 1] * inv[1, j] + p[i, 2] * inv[2, j]
        for i in range(n):
            x[i] += gain[i, 0] * e0 + gain[i, 1] * e1 + gain[i, 2] * e2
            for j in range(n):
                ap[i, j] = p[i, j] - (gain[i, 0] * p[0, j] + gain[i, 1] * p[1, j] + gain[i, 2] * p[2, j])
            for j in range(3):
                acc = -ap[i, j]
                for m in range(3):
                    acc += gain[i, m] * cov[k, m, j]
                kr[i, j] = acc
        for i in range(n):
            for j in range(i + 1):
                p[i, j] = ap[i, j] + kr[i, 0] * gain[j, 0] + kr[i, 1] * gain[j, 1] + kr[i, 2] * gain[j, 2]
                p[j, i] = p[i, j]


@cached_njit(error_model="numpy")
def smoother_gain(pp: Array, c: Array, g: Array) -> None:
    """Smoother gain G = C Pp^-1 by Cholesky."""
    n = pp.shape[0]
    low = np.empty((n, n))
    cholesky(pp, low)
    for r in range(n):  # solve Pp g_r = c_r for each row of C
        for i in range(n):
            acc = c[r, i]
            for m in range(i):
                acc -= low[i, m] * g[r, m]
            g[r, i] = acc / low[i, i]
        for i in range(n - 1, -1, -1):
            acc = g[r, i]
            for m in range(i + 1, n):
                acc -= low[m, i] * g[r, m]
            g[r, i] = acc / low[i, i]


@cached_njit(error_model="numpy")
def smooth_lag(last: int, lag: int, filtered: Array, predicted: Array, gains: Array, out: Array) -> None:
    """Rauch-Tung-Striebel means of the steps ``last - lag`` to ``last``, written to ``out`` (k,n).

    ``gains[i]`` belongs to the step from i to i + 1, ``predicted[i]`` to step i.
    """
    n = filtered.shape[1]
    for m in range(n):
        out[last, m] = filtered[last, m]
    for i in range(last - 1, max(-1, last - lag - 1), -1):
        for m in range(n):
            acc = filtered[i, m]
            for j in range(n):
                acc += gains[i, m, j] * (out[i + 1, j] - predicted[i + 1, j])
            out[i, m] = acc
