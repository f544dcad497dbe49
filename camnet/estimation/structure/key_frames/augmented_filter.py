"""Planar pose filter that learns its odometry's errors at landmarks and from the images' rotation. Our own, compiled.

| symbol | name | shape | unit | equation |
| --- | --- | --- | --- | --- |
| ``x = [p, th, s, b, s_g]`` | | (6,) | m, rad, -, rad/s, - | pose, wheel scale, gyro bias, gyro scale |
| ``c_j = [p_j, th_j]`` | | (3,) | m, rad | clone of the pose when key frame j was taken |
| ``v``, ``w`` | ``speed``, ``rate`` | (K, 2), (K,) | m/s, rad/s | measured; ahead and left of the camera, about up |
| ``p' = R(th) v / (1 + s)`` | | | | ``th' = (w - b) / (1 + s_g)`` |
| ``sigma_g``, ``T`` | ``slip``, ``slip_time_s`` | | -, s | slip: noise ``2 sigma_g^2 T |v|^2`` a second along v |
| ``sigma_w`` | ``gyro_noise`` | | rad/s | white, of one sample: ``sigma_w^2 dt^2`` a step, times ``m`` |
| ``z_v = th - th_k`` | ``turn`` | | rad | end of a key frame: visual rotation since it was taken |
| ``z_l = [p, th]`` | | (3,) | | landmark: a full pose update, not a reset |
| ``z_r = [(1 + s) R(th_j)^T (p - p_j), th - th_j]`` | | (3,) | | revisit: pose in the frame of an old key frame |

A landmark's cross-covariances teach scale, bias and gyro scale, and correct the clones of key frames that are kept for
revisits. The visual rotation of a key frame does the same in between.

Adaptive noise: ``m`` multiplies the variance of the gyro noise. Over the last ``adapt_count`` visual rotations the mean
square of the innovations is held against the variance that the filter states with m = 1. Where they differ by more than
2.6 standard deviations of such a mean, m is what makes them equal, within [1/M, M]; else it is 1. A stated gyro noise
that is too small or too large is so corrected, and one that is right is left alone. Rotations are gated after that.

The structure of an old key frame was learned with the same wheels: what is measured in its frame is too large by s.

``m_s`` multiplies the variance of slip, of which only positions speak: landmarks and revisits. They are few. While an
innovation is within its 99 % bound, m_s moves by ``ln m_s += share (nis / 2 - 1) / 20``, where share is that of slip in
the variance of the innovation; beyond it, the variance of slip since the last of them (``W``, (2, 2)) is raised at once
to what explains the innovation, if it has a share of a fifth or more. Revisits are gated after that.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from camnet.compiled import cached_njit
from camnet.types import Array, BoolArray, IntArray

__all__ = [
    "FilterEvents",
    "FilterNoise",
    "FilterRun",
    "clone_pose",
    "predict_state",
    "run_filter",
    "take_landmark",
    "take_rotation",
]

#: fixed part of the state, numbers of a clone
_FIXED, _CLONE = 6, 3
_GATE_1, _GATE_3 = 10.83, 16.27  # 99.9 % of one and of three degrees of freedom
_USUAL_2, _MOST_AT_ONCE, _LEAST_SHARE = 9.21, 30.0, 0.2  # 99 % of two degrees of freedom
_LARGEST_NIS, _LEAST_COUNT, _SIGNIFICANT = 25.0, 10.0, 2.6


class FilterNoise(NamedTuple):
    """What is stated of the odometry and the landmark; standard deviations."""

    scale: float
    gyro_bias: float
    gyro_scale: float
    slip: float
    slip_time_s: float
    gyro_noise: float
    landmark_m: float
    landmark_rad: float
    adapt_count: float
    adapt_most: float


class FilterEvents(NamedTuple):
    """What happens at K images.

    Attributes
    ----------
    landmark : (K,) whether it is in view; the first image must see it
    landmark_pose : (K, 3) position and heading by it
    taken : (K,) whether a key frame is taken
    turn, turn_sd : (K,) visual rotation since the key frame was taken, rad; NaN where none is used
    keep : (K,) at a key frame's last image: whether its clone is kept for revisits
    revisit : (K,) the key frame (by order of taking) that is seen again; -1 for none
    revisit_pose, revisit_cov : (K, 3), (K, 3, 3) the pose in its frame
    """

    landmark: BoolArray
    landmark_pose: Array
    taken: BoolArray
    turn: Array
    turn_sd: Array
    keep: BoolArray
    revisit: IntArray
    revisit_pose: Array
    revisit_cov: Array


class FilterRun(NamedTuple):
    """Estimates at K images.

    Attributes
    ----------
    pose, pose_cov : (K, 3), (K, 3, 3) position in m and heading in rad, after the image's updates
    before, before_cov : the same before the landmark's update
    odometry, odometry_sd : (K, 3) wheel scale, gyro bias, gyro scale
    multiplier : (K, 2) of the variances of gyro noise and slip
    """

    pose: Array
    pose_cov: Array
    before: Array
    before_cov: Array
    odometry: Array
    odometry_sd: Array
    multiplier: Array


@cached_njit
def run_filter(t_s: Array, speed: Array, rate: Array, events: FilterEvents, noise: FilterNoise) -> FilterRun:
    """Run over K images; clones that are not kept are dropped when the next key frame is taken."""
    e, count = events, len(t_s)
    most = _FIXED + _CLONE * (2 + int(np.sum(e.keep)))
    x, p = np.zeros(most), np.zeros((most, most))
    x[:3] = e.landmark_pose[0]
    start = (
        noise.landmark_m,
        noise.landmark_m,
        noise.landmark_rad,
        noise.scale,
        noise.gyro_bias,
        noise.gyro_scale,
    )
    for i in range(_FIXED):
        p[i, i] = start[i] ** 2
    out = FilterRun(
        np.empty((count, 3)), np.empty((count, 3, 3)), np.empty((count, 3)), np.empty((count, 3, 3)),
        np.empty((count, 3)), np.empty((count, 3)), np.ones((count, 2)),
    )  # fmt: skip
    # the clone in use is the last one; clones[j] is where that of key frame j begins
    clones = np.full(int(np.sum(e.taken)), -1)
    n, number, multiplier, kept = _FIXED, -1, 1.0, True
    white = 0.0  # variance of the heading by the stated gyro noise since the key frame was taken
    means = np.zeros(4)
    slips, slip = np.zeros((2, 2)), 1.0
    for t in range(count):
        if t > 0:
            dt = t_s[t] - t_s[t - 1]
            white += (noise.gyro_noise * dt) ** 2
            predict_state(
                x, p, n, dt, speed[t - 1], speed[t], rate[t - 1], rate[t], noise, multiplier, slip, slips
            )
        if not math.isnan(e.turn[t]) and number >= 0:
            multiplier = take_rotation(
                x, p, n, clones[number], e.turn[t], e.turn_sd[t], white, multiplier, means, noise
            )
        if e.revisit[t] >= 0 and clones[e.revisit[t]] >= 0:
            k = clones[e.revisit[t]]
            slip *= _revisit(x, p, n, k, e.revisit_pose[t], e.revisit_cov[t], slips)
        out.before[t], out.before_cov[t] = x[:3], p[:3, :3]
        if e.landmark[t] and t > 0:
            slip *= take_landmark(x, p, n, e.landmark_pose[t], noise, slips)
        slip = min(max(slip, 1.0 / noise.adapt_most), noise.adapt_most)
        if e.keep[t]:
            kept = True
        if e.taken[t]:
            if not kept:
                n -= _CLONE
                clones[number] = -1
            number, kept, white = number + 1, False, 0.0
            clones[number] = n
            clone_pose(x, p, n)
            n += _CLONE
        out.pose[t], out.pose_cov[t] = x[:3], p[:3, :3]
        out.odometry[t] = x[3:6]
        for i in range(3):
            out.odometry_sd[t, i] = math.sqrt(p[3 + i, 3 + i])
        out.multiplier[t, 0], out.multiplier[t, 1] = multiplier, slip
    return out


@cached_njit
def predict_state(
    x: Array, p: Array, n: int, dt: float, v_then: Array, v_now: Array, w_then: float, w_now: float,
    noise: FilterNoise, multiplier: float, slip: float, slips: Array,
) -> None:  # fmt: skip
    """Dead-reckon the first ``n`` of the state and its covariance over ``dt`` s."""
    w = (0.5 * (w_then + w_now) - x[4]) / (1.0 + x[5])
    middle = x[2] + 0.5 * dt * w
    c, s = math.cos(middle), math.sin(middle)
    ahead, left = 0.5 * (v_then[0] + v_now[0]), 0.5 * (v_then[1] + v_now[1])
    # in the world, by the estimated scale
    vx, vy = (c * ahead - s * left) / (1.0 + x[3]), (s * ahead + c * left) / (1.0 + x[3])
    turn = dt * w
    f = np.eye(_FIXED)
    f[2, 4], f[2, 5] = -dt / (1.0 + x[5]), -turn / (1.0 + x[5])
    f[0, 2], f[1, 2] = -dt * vy, dt * vx
    f[0, 3], f[1, 3] = -dt * vx / (1.0 + x[3]), -dt * vy / (1.0 + x[3])
    for j in (4, 5):
        f[0, j], f[1, j] = 0.5 * f[0, 2] * f[2, j], 0.5 * f[1, 2] * f[2, j]
    x[0] += dt * vx
    x[1] += dt * vy
    x[2] += turn
    cross = f @ p[:_FIXED, :n].copy()
    p[:_FIXED, :n] = cross
    p[:n, :_FIXED] = cross.T
    p[:_FIXED, :_FIXED] = cross[:, :_FIXED].copy() @ f.T
    power = slip * 2.0 * noise.slip**2 * noise.slip_time_s * dt
    along = (vx, vy)
    for i in range(2):
        for j in range(2):
            slips[i, j] += power * along[i] * along[j]
            p[i, j] += power * along[i] * along[j]
    p[2, 2] += multiplier * (noise.gyro_noise * dt / (1.0 + x[5])) ** 2


@cached_njit
def clone_pose(x: Array, p: Array, n: int) -> None:
    """Append the pose to the state."""
    x[n : n + _CLONE] = x[:_CLONE]
    p[n : n + _CLONE, :n] = p[:_CLONE, :n]
    p[:n, n : n + _CLONE] = p[:n, :_CLONE]
    p[n : n + _CLONE, n : n + _CLONE] = p[:_CLONE, :_CLONE]


@cached_njit
def _update(x: Array, p: Array, n: int, h: Array, innovation: Array, inverse: Array) -> None:
    """Kalman update with rows ``h`` (k, n), ``innovation`` (k,) and the inverse of its covariance (k, k)."""
    p_n = p[:n, :n].copy()
    p_h = p_n @ h.T
    gain = p_h @ inverse
    x[:n] += gain @ innovation
    p_n -= gain @ p_h.T
    p[:n, :n] = 0.5 * (p_n + p_n.T)


@cached_njit
def take_rotation(
    x: Array, p: Array, n: int, clone: int, turn: float, turn_sd: float, white: float, multiplier: float,
    means: Array, noise: FilterNoise,
) -> float:  # fmt: skip
    """Take the visual rotation since the key frame; return the new multiplier of the gyro noise."""
    k = clone + 2
    variance = p[2, 2] - 2.0 * p[2, k] + p[k, k] + turn_sd**2
    innovation = np.array([turn - (x[2] - x[k])])
    square = min(innovation[0] ** 2, _LARGEST_NIS * variance)
    # means over the last rotations of square, variance without gyro noise, and gyro noise
    means[3] = min(means[3] + 1.0, noise.adapt_count)
    new = (square, max(variance - multiplier * white, 0.0), white)
    for i in range(3):
        means[i] += (new[i] - means[i]) / means[3]
    if innovation[0] ** 2 <= _GATE_1 * variance:
        h = np.zeros((1, n))
        h[0, 2], h[0, k] = 1.0, -1.0
        _update(x, p, n, h, innovation, np.array([[1.0 / variance]]))
    stated = means[1] + means[2]
    if means[3] < _LEAST_COUNT or abs(means[0] / stated - 1.0) < _SIGNIFICANT * math.sqrt(2.0 / means[3]):
        return 1.0
    return float(min(max((means[0] - means[1]) / means[2], 1.0 / noise.adapt_most), noise.adapt_most))


@cached_njit
def _surprise(p: Array, slips: Array, variance: Array, innovation: Array) -> float:
    """Return the factor for the variance of slip by a position's innovation (2,); raise ``p`` where due."""
    inverse = np.linalg.inv(variance)
    nis = innovation @ inverse @ innovation
    share = min(0.5 * np.trace(inverse @ slips), 1.0)
    factor = 1.0
    if nis <= _USUAL_2:
        factor = math.exp(0.05 * share * (0.5 * nis - 1.0))
    elif share >= _LEAST_SHARE:
        factor = min(1.0 + (0.5 * nis - 1.0) / share, _MOST_AT_ONCE)
        p[:2, :2] += (factor - 1.0) * slips
    slips[:] = 0.0
    return float(factor)


