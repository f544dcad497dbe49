"""From measured poses to entries of the stacks, in rows of arrays: history, windows, outlier gate.

Compiled twin of `camnet.estimation.learner`, `camnet.estimation.windows` and `camnet.estimation.gap.PoseHistory`,
which are its oracles. The velocity fitted to the latest poses is only needed where it is used, so that a pose is noted
with its fit due.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from camnet.batch.estimator_layout import (
    ACTIVE,
    AGREED,
    CHANGED,
    EXIT,
    FAR_RUN,
    FILLED,
    FIT_DUE,
    GAP_MODEL,
    GATE,
    HAS_EXIT,
    HELD,
    MODEL,
    OUTLIERS,
    PRIOR,
    RUN_BEGAN,
    SUSPECT_RUN,
    TURNS,
    EstimatorSetup,
    EstimatorState,
)
from camnet.batch.estimator_model import forget, learn_window
from camnet.batch.triples import multiply, rotate, rotation_vector, turn
from camnet.estimation.learner import (
    CHANGE_AFTER,
    KNOWN_WITHIN,
    RESIDUAL_FLOOR,
    RESIDUAL_SHARE,
    SUSPECT_AFTER,
    SUSPECT_COUNTS,
)
from camnet.estimation.propagate import COLUMNS, UNIT
from camnet.types import Array, IntArray

__all__ = ["fit_motion", "interrupt", "learn_pose", "misfit", "refresh_prior"]


@njit(cache=True, nogil=True)
def fit_motion(history: Array, n: int, t_eval: float, out: Array) -> None:
    """Write pose (p, q) and velocity (v, w) at ``t_eval`` to ``out`` (13,): `camnet.estimation.gap.fit_motion`."""
    t_mid = 0.0
    for i in range(n):
        t_mid += history[i, 0]
    t_mid /= n
    m = n // 2
    ref = (history[m, 4], -history[m, 5], -history[m, 6], -history[m, 7])
    variance, px, py, pz, vx, vy, vz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    ax, ay, az, wx, wy, wz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(n):
        late = history[i, 0] - t_mid
        variance += late * late
        x, y, z = history[i, 1], history[i, 2], history[i, 3]
        px, py, pz = px + x, py + y, pz + z
        vx, vy, vz = vx + late * x, vy + late * y, vz + late * z
        a, b, c = rotation_vector(multiply(ref, (history[i, 4], history[i, 5], history[i, 6], history[i, 7])))
        ax, ay, az = ax + a, ay + b, az + c
        wx, wy, wz = wx + late * a, wy + late * b, wz + late * c
    v = (vx / variance, vy / variance, vz / variance)
    w = (wx / variance, wy / variance, wz / variance)
    q_mid = multiply((ref[0], -ref[1], -ref[2], -ref[3]), turn(ax / n, ay / n, az / n))
    late = t_eval - t_mid
    arc = 0.5 * (late * late - variance / n)
    u = rotate(q_mid, w)
    late_turn = (late * w[0], late * w[1], late * w[2])
    out[0] = px / n + late * v[0] + arc * (u[1] * v[2] - u[2] * v[1])
    out[1] = py / n + late * v[1] + arc * (u[2] * v[0] - u[0] * v[2])
    out[2] = pz / n + late * v[2] + arc * (u[0] * v[1] - u[1] * v[0])
    q = multiply(q_mid, turn(late_turn[0], late_turn[1], late_turn[2]))
    out[3], out[4], out[5], out[6] = q
    about = rotate(q_mid, late_turn)
    out[7], out[8], out[9] = rotate(turn(about[0], about[1], about[2]), v)
    out[10], out[11], out[12] = w


@njit(cache=True, nogil=True)
def refresh_prior(s: EstimatorState, r: int) -> None:
    """Fit the present motion if that is due, and make it the prior mean."""
    flags = s.flags[r]
    if not flags[FIT_DUE]:
        return
    flags[FIT_DUE] = 0
    history, n = s.history[r], flags[HELD]
    if n < 3 or not history[n - 1, 0] > history[0, 0]:
        return
    out = np.empty(13)
    fit_motion(history, n, history[n - 1, 0], out)
    for i in range(6):
        s.pose[r, PRIOR + i] = out[7 + i]


@njit(cache=True, nogil=True)
def interrupt(s: EstimatorState, r: int, last_seen_s: float) -> None:
    """End the sighting; how the target left goes to EXIT, HAS_EXIT says whether that can be told."""
    refresh_prior(s, r)
    flags, history = s.flags[r], s.history[r]
    n = flags[HELD]
    flags[HAS_EXIT] = 0
    if n >= 3 and history[n - 1, 0] > history[0, 0]:
        s.pose[r, EXIT] = last_seen_s
        fit_motion(history, n, last_seen_s, s.pose[r, EXIT + 1 : EXIT + 14])
        flags[HAS_EXIT] = 1
    flags[FILLED], flags[HELD], flags[GAP_MODEL] = 0, 0, -1


@njit(cache=True, nogil=True)
def _note_pose(row: Array, t_s: float, p: Array, q: Array, sign: float) -> None:
    row[0] = t_s
    for i in range(3):
        row[1 + i] = p[i]
    for i in range(4):
        row[4 + i] = sign * q[i]


@njit(cache=True, nogil=True)
def learn_pose(
    c: EstimatorSetup,
    s: EstimatorState,
    r: int,
    t_s: float,
    p: Array,
    q: Array,
    index: IntArray,
    sigma: Array,
    count: int,
) -> None:
    """Take a measured pose and its sigma (at the active kernels in ``index``) into history and window."""
    flags, history = s.flags[r], s.history[r]
    held, capacity = flags[HELD], s.history.shape[1]
    if held == capacity:
        for i in range(capacity - 1):
            for k in range(8):
                history[i, k] = history[i + 1, k]
        held -= 1
    _note_pose(history[held], t_s, p, q, 1.0)
    flags[HELD] = held + 1
    flags[FIT_DUE] |= 3 * (held + 1) >= capacity
    _push_sample(c, s, r, t_s, p, q, index, sigma, count)


@njit(cache=True, nogil=True)
def _push_sample(
    c: EstimatorSetup,
    s: EstimatorState,
    r: int,
    t_s: float,
    p: Array,
    q: Array,
    index: IntArray,
    sigma: Array,
    count: int,
) -> None:
    """Add a sample to the window; learn the window when it is complete."""
    flags, samples, sigmas = s.flags[r], s.samples[r], s.sigma[r]
    j = flags[MODEL]
    n, filled = s.counts[r, j, ACTIVE], flags[FILLED]
    sign = 1.0
    if filled > 0:
        last = samples[filled - 1]
        if q[0] * last[4] + q[1] * last[5] + q[2] * last[6] + q[3] * last[7] < 0.0:
            sign = -1.0
    _note_pose(samples[filled], t_s, p, q, sign)
    for a in range(n):
        sigmas[filled, a] = 0.0
    for m in range(count):
        sigmas[filled, index[m]] = sigma[m]
    filled += 1
    if filled == c.intervals + c.average:
        row, increment = np.zeros(n), np.zeros(COLUMNS)
        _close_window(c, samples, sigmas, row, increment)
        for i in range(c.average):
            samples[i] = samples[c.intervals + i]
            for a in range(n):
                sigmas[i, a] = sigmas[c.intervals + i, a]
        filled = c.average
        _learn_measured(c, s, r, j, t_s, row, increment)
    flags[FILLED] = filled


@njit(cache=True, nogil=True)
def _close_window(c: EstimatorSetup, samples: Array, sigmas: Array, row: Array, increment: Array) -> None:
    """Write regressor (n,) and increment (8,) of the window: the mean of ``average`` shifted ones."""
    n, m = c.intervals, c.average
    weights = np.zeros(n + m)
    for shift in range(m):
        for i in range(shift, shift + n):
            half = 0.5 * (samples[i + 1, 0] - samples[i, 0]) / m
            weights[i] += half
            weights[i + 1] += half
    for i in range(n + m):
        for a in range(len(row)):
            row[a] += weights[i] * sigmas[i, a]
    first, last = np.zeros(8), np.zeros(8)
    for i in range(m):
        for k in range(8):
            first[k] += samples[i, k] / m
            last[k] += samples[n + i, k] / m
    size0 = math.sqrt(first[4] ** 2 + first[5] ** 2 + first[6] ** 2 + first[7] ** 2)
    size1 = math.sqrt(last[4] ** 2 + last[5] ** 2 + last[6] ** 2 + last[7] ** 2)
    q0 = (first[4] / size0, -first[5] / size0, -first[6] / size0, -first[7] / size0)
    q1 = (last[4] / size1, last[5] / size1, last[6] / size1, last[7] / size1)
    for i in range(3):
        increment[i] = last[1 + i] - first[1 + i]
    increment[3], increment[4], increment[5] = rotation_vector(multiply(q0, q1))
    increment[UNIT] = last[0] - first[0]


@njit(cache=True, nogil=True)
def misfit(s: EstimatorState, r: int, j: int, row: Array, increment: Array, out: Array) -> None:
    """Write increment - Y W (8,) to ``out``; ``row`` over the active kernels."""
    weights = s.weights[r, j]
    for o in range(COLUMNS):
        out[o] = increment[o]
    for a in range(min(len(row), s.counts[r, j, ACTIVE])):
        if row[a] != 0.0:
            for o in range(COLUMNS):
                out[o] -= row[a] * weights[a, o]


@njit(cache=True, nogil=True)
def _learn_measured(
    c: EstimatorSetup, s: EstimatorState, r: int, j: int, t_s: float, row: Array, increment: Array
) -> None:
    """Offer a measured window if the gate lets it; after a change, what it contradicts goes first."""
    if not _passes(c, s, r, j, t_s, row, increment):
        return
    if c.forgetting and math.isfinite(s.model[r, j, CHANGED]):
        forget(c, s, r, j, row, s.model[r, j, CHANGED])
    learn_window(c, s, r, j, t_s, row, increment, 1.0)


@njit(cache=True, nogil=True)
def _passes(
    c: EstimatorSetup, s: EstimatorState, r: int, j: int, t_s: float, row: Array, increment: Array
) -> bool:
    """Whether the outlier gate lets a window in: `camnet.estimation.learner.OutlierGate`."""
    model = s.model[r, j]
    residual = np.empty(COLUMNS)
    misfit(s, r, j, row, increment, residual)
    duration = increment[UNIT]
    if abs(residual[UNIT]) > KNOWN_WITHIN * duration:
        return True
    shift, rotation = 0.0, 0.0
    for i in range(3):
        shift += residual[i] ** 2
    for i in range(3, 7):
        rotation += residual[i] ** 2
    new = (shift / duration**2, rotation / duration**2)
    if not (math.isfinite(model[GATE]) and math.isfinite(model[GATE + 1])):
        model[GATE], model[GATE + 1] = new
        return True
    far, suspect = False, False
    for i in range(2):
        far |= new[i] > c.outlier_gate**2 * model[GATE + i] + RESIDUAL_FLOOR
        suspect |= new[i] > (0.5 * c.outlier_gate) ** 2 * model[GATE + i] + RESIDUAL_FLOOR
    suspect |= far
    if not far:
        for i in range(2):
            counted = min(new[i], SUSPECT_COUNTS * model[GATE + i]) if suspect else new[i]
            model[GATE + i] += RESIDUAL_SHARE * (counted - model[GATE + i])
    return _judge(s, r, j, far, suspect, t_s)


@njit(cache=True, nogil=True)
def _judge(s: EstimatorState, r: int, j: int, far: bool, suspect: bool, t_s: float) -> bool:
    model, counts = s.model[r, j], s.counts[r, j]
    if suspect and counts[SUSPECT_RUN] == 0:
        model[RUN_BEGAN] = t_s
    counts[SUSPECT_RUN] = counts[SUSPECT_RUN] + 1 if suspect else 0
    counts[FAR_RUN] = counts[FAR_RUN] + 1 if far else 0
    counts[AGREED] = 0 if suspect else counts[AGREED] + 1
    if counts[AGREED] >= CHANGE_AFTER:
        model[CHANGED] = math.inf
    if math.isfinite(model[CHANGED]):
        return True
    if counts[FAR_RUN] > CHANGE_AFTER or counts[SUSPECT_RUN] > SUSPECT_AFTER:
        counts[TURNS] += 1
        model[CHANGED] = model[RUN_BEGAN]
        return True
    counts[OUTLIERS] += far
    return not far
