"""The monitor's arithmetic for one control period of N agents, compiled; `camnet.control.monitor` explains it.

Rows of two-row arrays are the linear (m, m/s) and the angular part (rad, rad/s).
"""

from __future__ import annotations

import math

import numpy as np

from camnet.compiled import cached_njit
from camnet.geometry.rotations_compiled import conjugate, log, multiply, rotate
from camnet.geometry.triples import borrowing
from camnet.types import Array

__all__ = [
    "advance_envelopes",
    "realised_disturbance",
    "record_end",
    "record_period",
    "record_start",
    "row_norms",
    "run_periods",
    "without_slip",
]


@cached_njit
def _norm(x: float, y: float, z: float) -> float:
    return math.sqrt(x * x + y * y + z * z)


@cached_njit
def realised_disturbance(
    p0: Array, q0: Array, p1: Array, q1: Array, u_l: Array, u_a: Array, dt: float, out: Array
) -> Array:
    """Mean disturbance of N cameras over a period, into ``out`` (N,6), and its norms (2,N).

    ``d = motion - command``: (p1 - p0)/dt - u_l, and the constant rate that turns q0 into q1 less u_a.
    """
    n = p0.shape[0]
    norms = np.empty((2, n))
    for i in range(n):
        turn = log(multiply(conjugate(q0[i]), q1[i]))
        for k in range(3):
            out[i, k] = (p1[i, k] - p0[i, k]) / dt - u_l[i, k]
            out[i, 3 + k] = turn[k] / dt - u_a[i, k]
        norms[0, i] = _norm(out[i, 0], out[i, 1], out[i, 2])
        norms[1, i] = _norm(out[i, 3], out[i, 4], out[i, 5])
    return norms


@cached_njit
def without_slip(
    d: Array,
    q0: Array,
    p_then: Array,
    q_then: Array,
    v_then: Array,
    w_then: Array,
    p_now: Array,
    q_now: Array,
    dt: float,
) -> Array:
    """Norms (2,N) of ``d`` (N,6) less what the reference moved beyond its held velocity in the period."""
    n = d.shape[0]
    norms = np.empty((2, n))
    for i in range(n):
        slip_l = (p_now[i] - p_then[i]) / dt - v_then[i]
        slip = log(multiply(conjugate(q_then[i]), q_now[i])) / dt - w_then[i]
        slip_a = rotate(multiply(conjugate(q0[i]), q_then[i]), slip)  # into the camera's frame
        norms[0, i] = _norm(d[i, 0] - slip_l[0], d[i, 1] - slip_l[1], d[i, 2] - slip_l[2])
        norms[1, i] = _norm(d[i, 3] - slip_a[0], d[i, 4] - slip_a[1], d[i, 5] - slip_a[2])
    return norms


@cached_njit
def advance_envelopes(
    a2: Array, b: Array, d: Array, d_bar: Array, layer: Array, k1: float, h: float
) -> Array:
    """Move the envelopes' parts ``a2``, ``b`` (2,N) on by a period with norms ``d`` (2,N); the bounds (2,N)."""
    bound = np.empty_like(a2)
    fade, fade2 = math.exp(-k1 * h), math.exp(-2.0 * k1 * h)
    for row in range(2):
        for i in range(a2.shape[1]):
            held = 0.5 * h * (d[row, i] + math.sqrt(3.0) * d_bar[row]) ** 2
            a2[row, i] = a2[row, i] * fade2 + 2.0 * h * (layer[row] + held)
            b[row, i] = b[row, i] * fade + h * max(d[row, i] - d_bar[row], 0.0)
            bound[row, i] = math.sqrt(a2[row, i]) + b[row, i]
    return bound


@cached_njit
def row_norms(v: Array) -> Array:
    """Norms (N,) of the rows of ``v`` (N,3)."""
    out = np.empty(v.shape[0])
    for i in range(v.shape[0]):
        out[i] = _norm(v[i, 0], v[i, 1], v[i, 2])
    return out


