"""Normal equations of the bundle adjustment, compiled; `problem` has the symbols, `plain` the same residuals in NumPy.

With the unknowns ``c`` (6 (P - 1) + 4: translation and turn of each pose but the first, then s and b) and ``y`` (3 M)::

    [H_cc   H_yc^T] [dc]   [-g_c]
    [H_yc   H_yy  ] [dy] = [-g_y]        H_yy is block-diagonal, 3 x 3

Poses move as ``p + dp``, ``R Exp(dr)``. The derivative of Log is taken as the identity: the residuals of turns are
milliradians.
"""

from __future__ import annotations

import math

import numpy as np

from camnet.compiled import cached_njit
from camnet.estimation.structure.bundle.problem import BundleProblem
from camnet.geometry.rotations_compiled import conjugate, exp, log, multiply, to_matrix
from camnet.types import Array

__all__ = ["cost_of", "linearise"]

#: points nearer the camera's plane than this (times rho) count as behind it
_IN_FRONT = 1e-3


@cached_njit
def _huber(square: float, limit: float) -> tuple[float, float]:
    """Cost and weight of a residual whose squared norm is ``square``."""
    if square <= limit * limit:
        return 0.5 * square, 1.0
    norm = math.sqrt(square)
    return limit * (norm - 0.5 * limit), limit / norm


@cached_njit
def _rotations(q: Array) -> Array:
    r = np.empty((len(q), 3, 3))
    for i in range(len(q)):
        r[i] = to_matrix(q[i])
    return r


@cached_njit
def _into_camera(r_i: Array, r_a: Array, p_i: Array, p_a: Array, y: Array, f: Array, x: Array) -> None:
    """``f = R_a m + rho (p_a - p_i)`` and ``x = R_i^T f``."""
    for k in range(3):
        f[k] = r_a[k, 0] * y[0] + r_a[k, 1] * y[1] + r_a[k, 2] + y[2] * (p_a[k] - p_i[k])
    for k in range(3):
        x[k] = r_i[0, k] * f[0] + r_i[1, k] * f[1] + r_i[2, k] * f[2]


@cached_njit
def _step_residual(
    problem: BundleProblem, i: int, p: Array, q: Array, r: Array, common: Array
) -> tuple[Array, Array, Array, Array]:
    """Residuals e_p, e_R (weighted) of odometry step i, the way in frame i, and the turn left over."""
    bias = common[1:]
    way = r[i].T @ (p[i + 1] - p[i])
    e_p = problem.shift_root[i] @ (
        (1.0 + common[0]) * way - problem.shift[i] - problem.shift_by_bias[i] @ bias
    )
    measured = multiply(problem.turn[i], exp(problem.turn_by_bias[i] @ bias))
    left = multiply(conjugate(measured), multiply(conjugate(q[i]), q[i + 1]))
    return e_p, problem.turn_weight[i] * log(left), way, left


@cached_njit
def cost_of(problem: BundleProblem, p: Array, q: Array, points: Array, common: Array) -> float:
    """Half the weighted sum of squares; infinite where a point would lie behind a camera that saw it."""
    r = _rotations(q)
    total = 0.0
    f, x = np.empty(3), np.empty(3)
    for j in range(len(points)):
        a = problem.anchor[j]
        for k in range(problem.start[j], problem.start[j + 1]):
            i = problem.pose[k]
            _into_camera(r[i], r[a], p[i], p[a], points[j], f, x)
            if x[2] < _IN_FRONT:
                return math.inf
            e0, e1 = x[0] / x[2] - problem.xy[k, 0], x[1] / x[2] - problem.xy[k, 1]
            total += _huber(problem.weight[k] ** 2 * (e0 * e0 + e1 * e1), problem.huber)[0]
        e0 = problem.inverse_prior[j, 1] * (points[j, 2] - problem.inverse_prior[j, 0])
        total += 0.5 * e0 * e0
    for i in range(len(p) - 1):
        e_p, e_r, _, _ = _step_residual(problem, i, p, q, r, common)
        total += 0.5 * float(e_p @ e_p + e_r @ e_r)
    for k in range(4):
        total += 0.5 * (problem.common_prior[k] * common[k]) ** 2
    return total


