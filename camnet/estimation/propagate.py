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

from camnet.compiled import cached_njit
from camnet.estimation.basis import CUTOFF
from camnet.estimation.projection import axis_factor
from camnet.estimation.road_prior import RoadMap, steer
from camnet.geometry.triples import Quaternion, Triple, borrowing, exp, multiply, rotate, rotate_inverse
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


@borrowing
def _inputs(p: Triple, q: Quaternion, d: int, heading_scale: float) -> Quaternion:
    """Rho as in `camnet.estimation.basis`, its first ``d`` numbers."""
    if d != 4:
        return p[0], p[1], 0.0, 0.0
    cx = 1.0 - 2.0 * (q[2] * q[2] + q[3] * q[3])
    cy = 2.0 * (q[1] * q[2] + q[0] * q[3])
    norm = math.sqrt(cx * cx + cy * cy)
    scale = heading_scale / norm if norm > 1e-12 else 0.0
    return p[0], p[1], scale * cx, scale * cy


@borrowing
def _field(
    p: Triple,
    q: Quaternion,
    weights: Array,
    centres: Array,
    precision: Array,
    heading_scale: float,
    out: Array,
) -> None:
    """Write W^T sigma (8,) at a pose to ``out``."""
    n, d = centres.shape
    x = _inputs(p, q, d, heading_scale)
    for o in range(COLUMNS):
        out[o] = 0.0
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


@borrowing
def _blend(q: Quaternion, prior: Array, use_prior: bool, stacked: bool, out: Array, twist: Array) -> float:
    """Write the twist (6,) of the field ``out`` (8,) and the prior; return the support."""
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


@cached_njit
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
    out, at = np.zeros(COLUMNS), (q[0], q[1], q[2], q[3])
    _field((p[0], p[1], p[2]), at, weights, centres, precision, heading_scale, out)
    return _blend(at, prior, use_prior, stacked, out, twist)


@borrowing
def _turned(q: Quaternion, w: Triple, dt: float) -> Quaternion:
    """Orientation after ``dt`` at the constant body rate ``w``."""
    a = multiply(q, exp((dt * w[0], dt * w[1], dt * w[2])))
    n = math.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2] + a[3] * a[3])
    return a[0] / n, a[1] / n, a[2] / n, a[3] / n


@borrowing
def _moved(p: Triple, v: Array, dt: float, low: Array, high: Array) -> Triple:
    """Position after ``dt`` at a constant velocity, projected onto the tracking bounds."""
    return (
        p[0] + dt * v[0] * axis_factor(p[0], v[0], low[0], high[0], POSE_LAYER_M),
        p[1] + dt * v[1] * axis_factor(p[1], v[1], low[1], high[1], POSE_LAYER_M),
        p[2] + dt * v[2] * axis_factor(p[2], v[2], low[2], high[2], POSE_LAYER_M),
    )


@borrowing
def _carry_prior(
    prior: Array, q: Quaternion, twist: Array, share: float, code: int, fade: float, dt: float
) -> None:
    """Advance the prior mean in place: it turns with the body, forgets its turn, and follows the learned motion."""
    if code == 2:
        body = rotate_inverse(q, (prior[0], prior[1], prior[2]))
        turned = rotate(multiply(q, exp((dt * prior[3], dt * prior[4], dt * prior[5]))), body)
        for i in range(3):
            prior[i] = turned[i]
            prior[3 + i] *= fade
    for i in range(6):
        prior[i] += share * (twist[i] - prior[i])


@borrowing
def _integrate(
    p: Triple,
    q: Quaternion,
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
    out: Array,
) -> tuple[Triple, Quaternion, float]:
    """Do what ``advance`` does; ``out`` (8,) is room for the field."""
    dt, support = duration / steps, 0.0
    fade, follow = math.exp(-dt / turn_memory), -math.expm1(-dt / handover)
    for _ in range(steps):
        steer(p[0], p[1], prior, offset, roads)
        _field(p, q, weights, centres, precision, heading_scale, out)
        _blend(q, prior, code > 0, stacked, out, twist)
        p_mid, q_mid = _moved(p, twist, 0.5 * dt, low, high), q
        if stacked or centres.shape[1] == 4:  # else the field is one of places alone
            q_mid = _turned(q, (twist[3], twist[4], twist[5]), 0.5 * dt)
        _field(p_mid, q_mid, weights, centres, precision, heading_scale, out)
        support = _blend(q_mid, prior, code > 0, stacked, out, twist)
        _carry_prior(prior, q, twist, support * follow, code, fade, dt)
        p, q = _moved(p, twist, dt, low, high), _turned(q, (twist[3], twist[4], twist[5]), dt)
    return p, q, support


@cached_njit
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
    place, turn, support = _integrate(
        (p[0], p[1], p[2]),
        (q[0], q[1], q[2], q[3]),
        prior,
        duration,
        steps,
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
        np.zeros(COLUMNS),
    )
    return np.array(place), np.array(turn), support


@cached_njit
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
    twist, out = np.zeros(6), np.zeros(COLUMNS)
    place, turn = (p[0], p[1], p[2]), (q[0], q[1], q[2], q[3])
    for k in range(count):
        place, turn, _ = _integrate(
            place,
            turn,
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
            out,
        )
        for i in range(3):
            ps[k, i] = place[i]
        for i in range(4):
            qs[k, i] = turn[i]
    return ps, qs
