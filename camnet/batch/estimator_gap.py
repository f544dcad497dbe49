"""The path across a gap into the stack, in rows of arrays: compiled twin of `camnet.estimation.gap`, its oracle.

Ends are arrays (14,): t, p, q, v (world), w (body).
"""

from __future__ import annotations

import math

from camnet.batch.compiled import inner
from camnet.batch.estimator_columns import GAP, GAP_ENTRY, GAP_MODEL, GAPS_LEARNED, GATE, T
from camnet.batch.estimator_field import Kernels, kernels_at
from camnet.batch.estimator_learn import fit_held, misfit
from camnet.batch.estimator_model import activate
from camnet.batch.estimator_parts import model_of, place_of
from camnet.batch.estimator_setup import Rules
from camnet.batch.triples import cross, turn
from camnet.estimation.gap import SUBSTEPS
from camnet.estimation.learner import KNOWN_WITHIN
from camnet.estimation.propagate import UNIT
from camnet.geometry.triples import Triple, log, multiply, size
from camnet.types import Array, IntArray

__all__ = ["bridge", "path_windows"]


@inner
def _whole_turn(exit_: Array, entry: Array) -> Triple:
    """Rotation vector from exit to entry, with the number of full turns that the body rates suggest."""
    back = (exit_[4], -exit_[5], -exit_[6], -exit_[7])
    theta = log(multiply(back, (entry[4], entry[5], entry[6], entry[7])))
    half = 0.5 * (entry[0] - exit_[0])
    expected = (
        half * (exit_[11] + entry[11]),
        half * (exit_[12] + entry[12]),
        half * (exit_[13] + entry[13]),
    )
    angle, spin = size(theta[0], theta[1], theta[2]), size(expected[0], expected[1], expected[2])
    if angle > 1e-9:
        axis = (theta[0] / angle, theta[1] / angle, theta[2] / angle)
    elif spin > 1e-9:
        axis = (expected[0] / spin, expected[1] / spin, expected[2] / spin)
    else:
        return theta
    along = expected[0] * axis[0] + expected[1] * axis[1] + expected[2] * axis[2]
    whole = angle + 2.0 * math.pi * round((along - angle) / (2.0 * math.pi))
    return whole * axis[0], whole * axis[1], whole * axis[2]


@inner
def _rotation_vector_rate(theta: Triple, w: Triple) -> Triple:
    """Rate of the rotation vector ``theta`` whose body rate is ``w``: the inverse right Jacobian."""
    angle = size(theta[0], theta[1], theta[2])
    x = cross(theta, w)
    if angle < 1e-4:
        return w[0] + 0.5 * x[0], w[1] + 0.5 * x[1], w[2] + 0.5 * x[2]
    half = 0.5 * angle
    sine = math.sin(half)
    if abs(sine) < 1e-3:
        return w
    f = (1.0 - half * math.cos(half) / sine) / angle**2
    y = cross(theta, x)
    return w[0] + 0.5 * x[0] + f * y[0], w[1] + 0.5 * x[1] + f * y[1], w[2] + 0.5 * x[2] + f * y[2]


@inner
def _hermite(u: float, x0: float, d0: float, x1: float, d1: float) -> float:
    """Cubic through x0, x1 with the derivatives d0, d1 in [0, 1]."""
    v = (1.0 - u) ** 2
    return (1.0 + 2.0 * u) * v * x0 + u * v * d0 + u**2 * (3.0 - 2.0 * u) * x1 + u**2 * (u - 1.0) * d1


@inner
def _trace(exit_: Array, entry: Array, points: int, out: Array) -> None:
    """Write positions and orientations (points, 7) across the gap."""
    duration = entry[0] - exit_[0]
    theta = _whole_turn(exit_, entry)
    rate = _rotation_vector_rate(theta, (entry[11], entry[12], entry[13]))
    q0 = (exit_[4], exit_[5], exit_[6], exit_[7])
    w0, w1 = (exit_[11], exit_[12], exit_[13]), rate
    for i in range(points):
        u = i / (points - 1)
        for a in range(3):
            out[i, a] = _hermite(
                u, exit_[1 + a], duration * exit_[8 + a], entry[1 + a], duration * entry[8 + a]
            )
        x = _hermite(u, 0.0, duration * w0[0], theta[0], duration * w1[0])
        y = _hermite(u, 0.0, duration * w0[1], theta[1], duration * w1[1])
        z = _hermite(u, 0.0, duration * w0[2], theta[2], duration * w1[2])
        q = multiply(q0, turn(x, y, z))
        dot = 1.0
        if i > 0:
            dot = out[i - 1, 3] * q[0] + out[i - 1, 4] * q[1] + out[i - 1, 5] * q[2] + out[i - 1, 6] * q[3]
        sign = -1.0 if dot < 0.0 else 1.0
        for a in range(4):
            out[i, 3 + a] = sign * q[a]


