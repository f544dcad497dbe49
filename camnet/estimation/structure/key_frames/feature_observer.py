"""Observer and predictor of the distances of one key frame's features (bell2019, section 4.2), compiled.

| symbol | name | shape | unit | equation |
| --- | --- | --- | --- | --- |
| ``th = [d_{i/c}; d_{k/c}; d_{i/k}]`` | ``th`` | (T, N, 3) | m | state of feature i, kept within known bounds |
| ``Om_i`` | ``way_m`` | (T, N, 2) | m | its integral since the key frame was taken |
| ``psi_i`` | ``psi`` | (T, N, 2) | - | `geometry.distance_ratios` |
| ``xi``, ``rho`` | ``flow_power``, ``flow_drive`` | (T, N) | 1/s^2, m/s^2 | ``xi^T xi``, ``xi^T rho``, filtered |
| ``ups`` | ``ups`` | (T, N, 2) | - | `geometry.range_row` |
| ``y``, ``U`` | | | -, m | change of psi and of the integral of Om over a window |
| ``X_i`` | | (N,) | m | ``sum y^T U / sum y^T y`` once the denominator exceeds lambda |

Tracked, with ``Yx = [xi 0 0; 0 xi ups]``, ``YX = [M_i 0; 0 0 1]``:
``th' = [Om; 0] + K (Yx^T ux - Yx^T Yx th) [+ K_X (YX^T uX - YX^T YX th) once learned]``. Each frame is one implicit
step, ``(I + dt A) th+ = th + int Om + dt b``, stable for any gain. Out of view: the point moves rigidly with the
measured velocities, which is what ``u_hat'`` and ``th_hat'`` of the predictor integrate to.

Gates. A corner is lost for good where its shift, less the shift predicted with the estimated distance, is
away from the mean of all by more than chi-square allows. A sample is refused where the distance that it implies, or
the learned one, puts the corner too far from where it is seen, by the expected pose of the key frame.
The clock of the dwell time runs for a feature while the motion is informative for it and its distance is learned.
A full stack gives up its weakest sample for a stronger one.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from camnet.compiled import cached_njit
from camnet.types import Array, BoolArray, IntArray

__all__ = ["ObserverGains", "Track", "observe"]


class ObserverGains(NamedTuple):
    """Numbers of `KeyFrameSettings`."""

    k: float
    k_x: float
    lambda_a: float
    window_s: float
    stack_size: int
    stack_lambda: float
    least_y: float
    least_u_m: float
    low_m: float
    high_m: float
    gate_px2: float
    start_m: float
    focal_px: float


class Track(NamedTuple):
    """What is measured of one key frame at T images; the first is the key frame. See the module's table.

    ``move_r``, ``move_p`` carry a stationary point from the image before; ``r_0``, ``p_0`` (expected pose of the key
    frame) and ``r_kc``, ``u_kc`` (its estimated rotation and direction) are in the camera frame.
    """

    t_s: Array
    u_ik: Array
    u_ic: Array
    seen: BoolArray
    move_r: Array
    move_p: Array
    r_0: Array
    p_0: Array
    r_kc: Array
    u_kc: Array
    psi: Array
    informative: BoolArray
    way_m: Array
    flow_power: Array
    flow_drive: Array
    ups: Array


@cached_njit
def observe(g: ObserverGains, x: Track) -> tuple[Array, BoolArray, Array, Array]:
    """Run the observer over the life of a key frame.

    Returns
    -------
    th : (T, N, 3) distances, m
    alive : (T, N) features that are seen and passed the first gate
    on_s : (T, N) accumulated dwell time, s
    learned : (T, N) the learned distance X, m; NaN before
    """
    images, count = x.psi.shape[0], x.psi.shape[1]
    th, on = np.empty((images, count, 3)), np.zeros((images, count))
    learned, alive = np.full((images, count), np.nan), x.seen.copy()
    stack, held = np.zeros((count, g.stack_size, 2)), np.zeros(count, dtype=np.int64)
    sums, begun = np.zeros((count, 2)), np.full(count, -1)
    state, point = np.empty((count, 3)), np.empty((count, 3))
    for i in range(count):
        state[i, 0], state[i, 1], state[i, 2] = g.start_m, 0.0, g.start_m
        point[i] = g.start_m * x.u_ik[i]
    th[0] = state
    for t in range(1, images):
        dt = x.t_s[t] - x.t_s[t - 1]
        for i in range(count):
            point[i] = _moved(x.move_r[t], x.move_p[t], point[i])
        _lose(g, x.u_ic[t], point, alive, t)
        for i in range(count):
            on[t, i] = on[t - 1, i]
            if not alive[t, i]:
                begun[i] = -1
                state[i, 0] = np.sqrt(np.sum(point[i] ** 2))
                state[i, 1] += x.way_m[t, i, 1] - x.way_m[t - 1, i, 1]
            else:
                informative = x.informative[t, i]
                if not informative:
                    begun[i] = -1
                elif begun[i] < 0:
                    begun[i] = t
                else:
                    _sample(g, x, t, i, begun[i], stack, held, sums)
                if sums[i, 0] > g.stack_lambda:
                    learned[t, i] = sums[i, 1] / sums[i, 0]
                    if informative:
                        on[t, i] += dt
                _step(g, x, t, i, dt, learned[t, i], state[i])
                point[i] = state[i, 0] * x.u_ic[t, i]
            if np.isnan(learned[t, i]):
                learned[t, i] = learned[t - 1, i]
        th[t] = state
    return th, alive, on, learned


@cached_njit
def _moved(r: Array, p: Array, point: Array) -> Array:
    out = np.empty(3)
    for j in range(3):
        out[j] = r[j, 0] * point[0] + r[j, 1] * point[1] + r[j, 2] * point[2] + p[j]
    return out


@cached_njit
def _lose(g: ObserverGains, u_ic: Array, point: Array, alive: BoolArray, t: int) -> None:
    """First gate: corners whose shift is not that of the others are lost for good."""
    count = len(point)
    off = np.zeros((count, 2))
    mean, number = np.zeros(2), 0
    for i in range(count):
        alive[t, i] = alive[t, i] and alive[t - 1, i] and point[i, 2] > 0.0
        if alive[t, i]:
            for j in range(2):
                off[i, j] = g.focal_px * (u_ic[i, j] / u_ic[i, 2] - point[i, j] / point[i, 2])
                mean[j] += off[i, j]
            number += 1
    for i in range(count):
        if alive[t, i]:
            away = (off[i, 0] - mean[0] / number) ** 2 + (off[i, 1] - mean[1] / number) ** 2
            alive[t, i] = away <= g.gate_px2


@cached_njit
def _misses(g: ObserverGains, x: Track, t: int, i: int, d_ik: float) -> bool:
    """Second gate: whether a distance at the key frame puts the corner too far from where it is seen."""
    p = _moved(x.r_0[t], x.p_0[t], d_ik * x.u_ik[i])
    if p[2] <= 0.0:
        return True
    off = 0.0
    for j in range(2):
        off += (g.focal_px * (x.u_ic[t, i, j] / x.u_ic[t, i, 2] - p[j] / p[2])) ** 2
    return bool(off > g.gate_px2)


@cached_njit
def _sample(
    g: ObserverGains, x: Track, t: int, i: int, begun: int, stack: Array, held: IntArray, sums: Array
) -> None:  # fmt: skip
    """Take a window's sample onto the stack of feature i, if it passes."""
    a = begun
    while x.t_s[t] - x.t_s[a] > g.window_s:
        a += 1
    y0, y1 = x.psi[t, i, 0] - x.psi[a, i, 0], x.psi[t, i, 1] - x.psi[a, i, 1]
    u0, u1 = x.way_m[t, i, 0] - x.way_m[a, i, 0], x.way_m[t, i, 1] - x.way_m[a, i, 1]
    yy, yu = y0 * y0 + y1 * y1, y0 * u0 + y1 * u1
    if not (yy > g.least_y**2 and u0 * u0 + u1 * u1 > g.least_u_m**2):
        return
    if not g.low_m <= yu / yy <= g.high_m or _misses(g, x, t, i, yu / yy):
        return
    if sums[i, 0] > g.stack_lambda and _misses(g, x, t, i, sums[i, 1] / sums[i, 0]):
        return
    place = held[i]
    if place == g.stack_size:
        place = int(np.argmin(stack[i, :, 0]))
        if stack[i, place, 0] >= yy:
            return
        sums[i, 0] -= stack[i, place, 0]
        sums[i, 1] -= stack[i, place, 1]
    else:
        held[i] += 1
    stack[i, place, 0], stack[i, place, 1] = yy, yu
    sums[i, 0] += yy
    sums[i, 1] += yu


