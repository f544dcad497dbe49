"""Targets that follow a record: `camnet.motion.replay`, one step of one target."""

from __future__ import annotations

import math

from camnet.batch.compiled import inner
from camnet.batch.target_field import set_planar, wrapped
from camnet.batch.target_laws import Targets
from camnet.types import Array

__all__ = ["step_track"]


@inner
def _knot_before(t: Targets, first: int, n: int, at: float) -> int:
    """Last of ``n`` knots of a track from ``first`` on that is not after ``at``; the last piece at most."""
    low, high = 0, n - 1
    while high - low > 1:
        middle = (low + high) // 2
        if t.track_t[first + middle] <= at:
            low = middle
        else:
            high = middle
    return int(first + low)


@inner
def step_track(t: Targets, m: int, now: Array, inner: Array, e: int, t_s: float, dt: float) -> None:
    """`ReplayMotion.step`: the state at ``t_s + dt``."""
    first, n = t.track_first[m], t.track_first[m + 1] - t.track_first[m]
    at = t.shape[m, 0] + t_s + dt
    theta, w_max = inner[e, m, 0], t.shape[m, 6]
    px, py, pz, vx, vy, vz = t.shape[m, 7], t.shape[m, 8], t.shape[m, 9], 0.0, 0.0, 0.0
    goal = t.track_heading[first]
    if n > 1:
        clamped = min(max(at, t.track_t[first]), t.track_t[first + n - 1])
        k = _knot_before(t, first, n, clamped)
        h, c = clamped - t.track_t[k], t.track_c[k]
        px = ((c[0, 0] * h + c[1, 0]) * h + c[2, 0]) * h + c[3, 0]
        py = ((c[0, 1] * h + c[1, 1]) * h + c[2, 1]) * h + c[3, 1]
        pz = ((c[0, 2] * h + c[1, 2]) * h + c[2, 2]) * h + c[3, 2]
        if t.track_t[first] <= at < t.track_t[first + n - 1]:
            vx = (3.0 * c[0, 0] * h + 2.0 * c[1, 0]) * h + c[2, 0]
            vy = (3.0 * c[0, 1] * h + 2.0 * c[1, 1]) * h + c[2, 1]
            vz = (3.0 * c[0, 2] * h + 2.0 * c[1, 2]) * h + c[2, 2]
        share = h / (t.track_t[k + 1] - t.track_t[k])
        goal = t.track_heading[k] + share * (t.track_heading[k + 1] - t.track_heading[k])
    w = 0.0
    if math.isnan(goal) and math.sqrt(vx * vx + vy * vy) > t.shape[m, 1]:
        goal = math.atan2(vy, vx)
    if not math.isnan(goal):
        w = min(max(wrapped(goal - theta) / dt, -w_max), w_max)
    theta += w * dt
    set_planar(now, e, m, px, py, pz, theta, 0.0, w)
    now[e, m, 7], now[e, m, 8], now[e, m, 9] = vx, vy, vz
    inner[e, m, 0] = theta
