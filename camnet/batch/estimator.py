"""The learning estimator for many environments: what loops over environments call.

Compiled twin of `camnet.estimation.learning_estimator.LearningEstimator` in the world frame, which is its oracle and
says what is done and why. All state is in rows of arrays (`camnet.batch.estimator_layout`); nothing here makes a Python
object, holds the interpreter's lock or is shared between rows, so that threads may work on rows of their own.

    setup = build_setup(settings, basis, n_regions, rate_hz, tracking_bounds, roads)   once, in Python
    state = allocate(setup, settings, rows, duration_s)                                once, in Python
    reset(setup, state, row)                                                           start of an episode
    correct(setup, state, row, t_s, p, q, region)                                      a measured world pose
    predict(setup, state, row, t_s)                                                    an instant without one
    rollout(setup, state, row, dt_s, out)                                              out (K, 8): path at dt, 2 dt, ...
    estimate(setup, state, row, out)                                                   out (16,): see ``ESTIMATE``

``p`` (3,) and ``q`` (4,) are the measured pose of the target in the world; ``region`` is the index of the camera that
measured it. Times must not run backwards; a measurement older than the state is moved along as in the class.
"""

from __future__ import annotations

import math

import numpy as np

from camnet.batch.compiled import inner_owner, owner
from camnet.batch.estimator_field import Kernels, dense_weights, field_on_grid, kernels_at, workspace
from camnet.batch.estimator_gap import bridge, path_windows
from camnet.batch.estimator_layout import (
    ACTIVE,
    ADVANCED,
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
    Rules,
    T,
    allocate,
    build_setup,
    counts_of,
    inverse_of,
    model_of,
    order_of,
    place_of,
    reset,
    weights_of,
)
from camnet.batch.estimator_learn import interrupt, lose, next_window, note_pose, refresh_prior, road_offset
from camnet.batch.estimator_model import activate, refresh, settle, step
from camnet.batch.estimator_stack import forget, learn_window, open_books
from camnet.batch.triples import Quaternion, Triple, multiply, rotate, rotate_inverse, size, turn
from camnet.estimation.concurrent_learning import switching
from camnet.estimation.learning_estimator import MAX_STEP_S
from camnet.estimation.observation import LOST_PERIODS
from camnet.estimation.projection import axis_factor
from camnet.estimation.propagate import COLUMNS, POSE_LAYER_M, UNIT
from camnet.estimation.radius import BLIND_SHARE, MARGIN, MEMORY, REMEMBERED_GAPS
from camnet.estimation.road_prior import RoadMap, steer
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


@inner_owner
def _growth(c: Rules, pose: Array, k: IntArray, d: Array) -> float:
    """Growth of the error radius while unseen, m/s."""
    j = k[MODEL]
    crossed = min(counts_of(c, k, j)[CROSSED], REMEMBERED_GAPS)
    if crossed == 0:
        return BLIND_SHARE * size(pose[TWIST], pose[TWIST + 1], pose[TWIST + 2])
    model, most = model_of(c, k, d, j), 0.0
    for i in range(crossed):
        most = max(most, model[RATES + i])
    return MARGIN * most


@inner_owner
def _radius(c: Rules, pose: Array, k: IntArray, d: Array) -> float:
    if k[REGION] < 0:
        return math.inf
    base = 3.0 * math.sqrt(model_of(c, k, d, k[MODEL])[MEAN_SQUARE])
    return float(base + _growth(c, pose, k, d) * max(0.0, pose[T] - pose[LAST_SEEN]))


@owner
def estimate(setup: EstimatorSetup, state: EstimatorState, row: int, out: Array) -> int:
    """Write what is believed now to ``out`` (16,), fields as in ``ESTIMATE``; return the region last seen in or -1.

    Before the first measurement the position is NaN and the error radius infinite.
    """
    pose, k = state.pose[row], state.flags[row]
    for i in range(3):
        out[i], out[7 + i], out[10 + i] = pose[P + i], pose[TWIST + i], pose[TWIST + 3 + i]
    for i in range(4):
        out[3 + i] = pose[Q + i]
    out[13], out[14], out[15] = k[SEEN], pose[LAST_SEEN], _radius(setup.rules, pose, k, state.data[row])
    return int(k[REGION])


# --- motion ----------------------------------------------------------------------------------------------------------


