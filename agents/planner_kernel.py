"""Expected coverage of candidate poses: what `camnet.agents.planner` maximises, one agent and decision at a time.

The value of flying to g with the gaze on the moving point c(tau) is, over targets m and instants tau_i ahead,

    J(g, c) = sum_m [ sum_i w_i P_i^m  +  R (1 - prod_i (1 - h_i P_i^m)) ]  -  effort,

P_i^m the probability that target m is then inside the region and wholly in view. The first sum is time in view, the
second pays a handoff that is still open once, if the target is seen at any instant of the time that is left for it.
A target's place at tau is a normal distribution about its prediction; the view's margin over it is compared with the
logistic curve of the same spread.

| symbol | meaning | ``facts`` |
| --- | --- | --- |
| c, h | region: centre and half-size, m | 0-2, 3-5 |
| lo, hi | the region's box less the margin, m | 6-8, 9-11 |
| x, y, r | disc of a cylinder less the margin, m (r = 0: none) | 12-14 |
| | disc of the region itself: radius, m (0: none) | 15 |
| | tangents of the view's left, right, upper and lower half-angles | 16-19 |
| | near, far, m | 20, 21 |
| | radius of the ball that holds a target's features, m | 22 |
| v_ref, k_p | top speed of the references, m/s, gain of their position, 1/s | 23, 24 |
| | gaze of an action of 1, rad | 26 |
| | width that error radii are divided by, m; look-ahead, s | 27, 28 |
| | where the agent loiters, m | 29-31 |
| | least height, m; grace time of a handoff, s | 32, 33 |
| | weights of the reward: time in view of one target (1/s), seen handoff, missed handoff, effort (1/s) | 34-37 |
| a | how far from c a setpoint may lie along each axis, m | 38-40 |
| | tangent of the largest gaze | 41 |
"""

from __future__ import annotations

import math

import numpy as np

from camnet.compiled import cached_njit
from camnet.types import Array, IntArray

__all__ = ["AHEAD_S", "choose", "expected_view", "inside"]

#: instants ahead, s, and the share of the future that each stands for, s: later ones count less, they will be replanned
AHEAD_S = (0.2, 0.6, 1.2, 2.0, 3.0, 4.5)
_WEIGHT_S = (0.4, 0.5, 0.7, 0.8, 0.8, 0.8)
#: a logistic curve has the spread of a normal one when its scale is this share of the deviation
_LOGISTIC = 0.55
#: turning to a new gaze takes about this long, s
_TURN_S = 0.35
#: by each instant: the share of a turn that is made, and the most of a way that is flown (references' gain of 2 1/s)
_TURNED = tuple(1.0 - math.exp(-t / _TURN_S) for t in AHEAD_S)
_MOVED = tuple(1.0 - math.exp(-1.4 * t) for t in AHEAD_S)
#: how many candidates are valued at all instants; the others at every second alone
_FINE = 64
#: the references take this long to get going, s
_LAG_S = 0.2


@cached_njit
def _logistic(x: float) -> float:
    if x > 8.0:
        return 1.0
    if x < -8.0:
        return 0.0
    return 1.0 / (1.0 + math.exp(-x))


@cached_njit
def axis(ax: float, ay: float) -> tuple[float, float, float]:
    """Optical axis (unit) of a gaze whose pan and tilt have the tangents ``ax`` and ``ay``."""
    norm = 1.0 / math.sqrt(ax * ax + ay * ay + 1.0)
    return ax * norm, ay * norm, -norm


@cached_njit
def expected_view(
    x: float, y: float, z: float, d: tuple[float, float, float], spread: float, f: Array
) -> float:
    """Probability that a target about (x, y, z), m, from the camera is wholly in view; optical axis ``d`` (unit).

    The camera is turned from straight down by the smallest rotation (`camnet.geometry.rotations.nadir_gaze`).
    """
    dx, dy, dz = d
    depth = x * dx + y * dy + z * dz
    if depth < f[20]:
        return 0.0
    share = (x * dx + y * dy + z * (dz - 1.0)) / (1.0 - dz)
    u, v = x - share * dx, -(y - share * dy)
    margin = f[21] - depth
    margin = min(margin, depth * f[16] + u) if u < 0 else min(margin, depth * f[17] - u)
    margin = min(margin, depth * f[18] + v) if v < 0 else min(margin, depth * f[19] - v)
    return _logistic((margin - f[22]) / (_LOGISTIC * spread))