@cached_njit
def _step(g: ObserverGains, x: Track, t: int, i: int, dt: float, learned: float, th: Array) -> None:
    """One implicit step of the observer for feature i; ``th`` (3,) is changed in place."""
    power, drive = g.k * x.flow_power[t, i], g.k * x.flow_drive[t, i]
    e0, e1 = x.ups[t, i, 0], x.ups[t, i, 1]
    # K Yx^T Yx and K Yx^T ux
    a00, a11, a12, a22 = power, power * e0 * e0, power * e0 * e1, power * e1 * e1
    a01 = 0.0
    b0, b1, b2 = drive, drive * e0, drive * e1
    if not np.isnan(learned):
        u_ic, u_kc, r = x.u_ic[t, i], x.u_kc[t], x.r_kc[t]
        c, along_i, along_k = 0.0, 0.0, 0.0
        for j in range(3):
            s = r[j, 0] * x.u_ik[i, 0] + r[j, 1] * x.u_ik[i, 1] + r[j, 2] * x.u_ik[i, 2]
            c += u_ic[j] * u_kc[j]
            along_i += u_ic[j] * s
            along_k += u_kc[j] * s
        # K_X YX^T YX and K_X YX^T uX
        a00, a11, a22, a01 = a00 + g.k_x, a11 + g.k_x, a22 + g.k_x, -g.k_x * c
        b0 += g.k_x * along_i * learned
        b1 -= g.k_x * along_k * learned
        b2 += g.k_x * learned
    r0 = th[0] + x.way_m[t, i, 0] - x.way_m[t - 1, i, 0] + dt * b0
    r1 = th[1] + x.way_m[t, i, 1] - x.way_m[t - 1, i, 1] + dt * b1
    r2 = th[2] + dt * b2
    # I + dt A is tridiagonal: eliminate the first and the last unknown
    d0, d2, off0, off2 = 1.0 + dt * a00, 1.0 + dt * a22, dt * a01, dt * a12
    th[1] = (r1 - off0 / d0 * r0 - off2 / d2 * r2) / (1.0 + dt * a11 - off0 * off0 / d0 - off2 * off2 / d2)
    th[0] = (r0 - off0 * th[1]) / d0
    th[2] = (r2 - off2 * th[1]) / d2
    th[0] = min(max(th[0], g.low_m), g.high_m)
    th[1] = min(max(th[1], 0.0), g.high_m)
    th[2] = min(max(th[2], g.low_m), g.high_m)
