"""First guesses of a plan: least-acceleration splines pushed out of obstacles, and their steering states.

A spline through the waypoints may cross an obstacle near its middle, where the push of the likelihood is along the path
and both sides are alike: a local optimum that no descent leaves. So for the obstacle that is hit first, points beside
it in evenly spaced directions across the path are tried as further points of the spline, and the one of least bending
and deepest remaining hit is kept (the rest are other homotopy classes, kept as second choices).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from camnet.control.planner.curve import Curve
from camnet.control.planner.distance_kernel import signed_distance
from camnet.types import Array

__all__ = ["Knots", "guesses", "states_of"]

_LIMIT_M = 200.0


@dataclass(frozen=True, eq=False, slots=True)
class Knots:
    """Times (m,) in s, ascending, and points (m,3) of a spline; the velocity ``v`` (3,) at its start."""

    t: Array
    p: Array
    v: Array
    at_rest: bool = False

    def insert(self, t: float, p: Array) -> Knots:
        """With one more point; a knot closer in time than a tenth of a step is moved instead."""
        k = int(np.searchsorted(self.t, t))
        return Knots(np.insert(self.t, k, t), np.insert(self.p, k, p, axis=0), self.v, self.at_rest)

    def spline(self) -> CubicSpline:
        """Curve of least integral of squared acceleration through the points."""
        if self.at_rest:
            return CubicSpline(self.t, self.p, bc_type=((1, self.v), (1, np.zeros(3))))
        return CubicSpline(self.t, self.p, bc_type=((1, self.v), (2, np.zeros(3))))


def _bending(spline: CubicSpline, t: Array) -> float:
    a = spline(t, 2)
    return float(np.sum(a * a) * (t[1] - t[0]))


def _ray(row: Array, origin: Array, direction: Array, clearance: float, t: float) -> Array:
    """Point on a ray from inside where the distance to the obstacle first is ``clearance``."""
    normal, low, high = np.empty(3), 0.0, 1.0
    while signed_distance(row, origin + high * direction, t, normal) < clearance and high < _LIMIT_M:
        high *= 2.0
    for _ in range(30):
        middle = 0.5 * (low + high)
        if signed_distance(row, origin + middle * direction, t, normal) < clearance:
            low = middle
        else:
            high = middle
    return np.asarray(origin + high * direction)


def _across(tangent: Array, first: Array, count: int) -> Array:
    """Return unit vectors (count,3) across ``tangent``, evenly spaced, the first one nearest to ``first``."""
    along = tangent / max(float(np.linalg.norm(tangent)), 1e-9)
    side = first - (first @ along) * along
    if np.linalg.norm(side) < 1e-6:
        side = np.cross(along, [0.0, 0.0, 1.0] if abs(along[2]) < 0.9 else [1.0, 0.0, 0.0])
    side /= np.linalg.norm(side)
    angle = 2.0 * np.pi * np.arange(count)[:, None] / count
    return np.asarray(np.cos(angle) * side + np.sin(angle) * np.cross(along, side))


def guesses(
    knots: Knots, rows: Array, clearance: float, tau: float, n: int, directions: int
) -> list[CubicSpline]:
    """Splines from best to worst: the straight one pushed out of obstacles (K,19) until it is ``clearance`` away."""
    times = tau * np.arange(n, dtype=np.float64)
    fine = np.arange(4 * n, dtype=np.float64) * (times[-1] / (4 * n - 1))
    chosen, alternatives = knots, []
    for _ in range(2 * len(rows)):
        spline = chosen.spline()
        gaps, when = Curve(spline(times), spline(times, 1), tau).clearance(rows, 0.05)
        hit = int(np.argmin(gaps)) if len(gaps) else -1
        if hit < 0 or gaps[hit] >= 0.5 * clearance:
            break
        ranked = _pushed(chosen, spline, rows, hit, float(when[hit]), clearance, tau, times, fine, directions)
        if not ranked:
            break
        chosen = ranked[0][1]
        alternatives += ranked[1:]
    alternatives.sort(key=lambda item: item[0])
    return [chosen.spline(), *(k.spline() for _, k in alternatives)]


def _pushed(
    knots: Knots, spline: CubicSpline, rows: Array, hit: int, t: float, clearance: float, tau: float, times: Array,
    fine: Array, directions: int,
) -> list[tuple[float, Knots]]:  # fmt: skip
    """Knots with a point beside obstacle ``hit`` at time ``t``, and how bad each is, best first."""
    row, p, tangent = rows[hit], spline(t), spline(t, 1)
    center = row[1:4] + t * row[4:7]
    if np.min(np.abs(knots.t - t)) < 0.1 * tau:
        return []
    out = []
    for direction in _across(tangent, p - center, directions):
        more = knots.insert(t, _ray(row, center, direction, clearance, t))
        curve = more.spline()
        gaps, _ = Curve(curve(times), curve(times, 1), tau).clearance(rows, 0.05)
        bad = _bending(curve, fine) + 20.0 * float(np.sum(np.maximum(0.5 * clearance - gaps, 0.0)))
        out.append((bad, more))
    return sorted(out, key=lambda item: item[0])


def states_of(x: Array, v: Array, a: Array, alpha: float, beta: float, rest_speed: float) -> Array:
    """States (n,10) whose power and turn rate give the accelerations ``a`` (n,3): p = r (a_t + alpha r + beta)."""
    r = np.linalg.norm(v, axis=1)
    safe = np.maximum(r, rest_speed)
    along = np.sum(a * v, axis=1) / safe
    turn = np.cross(v, a) / (safe**2)[:, None]
    size = np.linalg.norm(turn, axis=1, keepdims=True)
    turn *= np.minimum(1.0, 1.5 / np.maximum(size, 1e-12))
    power = safe * (along + alpha * safe + beta)
    return np.column_stack([x, v, power, turn])
