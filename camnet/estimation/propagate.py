"""The predictor as one compiled step: pose rates from weights and prior mean, and their integration.

parikh2018 Algorithm 1 (not in view), harris2020 (3-15), (4-16), with the remedies of the gap problem added:

    eta_hat' = proj( G(q) [ W^T sigma(eta_hat) + (1 - u(eta_hat)) m ] )                     G = blockdiag(I3, 1/2 B(q))

| symbol | name | shape | unit |
| --- | --- | --- | --- |
| W | ``weights`` | (p, 8) | see below |
| sigma | ``sigma`` | (p,) | - |
| m | ``prior``: velocity in the world frame, angular velocity in the body frame | (6,) | m/s, rad/s |
| u | ``support``: share of the motion that the learned model answers for, in [0, 1] | - | - |

Columns of the weights: the n model outputs (6 in twist form: v in the world frame and w in the body frame; 7 in stacked
form: dp/dt and dq/dt), unused columns, and in column 7 or 8 the *unit output*: what the same data and the same law
learn of the constant 1. Its value u = w_1^T sigma is how far W^T sigma has faded (or has not converged yet), so
``W^T sigma + (1 - u) m`` reproduces a constant velocity exactly everywhere, whereas a variance-based support leaves a
gap in which the learned part has faded and the prior is not yet let in. Without a prior (``prior none``) the law is the
printed one.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from camnet.estimation.basis import CUTOFF, map_inputs
from camnet.estimation.projection import axis_factor
from camnet.estimation.road_prior import RoadMap, steer
from camnet.geometry.rotations_compiled import exp, multiply, normalise, rotate, rotate_inverse
from camnet.types import Array

__all__ = ["COLUMNS", "POSE_LAYER_M", "PRIORS", "TWIST_OUTPUTS", "UNIT", "advance", "model_twist", "roll_out"]

#: number of columns of every weight matrix; a fixed, even number lets the compiled products use vector registers
COLUMNS = 8
#: column of the unit output
UNIT = 7
TWIST_OUTPUTS = 6
#: how far beyond the tracking bounds a predicted position can go, m
POSE_LAYER_M = 0.5
#: codes of the priors, chosen once at construction; along roads it is a constant turn whose turn the roads set
PRIORS = {"none": 0, "constant_velocity": 1, "constant_turn": 2, "road": 2}


@njit(cache=True)
def model_twist(
    p: Array,
    q: Array,
    prior: Array,
    use_prior: bool,
    stacked: bool,
    weights: Array,
    centres: Array,
    precision: Array,
    heading_scale: float,
    twist: Array,
) -> float:
    """Write velocity (world) and angular velocity (body) to ``twist`` (6,); return the support u in [0, 1]."""
    n, d = centres.shape
    out = np.zeros(COLUMNS)
    x = map_inputs(p, q, d, heading_scale)
    for k in range(n):
        quad = 0.0
        if d == 2:
            e0 = x[0] - centres[k, 0]
            e1 = x[1] - centres[k, 1]
            quad = (
                e0 * e0 * precision[k, 0, 0]
                + e1 * e1 * precision[k, 1, 1]
                + e0 * e1 * (precision[k, 0, 1] + precision[k, 1, 0])
            )
        else:
            for i in range(d):
                for j in range(d):
                    quad += (x[i] - centres[k, i]) * precision[k, i, j] * (x[j] - centres[k, j])
        if quad < CUTOFF:
            sigma = math.exp(-0.5 * quad)
            for o in range(COLUMNS):
                out[o] += sigma * weights[k, o]
    support: float = min(1.0, max(0.0, out[UNIT]))
    rest = 1.0 - support if use_prior else 0.0
    for i in range(3):
        twist[i] = out[i] + rest * prior[i]
    if stacked:
        # w = 2 B(q)^T dq/dt
        a, b, c, d2 = 2.0 * out[3], 2.0 * out[4], 2.0 * out[5], 2.0 * out[6]
        out[3] = -q[1] * a + q[0] * b + q[3] * c - q[2] * d2
        out[4] = -q[2] * a - q[3] * b + q[0] * c + q[1] * d2
        out[5] = -q[3] * a + q[2] * b - q[1] * c + q[0] * d2
    for i in range(3, 6):
        twist[i] = out[i] + rest * prior[i]
    return support


@njit(cache=True)
def _turn(w: Array, dt: float) -> Array:
    """Quaternion of a turn at the body rate ``w`` for ``dt``."""
    turn = np.empty(3)
    for i in range(3):
        turn[i] = dt * w[i]
    return exp(turn)


@njit(cache=True)
def _move(p: Array, q: Array, twist: Array, dt: float, low: Array, high: Array) -> tuple[Array, Array]:
    """Pose after ``dt`` at a constant twist, the position projected onto the tracking bounds."""
    p_next = np.empty(3)
    for i in range(3):
        p_next[i] = p[i] + dt * twist[i] * axis_factor(p[i], twist[i], low[i], high[i], POSE_LAYER_M)
    return p_next, normalise(multiply(q, _turn(twist[3:6], dt)))


@njit(cache=True)
def _carry_prior(
    prior: Array,
    q: Array,
    twist: Array,
    support: float,
    code: int,
    turn_memory: float,
    handover: float,
    dt: float,
) -> None:
    """Advance the prior mean in place: it turns with the body, forgets its turn, and follows the learned motion."""
    if code == 2:
        body = rotate_inverse(q, prior[0:3])
        turned = rotate(multiply(q, _turn(prior[3:6], dt)), body)
        fade = math.exp(-dt / turn_memory)
        for i in range(3):
            prior[i] = turned[i]
            prior[3 + i] *= fade
    share = support * -math.expm1(-dt / handover)
    for i in range(6):
        prior[i] += share * (twist[i] - prior[i])


@njit(cache=True)
def advance(
    p: Array,
    q: Array,
    prior: Array,
    duration: float,
    steps: int,
    code: int,
    turn_memory: float,
    handover: float,
    stacked: bool,
    weights: Array,
    centres: Array,
    precision: Array,
    heading_scale: float,
    low: Array,
    high: Array,
    twist: Array,
    offset: float,
    roads: RoadMap,
) -> tuple[Array, Array, float]:
    """Pose after ``duration`` seconds in ``steps`` midpoint steps; ``prior`` and ``twist`` (6,) change in place.

    On ``roads`` the prior is steered before every step, to go on at ``offset`` from their middle. Returns the pose and
    the support at the last midpoint.
    """
    dt = duration / steps
    support = 0.0
    for _ in range(steps):
        steer(p[0], p[1], prior, offset, roads)
        model_twist(p, q, prior, code > 0, stacked, weights, centres, precision, heading_scale, twist)
        p_mid, q_mid = _move(p, q, twist, 0.5 * dt, low, high)
        support = model_twist(
            p_mid, q_mid, prior, code > 0, stacked, weights, centres, precision, heading_scale, twist
        )
        _carry_prior(prior, q, twist, support, code, turn_memory, handover, dt)
        p, q = _move(p, q, twist, dt, low, high)
    return p, q, support


@njit(cache=True)
def roll_out(
    p: Array,
    q: Array,
    prior: Array,
    dt: float,
    count: int,
    substeps: int,
    code: int,
    turn_memory: float,
    handover: float,
    stacked: bool,
    weights: Array,
    centres: Array,
    precision: Array,
    heading_scale: float,
    low: Array,
    high: Array,
    offset: float,
    roads: RoadMap,
) -> tuple[Array, Array]:
    """Poses (K, 3), (K, 4) at ``dt``, 2 ``dt``, ...; nothing passed in is changed."""
    ps = np.empty((count, 3))
    qs = np.empty((count, 4))
    carried = prior.copy()
    twist = np.zeros(6)
    for k in range(count):
        p, q, _ = advance(
            p,
            q,
            carried,
            dt,
            substeps,
            code,
            turn_memory,
            handover,
            stacked,
            weights,
            centres,
            precision,
            heading_scale,
            low,
            high,
            twist,
            offset,
            roads,
        )
        for i in range(3):
            ps[k, i] = p[i]
        for i in range(4):
            qs[k, i] = q[i]
    return ps, qs