@cached_njit
def inside(x: float, y: float, spread: float, f: Array) -> float:
    """Probability that a point lies in the region."""
    if f[15] > 0.0:
        margin = f[15] - math.sqrt((x - f[0]) ** 2 + (y - f[1]) ** 2)
    else:
        margin = min(f[3] - abs(x - f[0]), f[4] - abs(y - f[1]))
    return _logistic(margin / (_LOGISTIC * spread))


@cached_njit
def _project(p: Array, f: Array) -> None:
    """Move a point to the nearest place where a setpoint may lie."""
    if f[14] > 0.0:
        x, y = p[0] - f[12], p[1] - f[13]
        d = math.sqrt(x * x + y * y)
        if d > f[14]:
            p[0], p[1] = f[12] + x * f[14] / d, f[13] + y * f[14] / d
    for k in range(3):
        p[k] = min(max(p[k], f[6 + k]), f[9 + k])


@cached_njit
def _gaze_to(x: float, y: float, z: float, limit: float) -> tuple[float, float]:
    """Tangents of pan and tilt that look along a way, at most ``limit``."""
    down = 1.0 / max(-z, 1e-6)
    return min(max(x * down, -limit), limit), min(max(y * down, -limit), limit)


@cached_njit
def _value(
    own: Array,
    gaze: Array,
    goal: Array,
    look: Array,
    places: Array,
    spreads: Array,
    chances: Array,
    every: int,
    f: Array,
) -> float:
    """J of one candidate; ``look`` (T, 3) is where the gaze points at each instant, of which every so many count.

    ``places`` (T, M, 3), ``spreads``, ``chances`` (T, M): where targets are, and how sure it is that they are inside.
    ``chances[T]`` and ``chances[T + 1]`` (M,): what a handoff of the target is worth, and until when, s.
    """
    steps, m_targets = spreads.shape
    wx, wy, wz = goal[0] - own[0], goal[1] - own[1], goal[2] - own[2]
    way = math.sqrt(wx * wx + wy * wy + wz * wz)
    total = 0.0
    missed = np.ones(m_targets)
    for i in range(every - 1, steps, every):
        gone = min(_MOVED[i], f[23] * max(AHEAD_S[i] - _LAG_S, 0.0) / max(way, 1e-6))
        px, py, pz = own[0] + gone * wx, own[1] + gone * wy, own[2] + gone * wz
        ax, ay = _gaze_to(look[i, 0] - px, look[i, 1] - py, look[i, 2] - pz, f[41])
        d = axis(gaze[0] + _TURNED[i] * (ax - gaze[0]), gaze[1] + _TURNED[i] * (ay - gaze[1]))
        for m in range(m_targets):
            if chances[i, m] > 0.01:
                x, y, z = places[i, m, 0] - px, places[i, m, 1] - py, places[i, m, 2] - pz
                p = chances[i, m] * expected_view(x, y, z, d, spreads[i, m], f)
                total += every * _WEIGHT_S[i] * f[34] * p
                if chances[steps, m] > 0.0 and AHEAD_S[i] <= chances[steps + 1, m]:
                    missed[m] *= 1.0 - p
    for m in range(m_targets):
        total += chances[steps, m] * (1.0 - missed[m])
    speed = min(way * f[24], f[23]) / f[23]
    return float(total - f[37] * speed * speed)


