"""The motion across a gap, reconstructed after the fact: from exit and entry pose and velocity to stack windows.

| symbol | name | shape | unit |
| --- | --- | --- | --- |
| T | ``duration`` | - | s |
| p(s) | cubic Hermite through (p0, v0) and (p1, v1) | (3,) | m |
| theta(s) | the same for the turn since the exit, ``q = q0 exp(theta)`` | (3,) | rad |
| rho | ``psd``: power spectral density of the unknown acceleration | - | m^2/s^3 |

The cubic Hermite is the mean of a particle driven by white acceleration and pinned at both ends (the fixed-interval
smoother's answer). Its velocity variance is that of a Brownian bridge with known integral,

    var v(s) = rho T x (1 - 3 x),    x = s (1 - s),

and rho is raised to what the ends themselves contradict: ``p1 - p0 - T (v0 + v1)/2`` has variance ``rho T^3 / 12`` on
each axis. A target that stopped or strayed in the gap thus gets windows of little weight.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from camnet.compiled import cached_njit
from camnet.estimation.basis import RbfBasis
from camnet.estimation.settings import GapSettings
from camnet.estimation.windows import increment_of
from camnet.geometry.rotations_compiled import align_sign, conjugate, exp, log, multiply, rotate
from camnet.types import Array

__all__ = [
    "EndState",
    "PoseHistory",
    "bridge_path",
    "bridge_velocity_variance",
    "fit_motion",
    "gap_windows",
    "hermite",
]

#: sub-intervals of a window over which sigma is integrated along the path
SUBSTEPS = 6


@dataclass(frozen=True, eq=False, slots=True)
class EndState:
    """Pose and velocity at one end of a gap: ``v`` in the world frame, ``w`` in the body frame."""

    t_s: float
    p: Array
    q: Array
    v: Array
    w: Array


@cached_njit
def fit_motion(t: Array, p: Array, q: Array, t_eval: float) -> tuple[Array, Array, Array, Array]:
    """Pose and velocity at ``t_eval`` of the constant turn that fits poses at times t (n,), p (n, 3), q (n, 4).

    Straight lines are fitted to the positions and to the turns about the middle pose; the velocity is then turned, and
    the position moved along the arc, from the middle of the data to ``t_eval``.
    """
    n = len(t)
    t_mid, variance = 0.0, 0.0
    for i in range(n):
        t_mid += t[i] / n
    for i in range(n):
        variance += (t[i] - t_mid) ** 2 / n
    q_ref = q[n // 2]
    q_ref_inverse = conjugate(q_ref)
    p_eval, v, turn, w, late_turn = np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3)
    for i in range(n):
        angle = log(multiply(q_ref_inverse, q[i]))
        for a in range(3):
            p_eval[a] += p[i, a] / n
            v[a] += (t[i] - t_mid) * p[i, a] / (n * variance)
            turn[a] += angle[a] / n
            w[a] += (t[i] - t_mid) * angle[a] / (n * variance)
    late = t_eval - t_mid
    q_mid = multiply(q_ref, exp(turn))
    w_world = rotate(q_mid, w)
    arc = 0.5 * (late * late - variance)
    for a in range(3):
        b, c = (a + 1) % 3, (a + 2) % 3
        p_eval[a] += late * v[a] + arc * (w_world[b] * v[c] - w_world[c] * v[b])
        late_turn[a] = late * w[a]
    return p_eval, multiply(q_mid, exp(late_turn)), rotate(exp(rotate(q_mid, late_turn)), v), w


@cached_njit
def push_and_fit(
    t: Array, p: Array, q: Array, count: int, t_new: float, p_new: Array, q_new: Array, motion: Array
) -> int:
    """Add a pose to the rows of t (n,), p (n, 3), q (n, 4), of which ``count`` are held; the oldest gives way.

    Returns the new count. From three poses on, velocity and angular velocity at the new pose are written to
    ``motion`` (6,).
    """
    if count == len(t):
        for k in range(count - 1):
            t[k] = t[k + 1]
            p[k] = p[k + 1]
            q[k] = q[k + 1]
        count -= 1
    t[count] = t_new
    p[count] = p_new
    q[count] = q_new
    count += 1
    if count >= 3 and t[count - 1] > t[0]:
        _, _, v, w = fit_motion(t[:count], p[:count], q[:count], t_new)
        for i in range(3):
            motion[i] = v[i]
            motion[3 + i] = w[i]
    return count


class PoseHistory:
    """The latest poses of an uninterrupted sighting, at most ``capacity`` of them."""

    def __init__(self, capacity: int) -> None:
        self._t = np.zeros(capacity)
        self._p = np.zeros((capacity, 3))
        self._q = np.zeros((capacity, 4))
        self.count = 0

    def clear(self) -> None:
        """Forget everything."""
        self.count = 0

    def push(self, t_s: float, p: Array, q: Array) -> None:
        """Add a pose; the oldest gives way."""
        if self.count == len(self._t):
            for array in (self._t, self._p, self._q):
                array[:-1] = array[1:]
            self.count -= 1
        i = self.count
        self._t[i], self._p[i], self._q[i] = t_s, p, q
        self.count = i + 1

    def push_and_fit(self, t_s: float, p: Array, q: Array, motion: Array) -> None:
        """Add a pose and write velocity and angular velocity there to ``motion`` (6,), from three poses on."""
        self.count = push_and_fit(self._t, self._p, self._q, self.count, t_s, p, q, motion)

    def fit(self, t_s: float) -> EndState | None:
        """Pose and velocity at ``t_s``; None with fewer than three poses, or if all are of one instant."""
        n = self.count
        if n < 3 or not self._t[n - 1] > self._t[0]:
            return None
        return EndState(t_s, *fit_motion(self._t[:n], self._p[:n], self._q[:n], t_s))

    @property
    def middle_s(self) -> float:
        """Mean time of the poses held, s."""
        return float(self._t[: self.count].mean())


def bridge_velocity_variance(s: Array, duration: float, psd: float) -> Array:
    """Variance of each velocity component at the share ``s`` of the gap, m^2/s^2."""
    x = s * (1.0 - s)
    return psd * duration * x * (1.0 - 3.0 * x)


def _turn(exit_: EndState, entry: EndState) -> Array:
    """Rotation vector (3,) from exit to entry, with the number of full turns that the body rates suggest."""
    theta = log(multiply(conjugate(exit_.q), entry.q))
    expected = 0.5 * (entry.t_s - exit_.t_s) * (exit_.w + entry.w)
    angle = float(np.linalg.norm(theta))
    spin = float(np.linalg.norm(expected))
    if angle > 1e-9:
        axis = theta / angle
    elif spin > 1e-9:
        axis = expected / spin
    else:
        return np.asarray(theta)
    turns = round((float(expected @ axis) - angle) / (2.0 * math.pi))
    return np.asarray((angle + 2.0 * math.pi * turns) * axis)


def _inverse_right_jacobian(theta: Array, w: Array) -> Array:
    """Rate of the rotation vector ``theta`` whose body rate is ``w``."""
    angle = float(np.linalg.norm(theta))
    cross = np.cross(theta, w)
    if angle < 1e-4:
        return np.asarray(w + 0.5 * cross)
    half = 0.5 * angle
    sine = math.sin(half)
    if abs(sine) < 1e-3:
        return w
    factor = (1.0 - half * math.cos(half) / sine) / angle**2
    return np.asarray(w + 0.5 * cross + factor * np.cross(theta, cross))


def hermite(s: Array, x0: Array, d0: Array, x1: Array, d1: Array) -> Array:
    """Cubic (n, 3) through x0, x1 with derivatives d0, d1 with respect to s in [0, 1]."""
    u = s[:, None]
    return np.asarray(
        (1 + 2 * u) * (1 - u) ** 2 * x0
        + u * (1 - u) ** 2 * d0
        + u**2 * (3 - 2 * u) * x1
        + u**2 * (u - 1) * d1
    )


def bridge_path(exit_: EndState, entry: EndState, s: Array) -> tuple[Array, Array]:
    """Positions (n, 3) and orientations (n, 4) at the shares ``s`` (n,) of the gap."""
    duration = entry.t_s - exit_.t_s
    p = hermite(s, exit_.p, duration * exit_.v, entry.p, duration * entry.v)
    theta1 = _turn(exit_, entry)
    rate1 = _inverse_right_jacobian(theta1, entry.w)
    theta = hermite(s, np.zeros(3), duration * exit_.w, theta1, duration * rate1)
    q = np.empty((len(s), 4))
    for i in range(len(s)):
        q[i] = multiply(exit_.q, exp(theta[i]))
        if i > 0:
            q[i] = align_sign(q[i], q[i - 1])
    return p, q


def gap_windows(
    exit_: EndState, entry: EndState, basis: RbfBasis, window_s: float, stacked: bool, settings: GapSettings
) -> list[tuple[Array, Array, float]]:
    """Windows (row (p,), increment (8,), weight) that tile the gap; none if it is too long or too short."""
    duration = entry.t_s - exit_.t_s
    count = round(duration / window_s)
    if count < 1 or duration > settings.max_gap_s:
        return []
    s = np.linspace(0.0, 1.0, count * SUBSTEPS + 1)
    p, q = bridge_path(exit_, entry, s)
    contradiction = entry.p - exit_.p - 0.5 * duration * (exit_.v + entry.v)
    psd = max(settings.accel_psd_m2ps3, 12.0 * float(contradiction @ contradiction) / (3.0 * duration**3))
    sigma = np.array([basis(p[i], q[i]) for i in range(len(s))])
    step = duration / (count * SUBSTEPS)
    windows = []
    for k in range(count):
        a, b = k * SUBSTEPS, (k + 1) * SUBSTEPS
        row = step * (sigma[a : b + 1].sum(axis=0) - 0.5 * (sigma[a] + sigma[b]))
        variance = float(bridge_velocity_variance(np.array(0.5 * (s[a] + s[b])), duration, psd))
        weight = settings.path_std_mps**2 / (settings.path_std_mps**2 + variance)
        windows.append((row, increment_of(p[a], q[a], p[b], q[b], step * SUBSTEPS, stacked), weight))
    return windows