@inner_owner
def _heading(q: Quaternion) -> tuple[float, float]:
    """Direction of the body's x axis seen from above, not scaled."""
    return 1.0 - 2.0 * (q[2] * q[2] + q[3] * q[3]), 2.0 * (q[1] * q[2] + q[0] * q[3])


@inner_owner
def _moved(c: Rules, p: Triple, twist: Array, dt: float) -> Triple:
    """Position after ``dt`` at a constant velocity, projected onto the tracking bounds."""
    low, high = c.low, c.high
    return (
        p[0] + dt * twist[0] * axis_factor(p[0], twist[0], low[0], high[0], POSE_LAYER_M),
        p[1] + dt * twist[1] * axis_factor(p[1], twist[1], low[1], high[1], POSE_LAYER_M),
        p[2] + dt * twist[2] * axis_factor(p[2], twist[2], low[2], high[2], POSE_LAYER_M),
    )


@inner_owner
def _turned(q: Quaternion, twist: Array, dt: float) -> Quaternion:
    """Orientation after ``dt`` at a constant body rate."""
    a = multiply(q, turn(dt * twist[3], dt * twist[4], dt * twist[5]))
    n = math.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2] + a[3] * a[3])
    return a[0] / n, a[1] / n, a[2] / n, a[3] / n


@inner_owner
def _blend(field: Array, prior: Array, use_prior: bool, twist: Array) -> float:
    """Write the twist (6,) of the field W^T sigma (8,) and the prior; return the support u."""
    support: float = min(1.0, max(0.0, field[UNIT]))
    rest = 1.0 - support if use_prior else 0.0
    for i in range(6):
        twist[i] = field[i] + rest * prior[i]
    return support


@inner_owner
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