@cached_njit
def _candidates(own: Array, places: Array, important: IntArray, count: int, f: Array, out: Array) -> int:
    """Positions worth trying (K, 3): here, near by, above the targets that matter, over the whole region."""
    k = 0
    for c in range(3):
        out[k, c] = own[c]
    k += 1
    for step in (0.4, 1.2):
        for j in range(8):
            out[k, 0] = own[0] + step * math.cos(0.25 * math.pi * j)
            out[k, 1] = own[1] + step * math.sin(0.25 * math.pi * j)
            out[k, 2] = own[2]
            k += 1
    for dz in (-0.4, 0.4):
        out[k, 0], out[k, 1], out[k, 2] = own[0], own[1], own[2] + dz
        k += 1
    for n in range(count):
        out[k, 0], out[k, 1] = places[2, important[n], 0], places[2, important[n], 1]
        out[k, 2] = own[2]
        k += 1
    for iz in range(2):
        z = f[11] if iz == 0 else 0.5 * (f[8] + f[11])
        for ix in range(4):
            for iy in range(4):
                out[k, 0] = f[6] + (f[9] - f[6]) * ix / 3.0
                out[k, 1] = f[7] + (f[10] - f[7]) * iy / 3.0
                out[k, 2] = z
                k += 1
    for j in range(k):
        _project(out[j], f)
        out[j, 2] = max(out[j, 2], min(f[32], f[11]))
    return k


@cached_njit
def _looks(places: Array, important: IntArray, count: int, f: Array, out: Array) -> int:
    """Write moving points worth looking at (L, T, 3): each target that matters, the middle of each pair, and of all."""
    steps, k = places.shape[0], 0
    for a in range(count):
        for i in range(steps):
            out[k, i] = places[i, important[a]]
        k += 1
        for b in range(a):
            for i in range(steps):
                out[k, i] = 0.5 * (places[i, important[a]] + places[i, important[b]])
            k += 1
    if count > 2:
        for i in range(steps):
            out[k, i] = 0.0
            for a in range(count):
                out[k, i] += places[i, important[a]] / count
        k += 1
    for j in range(17):  # the region's middle, and its rim for those who come unannounced
        for i in range(steps):
            out[k, i, 2] = 0.0
            out[k, i, 0], out[k, i, 1] = f[0], f[1]
            if j > 0:
                out[k, i, 0] += (0.3 if j > 8 else 0.7) * f[3] * math.cos(0.25 * math.pi * j)
                out[k, i, 1] += (0.3 if j > 8 else 0.7) * f[4] * math.sin(0.25 * math.pi * j)
        k += 1
    return k


@cached_njit
def choose(
    own: Array,
    gaze: Array,
    places: Array,
    spreads: Array,
    chances: Array,
    estimates: int,
    most: int,
    f: Array,
) -> tuple[float, float, float, float, float]:
    """Return the best position, m, and the pan and tilt, rad, to ask for now.

    Parameters
    ----------
    own, gaze : (3,) m; (2,) tangents of pan and tilt now
    places, spreads, chances : see `_value`
    estimates : how many of the hypotheses, the first ones, gazes are aimed at
    most : of how many of these at once
    """
    steps = spreads.shape[0]
    worth = np.zeros(estimates)
    for m in range(estimates):
        for i in range(steps):
            worth[m] += _WEIGHT_S[i] * f[34] * chances[i, m]
        worth[m] += chances[steps, m] * chances[:steps, m].max()
    important = np.argsort(-worth)[:most]
    count = 0
    while count < len(important) and worth[important[count]] > 1e-3:
        count += 1
    positions, looks = np.empty((64 + most, 3)), np.empty((18 + most * (most + 1) // 2, steps, 3))
    n_positions = _candidates(own, places, important, count, f, positions)
    n_looks = _looks(places, important, count, f, looks)
    rough = np.empty(n_positions * n_looks)
    for a in range(n_positions):
        for b in range(n_looks):
            rough[a * n_looks + b] = _value(own, gaze, positions[a], looks[b], places, spreads, chances, 2, f)
    worthy = np.partition(rough, len(rough) - _FINE)[len(rough) - _FINE]
    best, chosen = -math.inf, 0
    for k in range(len(rough)):
        if rough[k] >= worthy:
            a, b = k // n_looks, k % n_looks
            value = _value(own, gaze, positions[a], looks[b], places, spreads, chances, 1, f)
            if value > best + 1e-12:
                best, chosen = value, k
    best_p, best_l = chosen // n_looks, chosen % n_looks
    p, at = positions[best_p], looks[best_l]
    tx, ty = _gaze_to(at[0, 0] - own[0], at[0, 1] - own[1], at[0, 2] - own[2], f[41])
    return p[0], p[1], p[2], math.atan(tx), math.atan(ty)
