"""Motion of the learning estimator in rows of arrays: twist of the field and the prior, and their integration.

Compiled twin of `camnet.estimation.propagate` and of what `LearningEstimator` does with it, its oracles.
"""

from __future__ import annotations

import math

from camnet.batch.compiled import inner
from camnet.batch.estimator_columns import ACTIVE, ADVANCED, MODEL, OWED, PRIOR, TWIST, P, Q, T
from camnet.batch.estimator_field import Kernels, dense_weights, field_on_grid, kernels_at
from camnet.batch.estimator_learn import refresh_prior, road_offset
from camnet.batch.estimator_model import step
from camnet.batch.estimator_parts import counts_of, inverse_of, model_of, order_of, place_of, weights_of
from camnet.batch.estimator_setup import Rules
from camnet.batch.triples import turn
from camnet.estimation.learning_estimator import MAX_STEP_S
from camnet.estimation.projection import axis_factor
from camnet.estimation.propagate import POSE_LAYER_M, UNIT
from camnet.estimation.road_prior import RoadMap, steer
from camnet.estimation.vector_rows import picked_rows
from camnet.geometry.triples import Quaternion, Triple, multiply, rotate, rotate_inverse
from camnet.types import Array, IntArray

__all__ = ["advance", "blend", "due_steps", "heading", "integrate"]


@inner
def heading(q: Quaternion) -> tuple[float, float]:
    """Direction of the body's x axis seen from above, not scaled."""
    return 1.0 - 2.0 * (q[2] * q[2] + q[3] * q[3]), 2.0 * (q[1] * q[2] + q[0] * q[3])


@inner
def _moved(c: Rules, p: Triple, twist: Array, dt: float) -> Triple:
    """Position after ``dt`` at a constant velocity, projected onto the tracking bounds."""
    low, high = c.low, c.high
    return (
        p[0] + dt * twist[0] * axis_factor(p[0], twist[0], low[0], high[0], POSE_LAYER_M),
        p[1] + dt * twist[1] * axis_factor(p[1], twist[1], low[1], high[1], POSE_LAYER_M),
        p[2] + dt * twist[2] * axis_factor(p[2], twist[2], low[2], high[2], POSE_LAYER_M),
    )


@inner
def _turned(q: Quaternion, twist: Array, dt: float) -> Quaternion:
    """Orientation after ``dt`` at a constant body rate."""
    a = multiply(q, turn(dt * twist[3], dt * twist[4], dt * twist[5]))
    n = math.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2] + a[3] * a[3])
    return a[0] / n, a[1] / n, a[2] / n, a[3] / n


@inner
def blend(field: Array, prior: Array, use_prior: bool, twist: Array) -> float:
    """Write the twist (6,) of the field W^T sigma (8,) and the prior; return the support u."""
    support: float = min(1.0, max(0.0, field[UNIT]))
    rest = 1.0 - support if use_prior else 0.0
    for i in range(6):
        twist[i] = field[i] + rest * prior[i]
    return support


@inner
def _carry_prior(
    c: Rules, prior: Array, q: Quaternion, twist: Array, share: float, fade: float, dt: float
) -> None:
    """Advance the prior mean: it turns with the body, forgets its turn, and follows the learned motion."""
    if c.prior == 2:
        body = rotate_inverse(q, (prior[0], prior[1], prior[2]))
        turned = rotate(multiply(q, turn(dt * prior[3], dt * prior[4], dt * prior[5])), body)
        for i in range(3):
            prior[i] = turned[i]
            prior[3 + i] *= fade
    for i in range(6):
        prior[i] += share * (twist[i] - prior[i])


@inner
def _field(
    kernels: Kernels,
    c: Rules,
    k: IntArray,
    d: Array,
    j: int,
    p: Triple,
    q: Quaternion,
    out: Array,
) -> None:
    """Write W^T sigma (8,) at a pose to ``out``, from the active weights."""
    (hx, hy), index, sigma = heading(q), c.work.places, c.work.sigma
    count = kernels_at(kernels, p[0], p[1], hx, hy, index, sigma, c.work.factors)
    places, active = place_of(c, k, j), 0
    for m in range(count):
        place = places[index[m]]
        if place >= 0:
            index[active], sigma[active] = place, sigma[m]
            active += 1
    picked_rows(sigma, index, active, weights_of(c, k, d, j), out)


