"""Levenberg-Marquardt on the normal equations of `equations`, with the points eliminated (Schur complement).

| symbol | name | shape | equation |
| --- | --- | --- | --- |
| ``mu`` | damping | | times the diagonal of H; falls by 10 after a step taken, else rises by 4 |
| ``S`` | | (C, C) | ``H_cc - sum_j H_yc,j^T H_yy,j^-1 H_yc,j`` |
| ``dc`` | | (C,) | ``S dc = -(g_c - sum_j H_yc,j^T H_yy,j^-1 g_y,j)`` |
| ``dy_j`` | | (3,) | ``-H_yy,j^-1 (g_y,j + H_yc,j dc)`` |

It ends when a step that is taken lowers the cost by less than ``tolerance`` of it, or none does at any damping.
"""

from __future__ import annotations

import math

import numpy as np

from camnet.compiled import cached_njit
from camnet.estimation.structure.bundle.equations import cost_of, linearise
from camnet.estimation.structure.bundle.problem import BundleProblem, BundleState
from camnet.geometry.rotations_compiled import exp, multiply, normalise
from camnet.types import Array, IntArray

__all__ = ["adjust"]

_START, _DOWN, _UP, _LARGEST = 1e-4, 0.1, 4.0, 1e10


def adjust(
    problem: BundleProblem, state: BundleState, iterations: int = 50, tolerance: float = 1e-7
) -> tuple[BundleState, float, int]:
    """Minimise the cost from a start.

    Parameters
    ----------
    problem, state : see `problem`; the state is not changed
    iterations : steps at most, those that are not taken included
    tolerance : relative decrease of the cost at which to stop

    Returns
    -------
    tuple
        The state, the cost (half the weighted sum of squares), the number of steps tried. The cost is infinite where
        the start has a point behind a camera that saw it; the state is then the start.
    """
    after = BundleState(*(np.array(x, dtype=np.float64) for x in state))
    cost, count = _adjust(problem, after.p, after.q, after.points, after.common, iterations, tolerance)
    return after, float(cost), int(count)


@cached_njit
def _adjust(
    problem: BundleProblem,
    p: Array,
    q: Array,
    points: Array,
    common: Array,
    iterations: int,
    tolerance: float,
) -> tuple[float, int]:
    size, count = 6 * (len(p) - 1) + 4, len(points)
    h_cc, g_c = np.empty((size, size)), np.empty(size)
    h_yc, h_yy, g_y = np.empty((count, 3, size)), np.empty((count, 3, 3)), np.empty((count, 3))
    d_c, d_y = np.empty(size), np.empty((count, 3))
    new_p, new_q, new_points, new_common = p.copy(), q.copy(), points.copy(), common.copy()
    cost = linearise(problem, p, q, points, common, h_cc, g_c, h_yc, h_yy, g_y)
    if not math.isfinite(cost):
        return cost, 0
    mu = _START
    for tried in range(iterations):
        _solve(problem, h_cc, g_c, h_yc, h_yy, g_y, mu, d_c, d_y)
        for i in range(1, len(p)):
            at = 6 * (i - 1)
            new_p[i] = p[i] + d_c[at : at + 3]
            new_q[i] = normalise(multiply(q[i], exp(d_c[at + 3 : at + 6])))
        new_common[:] = common + d_c[size - 4 :]
        new_points[:] = points + d_y
        new_cost = cost_of(problem, new_p, new_q, new_points, new_common)
        if new_cost <= cost:
            gain = cost - new_cost
            p[:], q[:], points[:], common[:] = new_p, new_q, new_points, new_common
            if gain <= tolerance * max(cost, 1e-12):
                return new_cost, tried + 1
            mu *= _DOWN
            cost = linearise(problem, p, q, points, common, h_cc, g_c, h_yc, h_yy, g_y)
        else:
            mu *= _UP
            if mu > _LARGEST:
                return cost, tried + 1
    return cost, iterations


@cached_njit
def _inverse3(m: Array, out: Array) -> None:
    """Inverse of a symmetric 3 x 3 matrix by its adjugate."""
    a, b, c, d, e, f = m[0, 0], m[0, 1], m[0, 2], m[1, 1], m[1, 2], m[2, 2]
    x, y, z = d * f - e * e, c * e - b * f, b * e - c * d
    k = 1.0 / (a * x + b * y + c * z)
    out[0, 0], out[0, 1], out[0, 2] = k * x, k * y, k * z
    out[1, 0], out[1, 1], out[1, 2] = k * y, k * (a * f - c * c), k * (b * c - a * e)
    out[2, 0], out[2, 1], out[2, 2] = k * z, k * (b * c - a * e), k * (a * d - b * b)


@cached_njit
def _touched(problem: BundleProblem, j: int, columns: IntArray) -> int:
    """Write the columns of the poses that see point j, anchor included, in order; return how many."""
    count, last = 0, -1
    a = problem.anchor[j]
    used = np.zeros(len(problem.shift) + 1, dtype=np.bool_)
    for k in range(problem.start[j], problem.start[j + 1]):
        if problem.pose[k] != a:
            used[problem.pose[k]] = used[a] = True
    for i in range(1, len(used)):
        if used[i]:
            for m in range(6):
                last = 6 * (i - 1) + m
                columns[count] = last
                count += 1
    return count


@cached_njit
def _solve(
    problem: BundleProblem, h_cc: Array, g_c: Array, h_yc: Array, h_yy: Array, g_y: Array, mu: float,
    d_c: Array, d_y: Array,
) -> None:  # fmt: skip
    """One damped step (C,), (M, 3)."""
    size, count = len(g_c), len(g_y)
    s, right = h_cc.copy(), -g_c
    for m in range(size):
        s[m, m] += mu * h_cc[m, m] + 1e-12
    inverse, damped = np.empty((count, 3, 3)), np.empty((3, 3))
    columns, half = np.empty(size, dtype=np.int64), np.empty((3, size))
    for j in range(count):
        damped[:] = h_yy[j]
        for m in range(3):
            damped[m, m] += mu * h_yy[j, m, m] + 1e-9
        _inverse3(damped, inverse[j])
        n = _touched(problem, j, columns)
        for k in range(n):
            c = columns[k]
            for m in range(3):
                half[m, k] = (
                    inverse[j, m, 0] * h_yc[j, 0, c]
                    + inverse[j, m, 1] * h_yc[j, 1, c]
                    + inverse[j, m, 2] * h_yc[j, 2, c]
                )
            right[c] += half[0, k] * g_y[j, 0] + half[1, k] * g_y[j, 1] + half[2, k] * g_y[j, 2]
        for k in range(n):
            c = columns[k]
            w0, w1, w2 = h_yc[j, 0, c], h_yc[j, 1, c], h_yc[j, 2, c]
            for o in range(k + 1):
                s[c, columns[o]] -= w0 * half[0, o] + w1 * half[1, o] + w2 * half[2, o]
    for m in range(size):  # the elimination wrote the lower half alone
        for n in range(m):
            s[n, m] = s[m, n]
    d_c[:] = np.linalg.solve(s, right)
    for j in range(count):
        back = -(g_y[j] + h_yc[j] @ d_c)
        d_y[j] = inverse[j] @ back
