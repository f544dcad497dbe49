"""The learning estimator for many environments: what loops over environments call.

Compiled twin of `camnet.estimation.learning_estimator.LearningEstimator` in the world frame, which is its oracle and
says what is done and why. All state is in rows of arrays (`camnet.batch.estimator_layout`); nothing here makes a Python
object, holds the interpreter's lock or is shared between rows, so that threads may work on rows of their own.

    setup = build_setup(settings, basis, n_regions, rate_hz, tracking_bounds)       once, in Python
    state = allocate(setup, settings, rows, duration_s)                             once, in Python
    reset(setup, state, row)                                                        start of an episode
    correct(setup, state, row, t_s, p, q, region)                                   a measured world pose
    predict(setup, state, row, t_s)                                                 an instant without one
    rollout(setup, state, row, dt_s, out)                                           out (K, 8): p, q, radius at dt, 2 dt, ...
    estimate(setup, state, row, out)                                                out (16,): see ``ESTIMATE``

``p`` (3,) and ``q`` (4,) are the measured pose of the target in the world; ``region`` is the index of the camera that
measured it. Times must not run backwards; a measurement older than the state is moved along as in the class.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from camnet.batch.estimator_field import dense_weights, field_on_grid, kernels_at, workspace
from camnet.batch.estimator_gap import learn_gap
from camnet.batch.estimator_layout import (
    ACTIVE,
    CROSSED,
    EXIT,
    GAP,
    GAP_ENTRY,
    GAP_MODEL,
    HAS_EXIT,
    LAST_IN_FORCE,
    LAST_SEEN,
    MEAN_SQUARE,
    MODEL,
    OWED,
    PRIOR,
    RATES,
    REGION,
    SEEN,
    TWIST,
    EstimatorSetup,
    EstimatorState,
    P,
    Q,
    T,
    allocate,
    build_setup,
    reset,
)
from camnet.batch.estimator_learn import interrupt, learn_pose, refresh_prior
from camnet.batch.estimator_model import activate, settle, step, step_with_feedback
from camnet.batch.triples import Quaternion, Triple, multiply, rotate, rotate_inverse, turn
from camnet.estimation.concurrent_learning import switching
from camnet.estimation.learning_estimator import MAX_STEP_S
from camnet.estimation.observation import LOST_PERIODS
from camnet.estimation.projection import axis_factor
from camnet.estimation.propagate import COLUMNS, POSE_LAYER_M, UNIT
from camnet.estimation.radius import BLIND_SHARE, MARGIN, MEMORY, REMEMBERED_GAPS
from camnet.estimation.vector_rows import picked_rows
from camnet.types import Array, IntArray

__all__ = [
    "ESTIMATE",
    "EstimatorSetup",
    "EstimatorState",
    "allocate",
    "build_setup",
    "correct",
    "estimate",
    "predict",
    "radius",
    "reset",
    "rollout",
]

#: where the fields of an estimate are in ``out`` of `estimate`: first column and number of columns
ESTIMATE = {
    "p_world": (0, 3),
    "q_world": (3, 4),
    "v_world": (7, 3),
    "w_body": (10, 3),
    "seen": (13, 1),
    "last_seen_s": (14, 1),
    "radius_m": (15, 1),
}


# --- results ---------------------------------------------------------------------------------------------------------


@njit(cache=True, nogil=True)
def growth(s: EstimatorState, r: int) -> float:
    """Growth of the error radius while unseen, m/s."""
    j = s.flags[r, MODEL]
    crossed = min(s.counts[r, j, CROSSED], REMEMBERED_GAPS)
    if crossed == 0:
        v = s.pose[r, TWIST : TWIST + 3]
        return BLIND_SHARE * math.sqrt(v[0] ** 2 + v[1] ** 2 + v[2] ** 2)
    most = 0.0
    for i in range(crossed):
        most = max(most, s.model[r, j, RATES + i])
    return MARGIN * most


@njit(cache=True, nogil=True)
def radius(s: EstimatorState, r: int) -> float:
    """Empirical error radius of the position now, m; inf before the first measurement."""
    if s.flags[r, REGION] < 0:
        return math.inf
    base = 3.0 * math.sqrt(s.model[r, s.flags[r, MODEL], MEAN_SQUARE])
    return base + growth(s, r) * max(0.0, s.pose[r, T] - s.pose[r, LAST_SEEN])


@njit(cache=True, nogil=True)
def estimate(c: EstimatorSetup, s: EstimatorState, r: int, out: Array) -> int:
    """Write what is believed now to ``out`` (16,), fields as in ``ESTIMATE``; return the region last seen in or -1.

    Before the first measurement the position is NaN.
    """
    pose = s.pose[r]
    for i in range(3):
        out[i], out[7 + i], out[10 + i] = pose[P + i], pose[TWIST + i], pose[TWIST + 3 + i]
    for i in range(4):
        out[3 + i] = pose[Q + i]
    out[13], out[14], out[15] = s.flags[r, SEEN], pose[LAST_SEEN], radius(s, r)
    return int(s.flags[r, REGION])


# --- motion ----------------------------------------------------------------------------------------------------------


@njit(cache=True, nogil=True)
def _heading(q: Quaternion) -> tuple[float, float]:
    """Direction of the body's x axis seen from above, not scaled."""
    return 1.0 - 2.0 * (q[2] * q[2] + q[3] * q[3]), 2.0 * (q[1] * q[2] + q[0] * q[3])