@cached_njit
def linearise(
    problem: BundleProblem, p: Array, q: Array, points: Array, common: Array,
    h_cc: Array, g_c: Array, h_yc: Array, h_yy: Array, g_y: Array,
) -> float:  # fmt: skip
    """Fill the normal equations and return the cost.

    Parameters
    ----------
    h_cc, g_c : (C, C), (C,) with C = 6 (P - 1) + 4
    h_yc, h_yy, g_y : (M, 3, C), (M, 3, 3), (M, 3)
    """
    h_cc[:], g_c[:], h_yc[:], h_yy[:], g_y[:] = 0.0, 0.0, 0.0, 0.0, 0.0
    r = _rotations(q)
    total = 0.0
    f, x, jac, e = np.empty(3), np.empty(3), np.empty((2, 15)), np.empty(2)
    for j in range(len(points)):
        a = problem.anchor[j]
        for k in range(problem.start[j], problem.start[j + 1]):
            i = problem.pose[k]
            _into_camera(r[i], r[a], p[i], p[a], points[j], f, x)
            if x[2] < _IN_FRONT:
                return math.inf
            w = problem.weight[k]
            e[0], e[1] = w * (x[0] / x[2] - problem.xy[k, 0]), w * (x[1] / x[2] - problem.xy[k, 1])
            cost, share = _huber(e[0] * e[0] + e[1] * e[1], problem.huber)
            total += cost
            _observation_jacobian(r[i], r[a], p[i], p[a], points[j], x, w, i == a, jac)
            _add_observation(jac, e, share, j, 6 * (i - 1), 6 * (a - 1), i == a, h_cc, g_c, h_yc, h_yy, g_y)
        weight = problem.inverse_prior[j, 1]
        away = weight * (points[j, 2] - problem.inverse_prior[j, 0])
        h_yy[j, 2, 2] += weight * weight
        g_y[j, 2] += weight * away
        total += 0.5 * away * away
    total += _add_odometry(problem, p, q, r, common, h_cc, g_c)
    return total


@cached_njit
def _observation_jacobian(
    r_i: Array, r_a: Array, p_i: Array, p_a: Array, y: Array, x: Array, w: float, own: bool, jac: Array
) -> None:
    """Weighted derivatives (2, 15): pose i (6), anchor pose (6), point (3)."""
    inv = 1.0 / x[2]
    jac[:] = 0.0
    d = np.empty((2, 3))  # of the normalised coordinates by x
    d[0, 0], d[0, 1], d[0, 2] = w * inv, 0.0, -w * x[0] * inv * inv
    d[1, 0], d[1, 1], d[1, 2] = 0.0, w * inv, -w * x[1] * inv * inv
    for row in range(2):
        if own:  # seen from its own anchor: x = m
            jac[row, 12], jac[row, 13] = d[row, 0], d[row, 1]
            continue
        # g = d R_i^T: derivative by f
        g0 = d[row, 0] * r_i[0, 0] + d[row, 1] * r_i[0, 1] + d[row, 2] * r_i[0, 2]
        g1 = d[row, 0] * r_i[1, 0] + d[row, 1] * r_i[1, 1] + d[row, 2] * r_i[1, 2]
        g2 = d[row, 0] * r_i[2, 0] + d[row, 1] * r_i[2, 1] + d[row, 2] * r_i[2, 2]
        # h = g R_a: derivative by m
        h0 = g0 * r_a[0, 0] + g1 * r_a[1, 0] + g2 * r_a[2, 0]
        h1 = g0 * r_a[0, 1] + g1 * r_a[1, 1] + g2 * r_a[2, 1]
        h2 = g0 * r_a[0, 2] + g1 * r_a[1, 2] + g2 * r_a[2, 2]
        jac[row, 0], jac[row, 1], jac[row, 2] = -y[2] * g0, -y[2] * g1, -y[2] * g2
        # x turns by x^x dr, m by -R_a m^x dr
        jac[row, 3] = d[row, 1] * x[2] - d[row, 2] * x[1]
        jac[row, 4] = d[row, 2] * x[0] - d[row, 0] * x[2]
        jac[row, 5] = d[row, 0] * x[1] - d[row, 1] * x[0]
        jac[row, 6], jac[row, 7], jac[row, 8] = y[2] * g0, y[2] * g1, y[2] * g2
        jac[row, 9] = -(h1 - h2 * y[1])
        jac[row, 10] = -(h2 * y[0] - h0)
        jac[row, 11] = -(h0 * y[1] - h1 * y[0])
        jac[row, 12], jac[row, 13] = h0, h1
        jac[row, 14] = g0 * (p_a[0] - p_i[0]) + g1 * (p_a[1] - p_i[1]) + g2 * (p_a[2] - p_i[2])


