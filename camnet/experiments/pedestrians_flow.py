"""The flow of a crowd, learned from what other people did before: kernel regression on place and motion.

| symbol | name | shape | unit |
| --- | --- | --- | --- |
| p, v | place and last displacement of who is predicted | (2,) | m |
| p_i, v_i | the same of an earlier sample of somebody else | (2,) | m |
| r_i(h) | how far that person was from ``p_i + h v_i`` h samples later | (2,) | m |
| w_i | exp(-1/2 (|p - p_i|^2 / b_p^2 + |v - v_i|^2 / b_v^2)) | - | - |
| n(h) = sum w_i | weight of what is known; samples whose h-th follower lies in the future do not count | - | - |
| n_0 | ``_SHRINK``: weight of the belief that people walk on | - | - |

``deviation(h) = sum_i w_i r_i(h) / (n(h) + n_0)`` is added to the constant-velocity prediction. Where nobody has been,
or nobody moved like this, the prediction is constant velocity. The same with the displacements themselves, on place and
direction of motion alone, is the plain flow field, followed sample by sample.
"""

from __future__ import annotations

import math

import numpy as np

from camnet.compiled import cached_njit
from camnet.experiments.pedestrians_data import FUTURE, Experience, Windows
from camnet.types import Array, IntArray

__all__ = ["field_prediction", "learned_deviation"]

#: b_p, m, and b_v, m a sample (0.4 s)
PLACE_M, MOTION_M = 2.0, 0.15
#: b_p of the plain flow field, m
FIELD_PLACE_M = 1.0
#: direction of motion in the plain flow field enters as a point on a circle of this radius over its own width
DIRECTION_WIDTH = 0.5
_SHRINK = 3.0
#: squared distance in widths beyond which a weight is zero
_CUT = 12.0


def learned_deviation(windows: Windows, known: Experience) -> Array:
    """Learned deviation (n, 12, 2) from constant velocity, m, each from other people's samples up to ``now``."""
    v = windows.seen[:, -1] - windows.seen[:, -2]
    return np.asarray(
        _deviation(
            windows.seen[:, -1], v, windows.person, windows.now,
            known.p, known.v, known.person, known.at, known.ahead, known.deviation, PLACE_M, MOTION_M,
        )
    )  # fmt: skip


def field_prediction(windows: Windows, known: Experience) -> Array:
    """Displacements (n, 12, 2) along the plain flow field, m."""
    v = windows.seen[:, -1] - windows.seen[:, -2]
    return np.asarray(
        _follow_field(
            windows.seen[:, -1], v, windows.person, windows.now,
            known.p, known.v, known.person, known.at, known.deviation, FIELD_PLACE_M, DIRECTION_WIDTH,
        )
    )  # fmt: skip


@cached_njit
def _deviation(
    p: Array,
    v: Array,
    person: IntArray,
    now: IntArray,
    known_p: Array,
    known_v: Array,
    known_person: IntArray,
    known_at: IntArray,
    ahead: IntArray,
    deviation: Array,
    place: float,
    motion: float,
) -> Array:
    out = np.zeros((len(p), FUTURE, 2))
    for a in range(len(p)):
        weight = np.zeros(FUTURE)
        for b in range(len(known_p)):
            age = now[a] - known_at[b]
            if age < 1:
                break  # in the order of time
            dx, dy = (p[a, 0] - known_p[b, 0]) / place, (p[a, 1] - known_p[b, 1]) / place
            square = dx * dx + dy * dy
            if square > _CUT or known_person[b] == person[a]:
                continue
            dx, dy = (v[a, 0] - known_v[b, 0]) / motion, (v[a, 1] - known_v[b, 1]) / motion
            square += dx * dx + dy * dy
            if square > _CUT:
                continue
            w = math.exp(-0.5 * square)
            for h in range(min(ahead[b], age)):
                weight[h] += w
                out[a, h, 0] += w * deviation[b, h, 0]
                out[a, h, 1] += w * deviation[b, h, 1]
        for h in range(FUTURE):
            for i in range(2):
                out[a, h, i] /= weight[h] + _SHRINK
    return out


@cached_njit
def _follow_field(
    p: Array,
    v: Array,
    person: IntArray,
    now: IntArray,
    known_p: Array,
    known_v: Array,
    known_person: IntArray,
    known_at: IntArray,
    deviation: Array,
    place: float,
    width: float,
) -> Array:
    """At each sample the mean of what others did next here, going this way; without any, the last displacement."""
    out = np.zeros((len(p), FUTURE, 2))
    for a in range(len(p)):
        x, y, vx, vy = p[a, 0], p[a, 1], v[a, 0], v[a, 1]
        for h in range(FUTURE):
            speed = max(math.hypot(vx, vy), 1e-9)
            total, sx, sy = _SHRINK, _SHRINK * vx, _SHRINK * vy
            for b in range(len(known_p)):
                if known_at[b] + 1 > now[a]:
                    break
                dx, dy = (x - known_p[b, 0]) / place, (y - known_p[b, 1]) / place
                square = dx * dx + dy * dy
                if square > _CUT or known_person[b] == person[a]:
                    continue
                other = max(math.hypot(known_v[b, 0], known_v[b, 1]), 1e-9)
                dx = (vx / speed - known_v[b, 0] / other) / width
                dy = (vy / speed - known_v[b, 1] / other) / width
                square += dx * dx + dy * dy
                if square > _CUT:
                    continue
                w = math.exp(-0.5 * square)
                total += w
                sx += w * (known_v[b, 0] + deviation[b, 0, 0])
                sy += w * (known_v[b, 1] + deviation[b, 0, 1])
            vx, vy = sx / total, sy / total
            x, y = x + vx, y + vy
            out[a, h, 0], out[a, h, 1] = x - p[a, 0], y - p[a, 1]
    return out
