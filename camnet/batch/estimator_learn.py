"""From measured poses to entries of the stacks, in rows of arrays: history, windows, outlier gate.

Compiled twin of `camnet.estimation.learner`, `camnet.estimation.windows` and `camnet.estimation.gap.PoseHistory`,
which are its oracles. The velocity fitted to the latest poses is only needed where it is used, so that a pose is noted
with its fit due.
"""

from __future__ import annotations

import math

from camnet.batch.compiled import inner
from camnet.batch.estimator_columns import (
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
    LAST_SEEN,
    MODEL,
    OFFSET,
    OUTLIERS,
    PRIOR,
    RUN_BEGAN,
    SEEN,
    SUSPECT_RUN,
    TURNS,
    P,
)
from camnet.batch.estimator_parts import counts_of, model_of, sigma_of, weights_of
from camnet.batch.estimator_setup import Rules
from camnet.batch.triples import turn
from camnet.estimation.learner import (
    CHANGE_AFTER,
    KNOWN_WITHIN,
    RESIDUAL_FLOOR,
    RESIDUAL_SHARE,
    SUSPECT_AFTER,
    SUSPECT_COUNTS,
)
from camnet.estimation.propagate import COLUMNS, UNIT
from camnet.estimation.road_prior import RoadMap, offset_of
from camnet.geometry.triples import log, multiply, rotate
from camnet.types import Array, IntArray

__all__ = [
    "fit_held",
    "fit_motion",
    "interrupt",
    "lose",
    "misfit",
    "next_window",
    "note_pose",
    "refresh_prior",
    "road_offset",
]


@inner
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
        a, b, c = log(multiply(ref, (history[i, 4], history[i, 5], history[i, 6], history[i, 7])))
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


@inner
def fit_held(c: Rules, k: IntArray, d: Array, t_eval: float, out: Array) -> bool:
    """Fit the poses held; False if they are too few, or all of one instant."""
    n = k[HELD]
    if n < 3 or not d[8 * (n - 1)] > d[0]:
        return False
    fit_motion(d[: 8 * n].reshape((n, 8)), n, t_eval, out)
    return True


@inner
def refresh_prior(c: Rules, pose: Array, k: IntArray, d: Array) -> None:
    """Fit the present motion if that is due, and make it the prior mean."""
    if not k[FIT_DUE]:
        return
    k[FIT_DUE] = 0
    out = c.work.fit
    if fit_held(c, k, d, d[8 * (k[HELD] - 1)], out):
        for i in range(6):
            pose[PRIOR + i] = out[7 + i]


@inner
def road_offset(pose: Array, k: IntArray, roads: RoadMap) -> float:
    """How far left of its way on the road the target is, or was when last seen."""
    if not k[SEEN]:
        return float(pose[OFFSET])
    return float(offset_of(pose[P], pose[P + 1], pose[PRIOR], pose[PRIOR + 1], roads))


@inner
def lose(c: Rules, pose: Array, k: IntArray, d: Array, roads: RoadMap) -> None:
    """Note that the target has become unseen, and how it left."""
    interrupt(c, pose, k, d, pose[LAST_SEEN])
    pose[OFFSET] = road_offset(pose, k, roads)
    k[SEEN] = 0


@inner
def interrupt(c: Rules, pose: Array, k: IntArray, d: Array, last_seen_s: float) -> None:
    """End the sighting; how the target left goes to EXIT, HAS_EXIT says whether that can be told."""
    refresh_prior(c, pose, k, d)
    pose[EXIT] = last_seen_s
    k[HAS_EXIT] = fit_held(c, k, d, last_seen_s, pose[EXIT + 1 :])
    k[FILLED], k[HELD], k[GAP_MODEL] = 0, 0, -1


@inner
def _note(d: Array, first: int, t_s: float, p: Array, q: Array, sign: float) -> None:
    d[first] = t_s
    for i in range(3):
        d[first + 1 + i] = p[i]
    for i in range(4):
        d[first + 4 + i] = sign * q[i]


@inner
def note_pose(
    c: Rules,
    k: IntArray,
    d: Array,
    t_s: float,
    p: Array,
    q: Array,
    index: IntArray,
    sigma: Array,
    count: int,
) -> bool:
    """Take a measured pose and its sigma (at the active kernels in ``index``) into history and window.

    True if that completes the window.
    """
    held, capacity = k[HELD], c.regression_samples
    if held == capacity:
        for i in range(8 * (capacity - 1)):
            d[i] = d[i + 8]
        held -= 1
    _note(d, 8 * held, t_s, p, q, 1.0)
    k[HELD] = held + 1
    if 3 * (held + 1) >= capacity:
        k[FIT_DUE] = 1
    filled, first = k[FILLED], c.at.samples + 8 * k[FILLED]
    sign, last = 1.0, first - 8
    if filled > 0 and q[0] * d[last + 4] + q[1] * d[last + 5] + q[2] * d[last + 6] + q[3] * d[last + 7] < 0.0:
        sign = -1.0
    _note(d, first, t_s, p, q, sign)
    row = sigma_of(c, d, filled)
    for a in range(counts_of(c, k, k[MODEL])[ACTIVE]):
        row[a] = 0.0
    for m in range(count):
        row[index[m]] = sigma[m]
    k[FILLED] = filled + 1
    return bool(filled + 1 == c.intervals + c.average)