@inner
def _path_psd(c: Rules, exit_: Array, entry: Array) -> float:
    """Power spectral density of the unknown acceleration, raised to what the ends contradict."""
    duration = entry[0] - exit_[0]
    against = 0.0
    for a in range(3):
        against += (entry[1 + a] - exit_[1 + a] - 0.5 * duration * (exit_[8 + a] + entry[8 + a])) ** 2
    return float(max(c.accel_psd_m2ps3, 12.0 * against / (3.0 * duration**3)))


@inner
def _add_regressor(
    kernels: Kernels, c: Rules, k: IntArray, d: Array, j: int, pose: Array, share: float, row: Array
) -> None:
    """Add ``share`` sigma at a pose (7,) to ``row``; kernels reached become active."""
    index, sigma = c.work.places, c.work.sigma
    x, y = 1.0 - 2.0 * (pose[5] ** 2 + pose[6] ** 2), 2.0 * (pose[4] * pose[5] + pose[3] * pose[6])
    count = kernels_at(kernels, pose[0], pose[1], x, y, index, sigma, c.work.factors)
    places = place_of(c, k, j)
    for m in range(count):
        place = places[index[m]]
        if place < 0:
            place = activate(c, k, d, j, index[m])
        row[place] += share * sigma[m]


@inner
def _increment(a: Array, b: Array, duration: float, out: Array) -> None:
    """Write the increment (8,) from pose ``a`` to pose ``b``, both (7,)."""
    for i in range(3):
        out[i] = b[i] - a[i]
    out[3], out[4], out[5] = log(multiply((a[3], -a[4], -a[5], -a[6]), (b[3], b[4], b[5], b[6])))
    out[6], out[UNIT] = 0.0, duration


@inner
def _contradicts(
    c: Rules, k: IntArray, d: Array, j: int, row: Array, increment: Array, weight: float
) -> bool:
    """Whether a window of the path is suspect, given the path's own uncertainty."""
    residual = c.work.residual
    misfit(c, k, d, j, row, increment, residual)
    duration, mean_square = increment[UNIT], model_of(c, k, d, j)[GATE]
    if abs(residual[UNIT]) > KNOWN_WITHIN * duration or not math.isfinite(mean_square):
        return False
    variance = 3.0 * c.path_std_mps**2 * (1.0 / weight - 1.0) + mean_square
    square = residual[0] ** 2 + residual[1] ** 2 + residual[2] ** 2
    return bool(square > (0.5 * c.outlier_gate) ** 2 * variance * duration**2)


@inner
def path_windows(c: Rules, pose: Array, k: IntArray, d: Array, entry: Array) -> int:
    """Count the windows of the gap that waits, if the re-sighting has lasted long enough; ``entry`` takes its end."""
    k_gap = k[GAP_MODEL]
    if k_gap < 0 or pose[T] - pose[GAP_ENTRY] < c.entry_s:
        return 0
    k[GAP_MODEL] = -1
    entry[0] = pose[GAP_ENTRY]
    if not fit_held(c, k, d, entry[0], entry[1:]):
        return 0
    duration = entry[0] - pose[GAP]
    windows = round(duration / c.window_s)
    return 0 if duration > c.max_gap_s else windows


@inner
def bridge(
    kernels: Kernels,
    c: Rules,
    k: IntArray,
    d: Array,
    j: int,
    exit_: Array,
    entry: Array,
    windows: int,
    rows: Array,
    increments: Array,
    weights: Array,
) -> bool:
    """Write the windows of the path across the gap, for model ``j``; True if most contradict what was learned there."""
    duration = entry[0] - exit_[0]
    path = c.work.path
    _trace(exit_, entry, windows * SUBSTEPS + 1, path)
    psd, h = _path_psd(c, exit_, entry), duration / (windows * SUBSTEPS)
    against = 0
    for i in range(windows):
        first = i * SUBSTEPS
        for m in range(SUBSTEPS + 1):
            share = 0.5 * h if m == 0 or m == SUBSTEPS else h
            _add_regressor(kernels, c, k, d, j, path[first + m], share, rows[i])
        u = (first + 0.5 * SUBSTEPS) / (windows * SUBSTEPS)
        x = u * (1.0 - u)
        variance = psd * duration * x * (1.0 - 3.0 * x)
        weights[i] = c.path_std_mps**2 / (c.path_std_mps**2 + variance)
        _increment(path[first], path[first + SUBSTEPS], h * SUBSTEPS, increments[i])
        if _contradicts(c, k, d, j, rows[i], increments[i], weights[i]):
            against += 1
    k[GAPS_LEARNED] += 1
    return bool(2 * against > windows)