@cached_njit
def record_period(
    k: int,
    truth: Array,
    command: Array,
    error: Array,
    reference: Array,
    before_p: Array,
    before_q: Array,
    after_p: Array,
    after_q: Array,
    u_l: Array,
    u_a: Array,
    e_l: Array,
    e_a: Array,
    p_d: Array,
    q_d: Array,
    v_d: Array,
    w_d: Array,
) -> None:
    """Put period ``k`` into the arrays that `run_periods` judges."""
    for n in range(truth.shape[1]):
        for i in range(3):
            truth[k, n, i], truth[k, n, 7 + i] = before_p[n, i], after_p[n, i]
            command[k, n, i], command[k, n, 3 + i] = u_l[n, i], u_a[n, i]
            error[k, n, i], error[k, n, 3 + i] = e_l[n, i], e_a[n, i]
            reference[k, n, i], reference[k, n, 7 + i] = p_d[n, i], v_d[n, i]
            reference[k, n, 10 + i] = w_d[n, i]
        for i in range(4):
            truth[k, n, 3 + i], truth[k, n, 10 + i] = before_q[n, i], after_q[n, i]
            reference[k, n, 3 + i] = q_d[n, i]


@borrowing
def record_start(
    k: int,
    truth: Array,
    command: Array,
    error: Array,
    reference: Array,
    motion: Array,
    asked: Array,
    rows: Array,
) -> None:
    """Put what is known when period ``k`` begins into the arrays that `run_periods` judges.

    The rows of ``motion`` from N on are the cameras' p, q, v, w; ``asked`` (4,N,3) as of
    `camnet.control.sliding_mode_kernel`, ``rows`` (N,20) as of `camnet.control.reference_kernel.move_all`.
    """
    for n in range(truth.shape[1]):
        for i in range(7):
            truth[k, n, i] = motion[truth.shape[1] + n, i]
        for i in range(3):
            command[k, n, i], command[k, n, 3 + i] = asked[0, n, i], asked[1, n, i]
            error[k, n, i], error[k, n, 3 + i] = asked[2, n, i], asked[3, n, i]
            reference[k, n, i], reference[k, n, 7 + i] = rows[n, i], rows[n, 3 + i]
            reference[k, n, 10 + i] = rows[n, 17 + i]
        for i in range(4):
            reference[k, n, 3 + i] = rows[n, 13 + i]


@borrowing
def record_end(k: int, truth: Array, motion: Array) -> None:
    """Put the cameras at the end of period ``k`` into the arrays that `run_periods` judges."""
    for n in range(truth.shape[1]):
        for i in range(7):
            truth[k, n, 7 + i] = motion[truth.shape[1] + n, i]


@cached_njit
def run_periods(
    dt: Array,
    truth: Array,
    command: Array,
    error: Array,
    reference: Array,
    last: Array,
    a2: Array,
    b: Array,
    d_bar: Array,
    layer: Array,
    k1: float,
    tolerance: float,
    norms: Array,
) -> int:
    """Judge K periods of N cameras in their order; returns in how many an error was outside its envelope.

    Parameters
    ----------
    dt : (K,) lengths, s
    truth : (K,N,14) p0, q0, p1, q1
    command, error : (K,N,6) u_l, u_a; e_l, e_a at the start of the period
    reference : (K,N,13) p, q, v, w of the reference at the start
    last : (N,24) what the next period needs of this one: d (6), q0 (4), reference (13), dt; dt = 0: no period yet
    a2, b : (2,N) parts of the envelopes
    norms : (K,2,N) receives the norms of the realised disturbance
    """
    n = truth.shape[1]
    d, errors, outside = np.empty((n, 6)), np.empty((2, n)), 0
    for k in range(dt.shape[0]):
        t, u, e, r = truth[k], command[k], error[k], reference[k]
        errors[0], errors[1] = row_norms(e[:, :3]), row_norms(e[:, 3:])
        if last[0, 23] == 0.0:
            a2[:] = errors**2
        else:
            realised = without_slip(
                last[:, :6],
                last[:, 6:10],
                last[:, 10:13],
                last[:, 13:17],
                last[:, 17:20],
                last[:, 20:23],
                r[:, :3],
                r[:, 3:7],
                last[0, 23],
            )
            bound = advance_envelopes(a2, b, realised, d_bar, layer, k1, last[0, 23])
            outside += int(np.any(errors > bound + tolerance))
        norms[k] = realised_disturbance(
            t[:, :3], t[:, 3:7], t[:, 7:10], t[:, 10:], u[:, :3], u[:, 3:], dt[k], d
        )
        last[:, :6], last[:, 6:10], last[:, 10:23], last[:, 23] = d, t[:, 3:7], r, dt[k]
    return outside