@inner
def next_window(c: Rules, k: IntArray, d: Array, t_s: float, row: Array, increment: Array) -> bool:
    """Write the complete window to ``row`` and ``increment``; the next begins with its last samples.

    True if the outlier gate lets it enter.
    """
    j = k[MODEL]
    n = counts_of(c, k, j)[ACTIVE]
    _close_window(c, d, row[:n], increment)
    for i in range(c.average):
        for a in range(8):
            d[c.at.samples + 8 * i + a] = d[c.at.samples + 8 * (c.intervals + i) + a]
        old, new = sigma_of(c, d, c.intervals + i), sigma_of(c, d, i)
        for a in range(n):
            new[a] = old[a]
    k[FILLED] = c.average
    return bool(_passes(c, k, d, j, t_s, row, increment))


@inner
def _close_window(c: Rules, d: Array, row: Array, increment: Array) -> None:
    """Write regressor (n,) and increment (8,) of the window: the mean of ``average`` shifted ones."""
    n, m = c.intervals, c.average
    samples = d[c.at.samples :]
    weights, first, last = c.work.samples, c.work.first, c.work.last
    for i in range(n + m):
        weights[i] = 0.0
    for a in range(8):
        first[a] = 0.0
        last[a] = 0.0
    for shift in range(m):
        for i in range(shift, shift + n):
            half = 0.5 * (samples[8 * (i + 1)] - samples[8 * i]) / m
            weights[i] += half
            weights[i + 1] += half
    for i in range(n + m):
        sigma = sigma_of(c, d, i)
        for a in range(len(row)):
            row[a] += weights[i] * sigma[a]
    for i in range(m):
        for a in range(8):
            first[a] += samples[8 * i + a] / m
            last[a] += samples[8 * (n + i) + a] / m
    for i in range(3):
        increment[i] = last[1 + i] - first[1 + i]
    s0 = 1.0 / math.sqrt(first[4] ** 2 + first[5] ** 2 + first[6] ** 2 + first[7] ** 2)
    s1 = 1.0 / math.sqrt(last[4] ** 2 + last[5] ** 2 + last[6] ** 2 + last[7] ** 2)
    back = (s0 * first[4], -s0 * first[5], -s0 * first[6], -s0 * first[7])
    turned = log(multiply(back, (s1 * last[4], s1 * last[5], s1 * last[6], s1 * last[7])))
    increment[3], increment[4], increment[5] = turned
    increment[UNIT] = last[0] - first[0]


@inner
def misfit(c: Rules, k: IntArray, d: Array, j: int, row: Array, increment: Array, out: Array) -> None:
    """Write increment - Y W (8,) to ``out``; ``row`` over the active kernels."""
    weights = weights_of(c, k, d, j)
    for o in range(COLUMNS):
        out[o] = increment[o]
    for a in range(counts_of(c, k, j)[ACTIVE]):
        if row[a] != 0.0:
            for o in range(COLUMNS):
                out[o] -= row[a] * weights[COLUMNS * a + o]


@inner
def _passes(c: Rules, k: IntArray, d: Array, j: int, t_s: float, row: Array, increment: Array) -> bool:
    """Whether the outlier gate lets a window in: `camnet.estimation.learner.OutlierGate`."""
    model = model_of(c, k, d, j)
    residual = c.work.residual
    misfit(c, k, d, j, row, increment, residual)
    duration = increment[UNIT]
    if abs(residual[UNIT]) > KNOWN_WITHIN * duration:
        return True
    new = (
        (residual[0] ** 2 + residual[1] ** 2 + residual[2] ** 2) / duration**2,
        (residual[3] ** 2 + residual[4] ** 2 + residual[5] ** 2 + residual[6] ** 2) / duration**2,
    )
    if not (math.isfinite(model[GATE]) and math.isfinite(model[GATE + 1])):
        model[GATE], model[GATE + 1] = new
        return True
    far, suspect = False, False
    for i in range(2):
        far = far or new[i] > c.outlier_gate**2 * model[GATE + i] + RESIDUAL_FLOOR
        suspect = suspect or new[i] > (0.5 * c.outlier_gate) ** 2 * model[GATE + i] + RESIDUAL_FLOOR
    suspect = suspect or far
    if not far:
        for i in range(2):
            counted = min(new[i], SUSPECT_COUNTS * model[GATE + i]) if suspect else new[i]
            model[GATE + i] += RESIDUAL_SHARE * (counted - model[GATE + i])
    return bool(_judge(model, counts_of(c, k, j), far, suspect, t_s))


@inner
def _judge(model: Array, counts: IntArray, far: bool, suspect: bool, t_s: float) -> bool:
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
    if far:
        counts[OUTLIERS] += 1
    return not far