@cached_njit
def _add_observation(
    jac: Array, e: Array, share: float, j: int, at_i: int, at_a: int, own: bool,
    h_cc: Array, g_c: Array, h_yc: Array, h_yy: Array, g_y: Array,
) -> None:  # fmt: skip
    """Add one observation; a pose that is held has a negative place."""
    for row in range(2):
        for m in range(3):
            t = share * jac[row, 12 + m]
            g_y[j, m] += t * e[row]
            for n in range(3):
                h_yy[j, m, n] += t * jac[row, 12 + n]
        if own:
            continue
        for block in range(2):
            at, first = (at_i, 0) if block == 0 else (at_a, 6)
            if at < 0:
                continue
            for m in range(6):
                t = share * jac[row, first + m]
                g_c[at + m] += t * e[row]
                for n in range(3):
                    h_yc[j, n, at + m] += t * jac[row, 12 + n]
                for other in range(2):
                    at_o, first_o = (at_i, 0) if other == 0 else (at_a, 6)
                    if at_o >= 0:
                        for n in range(6):
                            h_cc[at + m, at_o + n] += t * jac[row, first_o + n]


@cached_njit
def _add_odometry(
    problem: BundleProblem, p: Array, q: Array, r: Array, common: Array, h_cc: Array, g_c: Array
) -> float:
    """Add odometry steps and the priors of s and b; return their cost."""
    total, poses = 0.0, len(p) - 1
    at_common = 6 * poses
    jac, e = np.empty((6, 16)), np.empty(6)
    where = np.empty(16, dtype=np.int64)
    for i in range(poses):
        e_p, e_r, way, left = _step_residual(problem, i, p, q, r, common)
        e[:3], e[3:] = e_p, e_r
        total += 0.5 * float(e_p @ e_p + e_r @ e_r)
        root, w, scale = problem.shift_root[i], problem.turn_weight[i], 1.0 + common[0]
        cross = np.array([[0.0, -way[2], way[1]], [way[2], 0.0, -way[0]], [-way[1], way[0], 0.0]])
        jac[:] = 0.0
        jac[:3, 0:3] = -scale * (root @ r[i].T)
        jac[:3, 3:6] = scale * (root @ cross)
        jac[:3, 6:9] = scale * (root @ r[i].T)
        jac[:3, 12] = root @ way
        jac[:3, 13:16] = -root @ problem.shift_by_bias[i]
        jac[3:, 3:6] = -w * (r[i + 1].T @ r[i])
        jac[3:, 9:12] = w * np.eye(3)
        jac[3:, 13:16] = -w * (to_matrix(left).T @ problem.turn_by_bias[i])
        for m in range(6):
            where[m], where[6 + m] = 6 * (i - 1) + m if i > 0 else -1, 6 * i + m
        for m in range(4):
            where[12 + m] = at_common + m
        for m in range(16):
            if where[m] < 0:
                continue
            for row in range(6):
                g_c[where[m]] += jac[row, m] * e[row]
            for n in range(16):
                if where[n] >= 0:
                    for row in range(6):
                        h_cc[where[m], where[n]] += jac[row, m] * jac[row, n]
    for m in range(4):
        weight = problem.common_prior[m]
        h_cc[at_common + m, at_common + m] += weight * weight
        g_c[at_common + m] += weight * weight * common[m]
        total += 0.5 * (weight * common[m]) ** 2
    return total
