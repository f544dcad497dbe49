"""One estimator step with the target in view, in few compiled calls (world frame, f = 0).

parikh2018 (7); harris2020 (3-8), (4-16): the model's twist at the measured pose, the pose's feedback, and the output
error for the weights. ``measured_step`` is ``basis.evaluate``, ``propagate.model_twist`` and ``world_feedback``
one after the other, which stay as the readable form and its oracle; in one call the way into compiled code is paid
once.
"""

from __future__ import annotations

import math

import numpy as np

from camnet.compiled import cached_njit
from camnet.estimation.basis import evaluate
from camnet.estimation.concurrent_learning import correct_pose, output_error
from camnet.estimation.propagate import model_twist
from camnet.geometry.rotations_compiled import align_sign, multiply, normalise
from camnet.types import Array

__all__ = ["measured_step"]


@cached_njit
def measured_step(
    p: Array,
    q: Array,
    twist: Array,
    sigma: Array,
    error: Array,
    p_measured: Array,
    q_measured: Array,
    dt: float,
    prior: Array,
    use_prior: bool,
    stacked: bool,
    weights: Array,
    centres: Array,
    precision: Array,
    heading_scale: float,
    k1: float,
    k2: float,
    code: int,
    layer: float,
) -> float:
    """Advance pose p (3,), q (4,) by ``dt`` in place; return the residual of the position before the feedback, m.

    Written as well: ``twist`` (6,), ``sigma`` (p,) at the measured pose and ``error`` (8,), G^T eta_til.
    """
    evaluate(p_measured, q_measured, centres, precision, heading_scale, sigma)
    model_twist(
        p_measured, q_measured, prior, use_prior, stacked, weights, centres, precision, heading_scale, twist
    )
    turn = multiply(q, np.array([0.0, twist[3], twist[4], twist[5]]))
    for i in range(3):
        p[i] += dt * twist[i]
    for i in range(4):
        q[i] += 0.5 * dt * turn[i]
    moved = normalise(q)
    p_next, q_next, pose_error = correct_pose(p, moved, p_measured, q_measured, k1, k2, code, layer, dt)
    outputs = output_error(pose_error, align_sign(q_measured, moved), stacked)
    for i in range(3):
        p[i] = p_next[i]
    for i in range(4):
        q[i] = q_next[i]
    for o in range(len(outputs)):
        error[o] = outputs[o]
    return math.sqrt(pose_error[0] ** 2 + pose_error[1] ** 2 + pose_error[2] ** 2)
