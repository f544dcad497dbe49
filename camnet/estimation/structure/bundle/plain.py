"""Residuals of the bundle adjustment in plain NumPy, one after the other as `problem` states them: the oracle."""

from __future__ import annotations

import numpy as np

from camnet.estimation.structure.bundle.problem import BundleProblem, BundleState
from camnet.geometry.rotations import conjugate, exp, log, multiply, to_matrix
from camnet.types import Array

__all__ = ["moved", "residuals"]


def residuals(problem: BundleProblem, state: BundleState) -> Array:
    """All weighted residuals (E,): observations, odometry, priors. Huber's rule is not applied."""
    p, q, points, common = state
    r = to_matrix(q)
    point = np.repeat(np.arange(len(points)), np.diff(problem.start))
    ray = np.column_stack([points[:, :2], np.ones(len(points))])
    a = problem.anchor
    in_world = np.squeeze(r[a] @ ray[..., None], -1)[point]
    lever = points[point, 2, None] * (p[a[point]] - p[problem.pose])
    x = np.squeeze(np.swapaxes(r[problem.pose], 1, 2) @ (in_world + lever)[..., None], -1)
    seen = problem.weight[:, None] * (x[:, :2] / x[:, 2:] - problem.xy)
    scale, bias = common[0], common[1:]
    shifts, turns = [], []
    for i in range(len(p) - 1):
        way = (1.0 + scale) * r[i].T @ (p[i + 1] - p[i]) - problem.shift[i] - problem.shift_by_bias[i] @ bias
        shifts.append(problem.shift_root[i] @ way)
        measured = multiply(problem.turn[i], exp(problem.turn_by_bias[i] @ bias))
        turned = multiply(conjugate(measured), multiply(conjugate(q[i]), q[i + 1]))
        turns.append(problem.turn_weight[i] * log(turned))
    prior = problem.inverse_prior[:, 1] * (points[:, 2] - problem.inverse_prior[:, 0])
    return np.concatenate([seen.ravel(), *shifts, *turns, problem.common_prior * common, prior])


def moved(state: BundleState, step: Array) -> BundleState:
    """State after a step (6 (P - 1) + 4 + 3 M,): translation and turn of each pose but the first, common, points."""
    poses = len(state.p) - 1
    of_poses = step[: 6 * poses].reshape(poses, 6)
    p, q = state.p.copy(), state.q.copy()
    p[1:] += of_poses[:, :3]
    q[1:] = multiply(q[1:], exp(of_poses[:, 3:]))
    rest = step[6 * poses :]
    return BundleState(p, q, state.points + rest[4:].reshape(-1, 3), state.common + rest[:4])
