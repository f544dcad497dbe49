"""What a measured pose does to a row: feedback, weights, windows, and the end of a gap.

Compiled twin of the parts of `LearningEstimator` and `Learner` with these names, its oracles.
"""

from __future__ import annotations

import math

from camnet.batch.compiled import inner
from camnet.batch.estimator_columns import (
    CHANGED,
    CROSSED,
    EXIT,
    GAP,
    GAP_ENTRY,
    GAP_MODEL,
    HAS_EXIT,
    LAST_SEEN,
    MEAN_SQUARE,
    MODEL,
    PRIOR,
    RATES,
    SEEN,
    TWIST,
    P,
    Q,
    T,
)
from camnet.batch.estimator_field import Kernels, kernels_at
from camnet.batch.estimator_gap import bridge, path_windows
from camnet.batch.estimator_learn import interrupt, next_window, refresh_prior
from camnet.batch.estimator_model import activate, refresh, step
from camnet.batch.estimator_motion import blend, due_steps, heading
from camnet.batch.estimator_parts import counts_of, inverse_of, model_of, place_of, weights_of
from camnet.batch.estimator_setup import Rules
from camnet.batch.estimator_stack import forget, learn_window, open_books
from camnet.estimation.concurrent_learning import switching
from camnet.estimation.propagate import COLUMNS, UNIT
from camnet.estimation.radius import MEMORY, REMEMBERED_GAPS
from camnet.estimation.vector_rows import picked_rows
from camnet.geometry.triples import Quaternion, multiply, size
from camnet.types import Array, IntArray

__all__ = ["active_sigma", "align", "correct_seen", "learn", "resight"]


@inner
def learn(kernels: Kernels, c: Rules, pose: Array, k: IntArray, d: Array, across: int) -> bool:
    """Offer the window that is complete (``across`` 0), or those of the path across the gap (1), to their stack.

    After a change of the target's ways, what contradicts them goes first. False: the outlier gate let nothing in.
    """
    j, windows, before, enter = k[MODEL], 1, math.inf, True
    end, rows, increments, weights = c.work.fit, c.work.rows, c.work.increments, c.work.shares
    if across:
        j, before = k[GAP_MODEL], pose[GAP]
        windows = path_windows(c, pose, k, d, end)
    for i in range(windows):
        weights[i] = 1.0
        for a in range(c.size):
            rows[i, a] = 0.0
        for o in range(COLUMNS):
            increments[i, o] = 0.0
    if not across:
        enter = next_window(c, k, d, pose[T], rows[0], increments[0])
        before = model_of(c, k, d, j)[CHANGED]
    elif windows > 0 and not bridge(kernels, c, k, d, j, pose[GAP:], end, windows, rows, increments, weights):
        before = math.inf
    if not enter:
        return False
    for i in range(windows if c.forgetting and math.isfinite(before) else 0):
        forget(c, k, d, j, rows[i], before)
    for i in range(windows):
        open_books(c, k, d, j)
        learn_window(c, k, d, j, pose[T], rows[i], increments[i], weights[i])
    refresh(c, k, d, j)
    return True


@inner
def align(q: Array, reference: Array) -> None:
    """Give ``q`` the sign that is closer to ``reference``."""
    if q[0] * reference[0] + q[1] * reference[1] + q[2] * reference[2] + q[3] * reference[3] < 0.0:
        for i in range(4):
            q[i] = -q[i]


@inner
def active_sigma(
    kernels: Kernels,
    c: Rules,
    k: IntArray,
    d: Array,
    j: int,
    p: Array,
    q: Array,
) -> int:
    """Write places and sigma of the kernels in reach of a measured pose, all of them active from now on."""
    (hx, hy), index = heading((q[0], q[1], q[2], q[3])), c.work.places
    count = kernels_at(kernels, p[0], p[1], hx, hy, index, c.work.sigma, c.work.factors)
    places = place_of(c, k, j)
    for m in range(count):
        place = places[index[m]]
        index[m] = place if place >= 0 else activate(c, k, d, j, index[m])
    return int(count)