@cached_njit
def _wrapped(angle: float) -> float:
    return angle - 2.0 * math.pi * round(angle / (2.0 * math.pi))


@cached_njit
def take_landmark(x: Array, p: Array, n: int, pose: Array, noise: FilterNoise, slips: Array) -> float:
    """Take a landmark's pose; return the factor for the variance of slip."""
    h = np.zeros((3, n))
    h[0, 0] = h[1, 1] = h[2, 2] = 1.0
    innovation = pose - x[:3]
    innovation[2] = _wrapped(innovation[2])
    known = np.diag(np.array([noise.landmark_m**2, noise.landmark_m**2, noise.landmark_rad**2]))
    variance = p[:2, :2] + known[:2, :2]
    factor = _surprise(p, slips, variance, innovation[:2].copy())
    inverse: Array = np.linalg.inv(p[:3, :3] + known)  # type: ignore[assignment]
    _update(x, p, n, h, innovation, inverse)
    return factor


@cached_njit
def _revisit(
    x: Array, p: Array, n: int, k: int, pose: Array, cov: Array, slips: Array
) -> float:  # fmt: skip
    """Take a pose in the frame of the clone at ``k``; return the factor for the variance of slip."""
    c, s = math.cos(x[k + 2]), math.sin(x[k + 2])
    dx, dy = x[0] - x[k], x[1] - x[k + 1]
    ahead, left = c * dx + s * dy, -s * dx + c * dy
    h = np.zeros((3, n))
    h[0, 0], h[0, 1], h[0, k], h[0, k + 1], h[0, k + 2] = c, s, -c, -s, left
    h[1, 0], h[1, 1], h[1, k], h[1, k + 1], h[1, k + 2] = -s, c, s, -c, -ahead
    h[2, 2], h[2, k + 2] = 1.0, -1.0
    # the map was learned with the same wheels
    h[:2, :] *= 1.0 + x[3]
    h[0, 3], h[1, 3] = ahead, left
    ahead, left = (1.0 + x[3]) * ahead, (1.0 + x[3]) * left
    innovation = np.array([pose[0] - ahead, pose[1] - left, _wrapped(pose[2] - (x[2] - x[k + 2]))])
    variance = h @ p[:n, :n].copy() @ h.T + cov
    # slip is kept in the world's axes
    turn = np.array([[c, s], [-s, c]])
    away = turn.T @ innovation[:2]
    factor = _surprise(p, slips, turn.T @ variance[:2, :2].copy() @ turn, away)
    variance = h @ p[:n, :n].copy() @ h.T + cov
    inverse: Array = np.linalg.inv(variance)  # type: ignore[assignment]
    if innovation @ inverse @ innovation <= _GATE_3:
        _update(x, p, n, h, innovation, inverse)
    return factor