@njit(cache=True, nogil=True)
def _moved(c: EstimatorSetup, p: Triple, twist: Array, dt: float) -> Triple:
    """Position after ``dt`` at a constant velocity, projected onto the tracking bounds."""
    low, high = c.low, c.high
    return (
        p[0] + dt * twist[0] * axis_factor(p[0], twist[0], low[0], high[0], POSE_LAYER_M),
        p[1] + dt * twist[1] * axis_factor(p[1], twist[1], low[1], high[1], POSE_LAYER_M),
        p[2] + dt * twist[2] * axis_factor(p[2], twist[2], low[2], high[2], POSE_LAYER_M),
    )


@njit(cache=True, nogil=True)
def _turned(q: Quaternion, twist: Array, dt: float) -> Quaternion:
    """Orientation after ``dt`` at a constant body rate."""
    a = multiply(q, turn(dt * twist[3], dt * twist[4], dt * twist[5]))
    n = math.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2] + a[3] * a[3])
    return a[0] / n, a[1] / n, a[2] / n, a[3] / n


@njit(cache=True, nogil=True)
def _blend(field: Array, prior: Array, use_prior: bool, twist: Array) -> float:
    """Write the twist (6,) of the field W^T sigma (8,) and the prior; return the support u."""
    support = min(1.0, max(0.0, field[UNIT]))
    rest = 1.0 - support if use_prior else 0.0
    for i in range(6):
        twist[i] = field[i] + rest * prior[i]
    return support


