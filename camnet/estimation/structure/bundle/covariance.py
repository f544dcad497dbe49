"""Covariance of the estimates, and the least error that any unbiased estimator can reach (Cramer-Rao).

| symbol | name | shape | unit | equation |
| --- | --- | --- | --- | --- |
| ``H`` | | (C + 3 M, C + 3 M) | | normal equations at a state: the information of data and priors |
| ``H^-1`` | ``covariance`` | (C + 3 M, C + 3 M) | | order: poses 1 .. P - 1 (6 each), s, b (4), points (3 each) |
| ``z_j`` | | (M,) | m | ``e_3^T R_c^T (R_a m / rho + p_a - p_c)``, depth in the last pose |
| ``sigma_z`` | ``depth_sd`` | (M,) | m | ``sqrt(J H^-1 J^T)``, J the derivative of z_j |

At the true state H^-1 is the (Bayesian) Cramer-Rao bound of the linearised problem; at an estimate it is what the
estimate's errors are believed to be.
"""

from __future__ import annotations

import numpy as np

from camnet.estimation.structure.bundle.equations import linearise
from camnet.estimation.structure.bundle.problem import BundleProblem, BundleState
from camnet.geometry.rotations import to_matrix
from camnet.types import Array

__all__ = ["covariance", "depth_sd"]


def covariance(problem: BundleProblem, state: BundleState) -> Array:
    """``H^-1`` in the order of the module's table."""
    size, count = 6 * (len(state.p) - 1) + 4, len(state.points)
    h_cc, g_c = np.empty((size, size)), np.empty(size)
    h_yc, h_yy, g_y = np.empty((count, 3, size)), np.empty((count, 3, 3)), np.empty((count, 3))
    linearise(problem, *state, h_cc, g_c, h_yc, h_yy, g_y)
    h = np.zeros((size + 3 * count, size + 3 * count))
    h[:size, :size] = h_cc
    h[size:, :size] = h_yc.reshape(-1, size)
    h[:size, size:] = h[size:, :size].T
    for j in range(count):
        at = size + 3 * j
        h[at : at + 3, at : at + 3] = h_yy[j]
    # scaled to a unit diagonal before it is inverted: the units differ by many orders of magnitude
    scale = 1.0 / np.sqrt(np.diag(h))
    return np.asarray(scale[:, None] * np.linalg.inv(h * scale[:, None] * scale) * scale)


def depth_sd(problem: BundleProblem, state: BundleState) -> Array:
    """``sigma_z`` (M,) in m of the points' depths in the last pose; all points held in pose 0."""
    size, count = 6 * (len(state.p) - 1) + 4, len(state.points)
    r = to_matrix(state.q[-1])
    ray, rho = np.column_stack([state.points[:, :2], np.ones(count)]), state.points[:, 2]
    x = (ray / rho[:, None] - state.p[-1]) @ r
    at = size - 10
    jacobian = np.zeros((count, 9))
    jacobian[:, 0:3] = -r[:, 2]
    jacobian[:, 3], jacobian[:, 4] = -x[:, 1], x[:, 0]
    jacobian[:, 6:8] = r[:2, 2] / rho[:, None]
    jacobian[:, 8] = -(ray @ r[:, 2]) / rho**2
    full = covariance(problem, state)
    out = np.empty(count)
    for j in range(count):
        columns = [*range(at, at + 6), *range(size + 3 * j, size + 3 * j + 3)]
        out[j] = jacobian[j] @ full[np.ix_(columns, columns)] @ jacobian[j]
    return np.sqrt(out)