@inner_owner
def _field(
    kernels: Kernels,
    c: Rules,
    k: IntArray,
    d: Array,
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
    count = kernels_at(kernels, p[0], p[1], hx, hy, index, sigma, work)
    places, active = place_of(c, k, j), 0
    for m in range(count):
        place = places[index[m]]
        if place >= 0:
            index[active], sigma[active] = place, sigma[m]
            active += 1
    picked_rows(sigma, index, active, weights_of(c, k, d, j), out)


@inner_owner
def _integrate(
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
    index = np.empty(c.size + 2 * kernels.number.shape[0], dtype=np.int64)
    sigma, work, box = np.empty(c.size), workspace(kernels), (0.0, 0.0, 0.0, 0.0)
    dense = np.empty(COLUMNS * kernels.number.size if grid else 0)
    if grid:
        active, weights = counts_of(c, k, j)[ACTIVE], weights_of(c, k, d, j)
        box = dense_weights(kernels, order_of(c, k, j), active, weights, dense, index)
    field, prior, twist = np.empty(COLUMNS), pose[PRIOR:], pose[TWIST:]
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
                    field_on_grid(kernels, dense, index, box, p_at[0], p_at[1], work, field)
                else:
                    _field(kernels, c, k, d, j, p_at, q_at, index, sigma, work, field)
                support = _blend(field, prior, c.prior > 0, twist)
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


@inner_owner
def _advance(
    kernels: Kernels, roads: RoadMap, c: Rules, pose: Array, k: IntArray, d: Array, t: float
) -> None:
    """Motion without feedback up to ``t``, and the weights on their stack alone."""
    duration, j = t - pose[T], k[MODEL]
    if duration <= 0.0:
        return
    refresh_prior(c, pose, k, d)
    steps = math.ceil(duration / MAX_STEP_S)
    _integrate(kernels, roads, c, k, d, pose, duration, steps, np.empty((0, 8)))
    pose[T] = t
    nothing = np.empty(0)
    for _ in range(_due_steps(c, pose, model_of(c, k, d, j), t)):
        step(c, k, d, j, inverse_of(c, k, d, j), c.dt_s * c.gamma, k, nothing, nothing)


@inner_owner
def _due_steps(c: Rules, pose: Array, model: Array, t: float) -> int:
    """Count the nominal weight steps that have fallen due up to ``t``; they count as taken."""
    pose[OWED] += max(0.0, t - model[ADVANCED])
    model[ADVANCED] = max(t, model[ADVANCED])
    steps = int(pose[OWED] / c.dt_s + 0.5)
    pose[OWED] -= steps * c.dt_s
    return steps


@owner
def rollout(setup: EstimatorSetup, state: EstimatorState, row: int, dt_s: float, out: Array) -> None:
    """Future path if no measurement came any more: ``out`` (K, 8) takes p, q and radius at dt, 2 dt, ... from now.

    What is believed does not change. Before the first measurement positions are NaN and the radius is infinite.
    """
    pose, k, d = state.pose[row], state.flags[row], state.data[row]
    if k[REGION] < 0:
        for i in range(len(out)):
            out[i, 0], out[i, 1], out[i, 2], out[i, 7] = math.nan, math.nan, math.nan, math.inf
            out[i, 3], out[i, 4], out[i, 5], out[i, 6] = pose[Q], pose[Q + 1], pose[Q + 2], pose[Q + 3]
        return
    c = setup.rules
    refresh_prior(c, pose, k, d)
    start, rate = _radius(c, pose, k, d), _growth(c, pose, k, d)
    substeps = max(1, math.ceil(dt_s / (4.0 * MAX_STEP_S)))
    _integrate(setup.kernels, setup.roads, c, k, d, pose.copy(), dt_s, substeps, out)
    for i in range(len(out)):
        out[i, 7] = start + rate * (dt_s * (i + 1))


# --- advancing -------------------------------------------------------------------------------------------------------


@owner
def predict(setup: EstimatorSetup, state: EstimatorState, row: int, t_s: float) -> None:
    """Advance ``row`` to ``t_s`` without a measurement; nothing happens before the first one."""
    c, pose, k, d = setup.rules, state.pose[row], state.flags[row], state.data[row]
    if k[REGION] < 0 or t_s <= pose[T]:
        return
    if k[SEEN] and t_s - pose[LAST_SEEN] > LOST_PERIODS * c.dt_s:
        lose(c, pose, k, d, setup.roads)
    _advance(setup.kernels, setup.roads, c, pose, k, d, t_s)


@owner
def correct(
    setup: EstimatorSetup, state: EstimatorState, row: int, t_s: float, p: Array, q: Array, region: int
) -> None:
    """Advance ``row`` to ``t_s`` with a measured world pose p (3,), q (4,) in force; the first call initialises."""
    kernels, c = setup.kernels, setup.rules
    pose, k, d = state.pose[row], state.flags[row], state.data[row]
    j = 0 if c.models == 1 else region
    first = k[REGION] < 0
    t = t_s if first else max(t_s, pose[T])
    at, measured = np.empty(3), np.empty(4)
    for i in range(3):
        at[i] = p[i] + (t - t_s) * pose[TWIST + i]
    for i in range(4):
        measured[i] = q[i]
    known = not first and t - pose[LAST_SEEN] <= LOST_PERIODS * c.dt_s and j == k[MODEL]
    if not (first or known):
        if k[SEEN] and t - pose[LAST_SEEN] > LOST_PERIODS * c.dt_s:
            lose(c, pose, k, d, setup.roads)
        _advance(kernels, setup.roads, c, pose, k, d, t)
        _resight(c, pose, k, d, t, at)
    if not first:
        _align(measured, pose[Q:])
    if first or (not known and c.reset_on_sighting):
        for i in range(3):
            pose[P + i] = at[i]
        for i in range(4):
            pose[Q + i] = measured[i]
    k[MODEL] = j
    if not known:
        # the law ran on while the model was not in force
        model = model_of(c, k, d, j)
        settle(c, k, d, j, t - model[ADVANCED])
        model[ADVANCED], pose[OWED] = max(t, model[ADVANCED]), 0.0
    index, sigma = np.empty(c.size, dtype=np.int64), np.empty(c.size)
    count = _active_sigma(kernels, c, k, d, j, at, measured, index, sigma)
    if known:
        _correct_seen(c, pose, k, d, t, at, measured, index, sigma, count)
    k[REGION], k[SEEN], pose[LAST_SEEN], pose[T] = region, 1, t, t
    complete = note_pose(c, k, d, t, at, measured, index, sigma, count)
    for across in range(2):
        if (across == 0 and complete) or (across == 1 and k[GAP_MODEL] >= 0):
            _learn(kernels, c, pose, k, d, across)


@inner_owner
def _learn(kernels: Kernels, c: Rules, pose: Array, k: IntArray, d: Array, across: int) -> None:
    """Offer the window that is complete (``across`` 0), or those of the path across the gap (1), to their stack.

    After a change of the target's ways, what contradicts them goes first.
    """
    j, windows, before, enter = k[MODEL], 1, math.inf, True
    end = np.empty(14)
    if across:
        j, before = k[GAP_MODEL], pose[GAP]
        windows = path_windows(c, pose, k, d, end)
    rows, increments, weights = np.zeros((windows, c.size)), np.zeros((windows, COLUMNS)), np.ones(windows)
    if not across:
        enter = next_window(c, k, d, pose[T], rows[0], increments[0])
        before = model_of(c, k, d, j)[CHANGED]
    elif windows > 0 and not bridge(kernels, c, k, d, j, pose[GAP:], end, windows, rows, increments, weights):
        before = math.inf
    if not enter:
        return
    for i in range(windows if c.forgetting and math.isfinite(before) else 0):
        forget(c, k, d, j, rows[i], before)
    for i in range(windows):
        open_books(c, k, d, j)
        learn_window(c, k, d, j, pose[T], rows[i], increments[i], weights[i])
    refresh(c, k, d, j)


@inner_owner
def _align(q: Array, reference: Array) -> None:
    """Give ``q`` the sign that is closer to ``reference``."""
    if q[0] * reference[0] + q[1] * reference[1] + q[2] * reference[2] + q[3] * reference[3] < 0.0:
        for i in range(4):
            q[i] = -q[i]


@inner_owner
def _active_sigma(
    kernels: Kernels,
    c: Rules,
    k: IntArray,
    d: Array,
    j: int,
    p: Array,
    q: Array,
    index: IntArray,
    sigma: Array,
) -> int:
    """Write places and sigma of the kernels in reach of a measured pose, all of them active from now on."""
    hx, hy = _heading((q[0], q[1], q[2], q[3]))
    count = kernels_at(kernels, p[0], p[1], hx, hy, index, sigma, workspace(kernels))
    places = place_of(c, k, j)
    for m in range(count):
        place = places[index[m]]
        index[m] = place if place >= 0 else activate(c, k, d, j, index[m])
    return int(count)


@inner_owner
def _resight(c: Rules, pose: Array, k: IntArray, d: Array, t: float, p: Array) -> None:
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


@inner_owner
def _correct_seen(
    c: Rules,
    pose: Array,
    k: IntArray,
    d: Array,
    t: float,
    p: Array,
    q: Array,
    index: IntArray,
    sigma: Array,
    count: int,
) -> None:
    """In view: the model's rates at the measured pose, then the feedback, then the weights."""
    j, duration = k[MODEL], t - pose[T]
    field, error = np.empty(COLUMNS), np.empty(COLUMNS)
    picked_rows(sigma, index, count, weights_of(c, k, d, j), field)
    if c.prior > 0 and field[UNIT] < 1.0:
        refresh_prior(c, pose, k, d)
    twist, model = pose[TWIST:], model_of(c, k, d, j)
    _blend(field, pose[PRIOR:], c.prior > 0, twist)
    residual, inverse = _feedback(c, pose, twist, duration, p, q, error), inverse_of(c, k, d, j)
    model[MEAN_SQUARE] += (residual**2 - model[MEAN_SQUARE]) / MEMORY
    for i in range(_due_steps(c, pose, model, t)):
        step(c, k, d, j, inverse, c.dt_s * c.gamma, index, sigma[: count if i == 0 else 0], error)


@inner_owner
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


@inner_owner
def _turn_error(aligned: Quaternion, moved: Quaternion, error: Array) -> None:
    """Write the orientation's part of G^T eta_til to ``error`` (8,): 1/2 B^T of the quaternions' difference."""
    q = aligned
    a, b = 0.5 * (q[0] - moved[0]), 0.5 * (q[1] - moved[1])
    c, d = 0.5 * (q[2] - moved[2]), 0.5 * (q[3] - moved[3])
    error[3] = -q[1] * a + q[0] * b + q[3] * c - q[2] * d
    error[4] = -q[2] * a - q[3] * b + q[0] * c + q[1] * d
    error[5] = -q[3] * a + q[2] * b - q[1] * c + q[0] * d
    error[6], error[7] = 0.0, 0.0