@njit(cache=True, nogil=True)
def _carry_prior(
    c: EstimatorSetup, prior: Array, q: Quaternion, twist: Array, share: float, fade: float, dt: float
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


@njit(cache=True, nogil=True)
def _field(
    c: EstimatorSetup,
    s: EstimatorState,
    r: int,
    j: int,
    p: Triple,
    q: Quaternion,
    index: IntArray,
    sigma: Array,
    work: Array,
    out: Array,
) -> None:
    """Write W^T sigma (8,) at a pose to ``out``, from the active weights."""
    hx, hy = _heading(q)
    count = kernels_at(c.kernels, p[0], p[1], hx, hy, index, sigma, work)
    active = 0
    for m in range(count):
        place = s.place[r, j, index[m]]
        if place >= 0:
            index[active], sigma[active] = place, sigma[m]
            active += 1
    picked_rows(sigma, index, active, s.weights[r, j], out)


@njit(cache=True, nogil=True)
def _advance(c: EstimatorSetup, s: EstimatorState, r: int, t: float) -> None:
    """Motion without feedback up to ``t``, and the weights on their stack alone."""
    pose, j = s.pose[r], s.flags[r, MODEL]
    duration = t - pose[T]
    if duration <= 0.0:
        return
    refresh_prior(s, r)
    steps = math.ceil(duration / MAX_STEP_S)
    dt = duration / steps
    kernels = len(c.kernels.centres)
    index, sigma, work = np.empty(kernels, dtype=np.int64), np.empty(kernels), workspace(c.kernels)
    field, prior, twist = np.empty(COLUMNS), pose[PRIOR : PRIOR + 6], pose[TWIST : TWIST + 6]
    fade, follow = math.exp(-dt / c.turn_memory_s), -math.expm1(-dt / c.handover_s)
    p = (pose[P], pose[P + 1], pose[P + 2])
    q = (pose[Q], pose[Q + 1], pose[Q + 2], pose[Q + 3])
    for _ in range(steps):
        _field(c, s, r, j, p, q, index, sigma, work, field)
        _blend(field, prior, c.prior > 0, twist)
        p_mid, q_mid = _moved(c, p, twist, 0.5 * dt), _turned(q, twist, 0.5 * dt)
        _field(c, s, r, j, p_mid, q_mid, index, sigma, work, field)
        support = _blend(field, prior, c.prior > 0, twist)
        _carry_prior(c, prior, q, twist, support * follow, fade, dt)
        p, q = _moved(c, p, twist, dt), _turned(q, twist, dt)
    for i in range(3):
        pose[P + i] = p[i]
    for i in range(4):
        pose[Q + i] = q[i]
    pose[T] = t
    for _ in range(_due_steps(c, s, r, duration)):
        step(c, s, r, j)


@njit(cache=True, nogil=True)
def _due_steps(c: EstimatorSetup, s: EstimatorState, r: int, duration: float) -> int:
    """Count the nominal weight steps that have fallen due."""
    s.pose[r, OWED] += duration
    steps = int(s.pose[r, OWED] / c.dt_s + 0.5)
    s.pose[r, OWED] -= steps * c.dt_s
    return steps


@njit(cache=True, nogil=True)
def rollout(c: EstimatorSetup, s: EstimatorState, r: int, dt_s: float, out: Array) -> None:
    """Future path if no measurement came any more: ``out`` (K, 8) takes p, q and radius at dt, 2 dt, ... from now.

    What is believed does not change. Before the first measurement positions are NaN and the radius is infinite.
    """
    pose, count = s.pose[r], len(out)
    if s.flags[r, REGION] < 0:
        out[:, 0:3], out[:, 3:7], out[:, 7] = math.nan, pose[Q : Q + 4], math.inf
        return
    refresh_prior(s, r)
    j = s.flags[r, MODEL]
    substeps = max(1, math.ceil(dt_s / (4.0 * MAX_STEP_S)))
    dt = dt_s / substeps
    prior, twist, field = pose[PRIOR : PRIOR + 6].copy(), np.zeros(6), np.empty(COLUMNS)
    fade, follow = math.exp(-dt / c.turn_memory_s), -math.expm1(-dt / c.handover_s)
    p = (pose[P], pose[P + 1], pose[P + 2])
    q = (pose[Q], pose[Q + 1], pose[Q + 2], pose[Q + 3])
    start, speed = radius(s, r), growth(s, r)
    kernels = len(c.kernels.centres)
    index, sigma, work = np.empty(kernels, dtype=np.int64), np.empty(kernels), workspace(c.kernels)
    grid = c.kernels.on_grid
    dense, ranges = np.empty((0, COLUMNS)), np.empty((0, 2), dtype=np.int64)
    if grid:
        dense, ranges = dense_weights(c.kernels, s.order[r, j], s.counts[r, j, ACTIVE], s.weights[r, j])
    for k in range(count):
        for _ in range(substeps):
            if grid:
                field_on_grid(c.kernels, dense, ranges, p[0], p[1], work, field)
            else:
                _field(c, s, r, j, p, q, index, sigma, work, field)
            _blend(field, prior, c.prior > 0, twist)
            p_mid = _moved(c, p, twist, 0.5 * dt)
            if grid:
                field_on_grid(c.kernels, dense, ranges, p_mid[0], p_mid[1], work, field)
            else:
                _field(c, s, r, j, p_mid, _turned(q, twist, 0.5 * dt), index, sigma, work, field)
            support = _blend(field, prior, c.prior > 0, twist)
            _carry_prior(c, prior, q, twist, support * follow, fade, dt)
            p, q = _moved(c, p, twist, dt), _turned(q, twist, dt)
        out[k, 0], out[k, 1], out[k, 2] = p
        out[k, 3], out[k, 4], out[k, 5], out[k, 6] = q
        out[k, 7] = start + speed * dt_s * (k + 1)


# --- advancing -------------------------------------------------------------------------------------------------------


@njit(cache=True, nogil=True)
def predict(c: EstimatorSetup, s: EstimatorState, r: int, t_s: float) -> None:
    """Advance row ``r`` to ``t_s`` without a measurement; nothing happens before the first one."""
    if s.flags[r, REGION] < 0 or t_s <= s.pose[r, T]:
        return
    if s.flags[r, SEEN] and t_s - s.pose[r, LAST_SEEN] > LOST_PERIODS * c.dt_s:
        _lose(s, r)
    _advance(c, s, r, t_s)


@njit(cache=True, nogil=True)
def correct(
    c: EstimatorSetup, s: EstimatorState, r: int, t_s: float, p: Array, q: Array, region: int
) -> None:
    """Advance row ``r`` to ``t_s`` with a measured world pose p (3,), q (4,) in force; the first call initialises."""
    pose, flags = s.pose[r], s.flags[r]
    j = 0 if c.models == 1 else region
    t, at, measured = t_s, p.copy(), q.copy()
    if flags[REGION] >= 0 and t < pose[T]:
        for i in range(3):
            at[i] += (pose[T] - t) * pose[TWIST + i]
        t = pose[T]
    kernels = len(c.kernels.centres)
    index, sigma = np.empty(kernels, dtype=np.int64), np.empty(kernels)
    first = flags[REGION] < 0
    lost = not first and t - pose[LAST_SEEN] > LOST_PERIODS * c.dt_s
    if first or lost or j != flags[MODEL]:
        if first:
            for i in range(3):
                pose[P + i] = at[i]
            for i in range(4):
                pose[Q + i] = measured[i]
            pose[T] = t
        else:
            _resight(c, s, r, t, at, measured, j)
        flags[MODEL] = j
        count = _active_sigma(c, s, r, j, at, measured, index, sigma)
    else:
        _align(measured, pose[Q : Q + 4])
        count = _active_sigma(c, s, r, j, at, measured, index, sigma)
        _correct_seen(c, s, r, j, t, at, measured, index, sigma, count)
    flags[REGION], flags[SEEN] = region, 1
    pose[LAST_SEEN], pose[T] = t, t
    learn_pose(c, s, r, t, at, measured, index, sigma, count)
    learn_gap(c, s, r, t)


@njit(cache=True, nogil=True)
def _align(q: Array, reference: Array) -> None:
    """Give ``q`` the sign that is closer to ``reference``."""
    if q[0] * reference[0] + q[1] * reference[1] + q[2] * reference[2] + q[3] * reference[3] < 0.0:
        for i in range(4):
            q[i] = -q[i]


@njit(cache=True, nogil=True)
def _active_sigma(
    c: EstimatorSetup,
    s: EstimatorState,
    r: int,
    j: int,
    p: Array,
    q: Array,
    index: IntArray,
    sigma: Array,
) -> int:
    """Write places and sigma of the kernels in reach of a measured pose, all of them active from now on."""
    hx, hy = _heading((q[0], q[1], q[2], q[3]))
    count = kernels_at(c.kernels, p[0], p[1], hx, hy, index, sigma, workspace(c.kernels))
    for m in range(count):
        place = s.place[r, j, index[m]]
        index[m] = place if place >= 0 else activate(c, s, r, j, index[m])
    return count


@njit(cache=True, nogil=True)
def _lose(s: EstimatorState, r: int) -> None:
    """Note that the target has become unseen, and how it left."""
    s.flags[r, SEEN] = 0
    interrupt(s, r, s.pose[r, LAST_SEEN])


@njit(cache=True, nogil=True)
def _resight(c: EstimatorSetup, s: EstimatorState, r: int, t: float, p: Array, q: Array, j: int) -> None:
    """Take the target up again, after a gap or handed over without one, with model ``j``."""
    pose, flags = s.pose[r], s.flags[r]
    if flags[SEEN] and t - pose[LAST_SEEN] > LOST_PERIODS * c.dt_s:
        _lose(s, r)
    old = flags[MODEL]
    _advance(c, s, r, t)
    if flags[SEEN]:
        interrupt(s, r, pose[LAST_SEEN])
        flags[HAS_EXIT] = 0
    else:
        miss = math.sqrt((p[0] - pose[P]) ** 2 + (p[1] - pose[P + 1]) ** 2 + (p[2] - pose[P + 2]) ** 2)
        _crossed(s, r, old, miss, t - pose[LAST_SEEN])
        if c.learn_across and flags[HAS_EXIT]:
            flags[GAP_MODEL] = old
            for i in range(14):
                pose[GAP + i] = pose[EXIT + i]
            pose[GAP_ENTRY] = t
    if j != old:
        s.model[r, old, LAST_IN_FORCE] = t
        settle(c, s, r, j, t - s.model[r, j, LAST_IN_FORCE])
    pose[OWED] = 0.0
    if c.reset_on_sighting:
        for i in range(3):
            pose[P + i] = p[i]
        _align(q, pose[Q : Q + 4])
        for i in range(4):
            pose[Q + i] = q[i]


@njit(cache=True, nogil=True)
def _crossed(s: EstimatorState, r: int, j: int, residual_m: float, duration_s: float) -> None:
    """At a re-sighting after ``duration_s`` the prediction was wrong by ``residual_m``."""
    if duration_s > 0.0:
        slot = s.counts[r, j, CROSSED] % REMEMBERED_GAPS
        s.model[r, j, RATES + slot] = residual_m / duration_s
        s.counts[r, j, CROSSED] += 1


@njit(cache=True, nogil=True)
def _correct_seen(
    c: EstimatorSetup,
    s: EstimatorState,
    r: int,
    j: int,
    t: float,
    p: Array,
    q: Array,
    index: IntArray,
    sigma: Array,
    count: int,
) -> None:
    """In view: the model's rates at the measured pose, then the feedback, then the weights."""
    pose = s.pose[r]
    duration = t - pose[T]
    field, error = np.empty(COLUMNS), np.empty(COLUMNS)
    picked_rows(sigma, index, count, s.weights[r, j], field)
    if c.prior > 0 and field[UNIT] < 1.0:
        refresh_prior(s, r)
    twist = pose[TWIST : TWIST + 6]
    _blend(field, pose[PRIOR : PRIOR + 6], c.prior > 0, twist)
    residual = _feedback(c, pose, twist, duration, p, q, error)
    s.model[r, j, MEAN_SQUARE] += (residual**2 - s.model[r, j, MEAN_SQUARE]) / MEMORY
    for i in range(_due_steps(c, s, r, duration)):
        if i == 0:
            step_with_feedback(c, s, r, j, index, sigma, count, error)
        else:
            step(c, s, r, j)


@njit(cache=True, nogil=True)
def _feedback(
    c: EstimatorSetup, pose: Array, twist: Array, dt: float, p: Array, q: Array, error: Array
) -> float:
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


@njit(cache=True, nogil=True)
def _turn_error(aligned: Quaternion, moved: Quaternion, error: Array) -> None:
    """Write the orientation's part of G^T eta_til to ``error`` (8,): 1/2 B^T of the quaternions' difference."""
    q = aligned
    a, b = 0.5 * (q[0] - moved[0]), 0.5 * (q[1] - moved[1])
    c, d = 0.5 * (q[2] - moved[2]), 0.5 * (q[3] - moved[3])
    error[3] = -q[1] * a + q[0] * b + q[3] * c - q[2] * d
    error[4] = -q[2] * a - q[3] * b + q[0] * c + q[1] * d
    error[5] = -q[3] * a + q[2] * b - q[1] * c + q[0] * d
    error[6], error[7] = 0.0, 0.0