@inner
def integrate(
    kernels: Kernels,
    roads: RoadMap,
    c: Rules,
    k: IntArray,
    d: Array,
    pose: Array,
    dt_out: float,
    substeps: int,
    out: Array,
) -> None:
    """Integrate the predictor over intervals of ``dt_out`` in midpoint steps; ``pose`` changes in place.

    ``out`` (K, 8) takes the pose after each of K intervals; without rows it is one interval, and no path is kept. For
    a path the weights are first spread over the kernels' grid, which pays for many steps.
    """
    j, dt, grid = k[MODEL], dt_out / substeps, kernels.on_grid and len(out) > 0
    index, dense, box = c.work.places, c.work.dense, (0.0, 0.0, 0.0, 0.0)
    if grid:
        active, weights = counts_of(c, k, j)[ACTIVE], weights_of(c, k, d, j)
        box = dense_weights(kernels, order_of(c, k, j), active, weights, dense, index)
    field, prior, twist = c.work.field, pose[PRIOR:], pose[TWIST:]
    fade, follow = math.exp(-dt / c.turn_memory_s), -math.expm1(-dt / c.handover_s)
    p = (pose[P], pose[P + 1], pose[P + 2])
    q = (pose[Q], pose[Q + 1], pose[Q + 2], pose[Q + 3])
    support, offset = 0.0, road_offset(pose, k, roads)
    for i in range(max(1, len(out))):
        for _ in range(substeps):
            p_at, q_at = p, q
            steer(p[0], p[1], prior, offset, roads)
            for half in range(2):
                if grid:
                    field_on_grid(kernels, dense, index, box, p_at[0], p_at[1], c.work.factors, field)
                else:
                    _field(kernels, c, k, d, j, p_at, q_at, field)
                support = blend(field, prior, c.prior > 0, twist)
                if half == 0:
                    p_at = _moved(c, p, twist, 0.5 * dt)
                    if not grid:
                        q_at = _turned(q, twist, 0.5 * dt)
            _carry_prior(c, prior, q, twist, support * follow, fade, dt)
            p, q = _moved(c, p, twist, dt), _turned(q, twist, dt)
        if len(out) > 0:
            out[i, 0], out[i, 1], out[i, 2] = p
            out[i, 3], out[i, 4], out[i, 5], out[i, 6] = q
    pose[P], pose[P + 1], pose[P + 2] = p
    pose[Q], pose[Q + 1], pose[Q + 2], pose[Q + 3] = q


@inner
def advance(kernels: Kernels, roads: RoadMap, c: Rules, pose: Array, k: IntArray, d: Array, t: float) -> None:
    """Motion without feedback up to ``t``, and the weights on their stack alone."""
    duration, j = t - pose[T], k[MODEL]
    if duration <= 0.0:
        return
    refresh_prior(c, pose, k, d)
    steps = math.ceil(duration / MAX_STEP_S)
    integrate(kernels, roads, c, k, d, pose, duration, steps, c.work.path[:0])
    pose[T] = t
    for _ in range(due_steps(c, pose, model_of(c, k, d, j), t)):
        step(c, k, d, j, inverse_of(c, k, d, j), c.dt_s * c.gamma, 0)


@inner
def due_steps(c: Rules, pose: Array, model: Array, t: float) -> int:
    """Count the nominal weight steps that have fallen due up to ``t``; they count as taken."""
    pose[OWED] += max(0.0, t - model[ADVANCED])
    model[ADVANCED] = max(t, model[ADVANCED])
    steps = int(pose[OWED] / c.dt_s + 0.5)
    pose[OWED] -= steps * c.dt_s
    return steps