@inner
def resight(c: Rules, pose: Array, k: IntArray, d: Array, t: float, p: Array) -> None:
    """Take the target up again at ``p``, after a gap or handed over without one."""
    old, duration = k[MODEL], t - pose[LAST_SEEN]
    if k[SEEN]:
        interrupt(c, pose, k, d, pose[LAST_SEEN])
    else:
        if duration > 0.0:
            counts, slot = counts_of(c, k, old), RATES + counts_of(c, k, old)[CROSSED] % REMEMBERED_GAPS
            miss = size(p[0] - pose[P], p[1] - pose[P + 1], p[2] - pose[P + 2])
            model_of(c, k, d, old)[slot] = miss / duration
            counts[CROSSED] += 1
        if c.learn_across and k[HAS_EXIT]:
            k[GAP_MODEL], pose[GAP_ENTRY] = old, t
            for i in range(14):
                pose[GAP + i] = pose[EXIT + i]


@inner
def correct_seen(
    c: Rules,
    pose: Array,
    k: IntArray,
    d: Array,
    t: float,
    p: Array,
    q: Array,
    count: int,
) -> None:
    """In view: the model's rates at the measured pose, then the feedback, then the weights."""
    j, duration = k[MODEL], t - pose[T]
    field, error = c.work.field, c.work.error
    picked_rows(c.work.sigma, c.work.places, count, weights_of(c, k, d, j), field)
    if c.prior > 0 and field[UNIT] < 1.0:
        refresh_prior(c, pose, k, d)
    twist, model = pose[TWIST:], model_of(c, k, d, j)
    blend(field, pose[PRIOR:], c.prior > 0, twist)
    residual, inverse = _feedback(c, pose, twist, duration, p, q, error), inverse_of(c, k, d, j)
    model[MEAN_SQUARE] += (residual**2 - model[MEAN_SQUARE]) / MEMORY
    for i in range(due_steps(c, pose, model, t)):
        step(c, k, d, j, inverse, c.dt_s * c.gamma, count if i == 0 else 0)


@inner
def _feedback(c: Rules, pose: Array, twist: Array, dt: float, p: Array, q: Array, error: Array) -> float:
    """Advance the pose by ``dt`` with feedback: `measured_step`, `correct_pose`, `output_error`; the residual, m."""
    now = (pose[Q], pose[Q + 1], pose[Q + 2], pose[Q + 3])
    d = multiply(now, (0.0, twist[3], twist[4], twist[5]))
    h = 0.5 * dt
    a = (now[0] + h * d[0], now[1] + h * d[1], now[2] + h * d[2], now[3] + h * d[3])
    n = math.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2] + a[3] * a[3])
    m = (a[0] / n, a[1] / n, a[2] / n, a[3] / n)
    sign = -1.0 if q[0] * m[0] + q[1] * m[1] + q[2] * m[2] + q[3] * m[3] < 0.0 else 1.0
    aligned = (sign * q[0], sign * q[1], sign * q[2], sign * q[3])
    share, push, square = -math.expm1(-c.k1_per_s * dt), dt * c.k2, 0.0
    for i in range(3):
        moved = pose[P + i] + dt * twist[i]
        e = p[i] - moved
        error[i] = e
        square += e * e
        pose[P + i] = moved + share * e + push * switching(e, c.switching, c.boundary_layer)
    norm2 = 0.0
    for i in range(4):
        e = aligned[i] - m[i]
        pose[Q + i] = m[i] + share * e + push * switching(e, c.switching, c.boundary_layer)
        norm2 += pose[Q + i] ** 2
    norm = math.sqrt(norm2)
    for i in range(4):
        pose[Q + i] /= norm
    _turn_error(aligned, m, error)
    return math.sqrt(square)


@inner
def _turn_error(aligned: Quaternion, moved: Quaternion, error: Array) -> None:
    """Write the orientation's part of G^T eta_til to ``error`` (8,): 1/2 B^T of the quaternions' difference."""
    q = aligned
    a, b = 0.5 * (q[0] - moved[0]), 0.5 * (q[1] - moved[1])
    c, d = 0.5 * (q[2] - moved[2]), 0.5 * (q[3] - moved[3])
    error[3] = -q[1] * a + q[0] * b + q[3] * c - q[2] * d
    error[4] = -q[2] * a - q[3] * b + q[0] * c + q[1] * d
    error[5] = -q[3] * a + q[2] * b - q[1] * c + q[0] * d
    error[6], error[7] = 0.0, 0.0
