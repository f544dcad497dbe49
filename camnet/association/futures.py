"""Several futures: which view will see a target next, and when, as a weighted set with a density of time each.

| symbol | name | shape | unit |
| --- | --- | --- | --- |
| x, v | place and velocity of the exit | (2,), (2,) | m, m/s |
| w_l | weight of lesson l | - | |
| k | outcome: a view, or leaving for good | - | |
| pi_k | weight of outcome k | - | |
| g_k(t) | density of the time away, given k | - | 1/s |

``w_l = exp(-(|x - x_l|^2 / s_x^2 + |v - v_l|^2 / s_v^2) / 2 - |t - t_l| / tau)``; exits of another view do not count.

``pi_k = (a b_k + sum_l w_l [k_l = k]) / (a + sum_l w_l)``: the posterior mean under a Dirichlet prior of strength a
about b, the shares over all exits of the view, themselves drawn towards equal ones (counting; a hierarchy of two
Dirichlet priors, MacKay and Peto 1995, eq. 16).

``g_k`` is a mixture of normals in the logarithm of the time, one at every lesson of outcome k; its median and its
intervals are those of the weighted lessons. Intervals are widened about the median by the factor with which they would
have held the stated share of the teaching crossings, each predicted without itself (conformal, Vovk et al. 2005).

A mean over the outcomes is not given: it lies where nobody comes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from camnet.association.settings import FutureSettings
from camnet.errors import DataError
from camnet.types import Array, IntArray

__all__ = ["LEAVES", "Branch", "FutureLessons", "Futures"]

#: outcome of targets that no view sees again
LEAVES = -1
_FAR = 40.0


@dataclass(frozen=True, eq=False, slots=True)
class FutureLessons:
    """Crossings, n of them.

    Attributes
    ----------
    view : (n,) view that was left
    p_world, v_world : (n, 2) place and velocity at the exit, m and m/s
    t_s : (n,) time of the exit, s
    outcome : (n,) view that came next, or ``LEAVES``
    away_s : (n,) time until then, s; of no meaning for those that left
    """

    view: IntArray
    p_world: Array
    v_world: Array
    t_s: Array
    outcome: IntArray
    away_s: Array


@dataclass(frozen=True, eq=False, slots=True)
class Branch:
    """One future.

    Attributes
    ----------
    outcome : view, or ``LEAVES``
    weight : its probability
    times_s, shares : (n,), (n,) times away of lessons, ascending, and their shares, which sum to 1
    log_width : standard deviation of each lesson's normal in the logarithm of the time
    widening : factor of intervals about the median
    """

    outcome: int
    weight: float
    times_s: Array
    shares: Array
    log_width: float
    widening: float

    def density(self, t_s: Array) -> Array:
        """Density (m,) of the time away, 1/s, at times (m,)."""
        if not len(self.times_s):
            return np.zeros(len(t_s))
        z = (np.log(np.maximum(t_s, 1e-9))[:, None] - np.log(self.times_s)) / self.log_width
        bells = np.exp(-0.5 * z * z) / (np.sqrt(2.0 * np.pi) * self.log_width)
        return np.asarray(bells @ self.shares / np.maximum(t_s, 1e-9))

    def quantile(self, share: float) -> float:
        """Time away below which a share of the lessons lies, s; NaN without lessons."""
        if not len(self.times_s):
            return float("nan")
        middle = np.cumsum(self.shares) - 0.5 * self.shares
        return float(np.interp(share, middle, self.times_s))

    def interval(self, share: float) -> tuple[float, float]:
        """Interval of the time away that holds a share, s."""
        low, median, high = (self.quantile(q) for q in (0.5 - share / 2, 0.5, 0.5 + share / 2))
        return max(median - self.widening * (median - low), 0.0), median + self.widening * (high - median)


class Futures:
    """Learned branches: frequencies and travel times.

    Parameters
    ----------
    lessons : at least one
    views : number of views
    settings : scales and priors

    Raises
    ------
    DataError
        There is no lesson.
    """

    def __init__(self, lessons: FutureLessons, views: int, settings: FutureSettings | None = None) -> None:
        if not len(lessons.view):
            raise DataError("futures: no crossing to learn from; at least one was expected")
        self._lessons = lessons
        self._views = views
        self._settings = settings or FutureSettings()
        self._widening = 1.0
        if self._settings.calibrate:
            self._widening = self._calibrated()

    def predict(self, view: int, p_world: Array, v_world: Array, t_s: float) -> tuple[Branch, ...]:
        """Return every outcome, the likeliest first, of a target that leaves ``view`` at ``t_s``."""
        return self._predict(view, p_world, v_world, t_s, -1)

    def _predict(self, view: int, p: Array, v: Array, t_s: float, without: int) -> tuple[Branch, ...]:
        s, n = self._settings, self._lessons
        same = np.flatnonzero(n.view == view)
        same = same[same != without]
        d = np.sum((n.p_world[same] - p) ** 2, axis=1) / s.position_scale_m**2
        d += np.sum((n.v_world[same] - v) ** 2, axis=1) / s.velocity_scale_mps**2
        if s.recency_s is not None:
            d += 2.0 * np.abs(n.t_s[same] - t_s) / s.recency_s
        w = np.exp(-0.5 * np.minimum(d, 2.0 * _FAR))
        outcomes = np.arange(-1, self._views)
        slot = n.outcome[same] + 1
        all_ = np.bincount(slot, minlength=len(outcomes)) + s.equal_strength / len(outcomes)
        base = all_ / all_.sum()
        weight = (s.prior_strength * base + np.bincount(slot, w, len(outcomes))) / (
            s.prior_strength + w.sum()
        )
        order = np.argsort(-weight, kind="stable")
        return tuple(
            self._branch(int(outcomes[k]), float(weight[k]), same[slot == k], w[slot == k]) for k in order
        )

    def _branch(self, outcome: int, weight: float, rows: IntArray, w: Array) -> Branch:
        s = self._settings
        empty = outcome == LEAVES or not len(rows) or not w.sum() > 0.0
        if empty:
            return Branch(outcome, weight, np.empty(0), np.empty(0), s.log_time_width, self._widening)
        times = np.maximum(self._lessons.away_s[rows], 1e-3)
        order = np.argsort(times, kind="stable")
        return Branch(outcome, weight, times[order], w[order] / w.sum(), s.log_time_width, self._widening)

    def _calibrated(self) -> float:
        """Widening with which intervals hold the stated share of the lessons, each predicted without itself."""
        n, share = self._lessons, self._settings.coverage
        came = np.flatnonzero(n.outcome != LEAVES)
        ratios = []
        for k in came[:: max(len(came) // self._settings.calibration_size, 1)]:
            found = self._predict(int(n.view[k]), n.p_world[k], n.v_world[k], float(n.t_s[k]), int(k))
            branch = next(b for b in found if b.outcome == n.outcome[k])
            if not len(branch.times_s):
                continue
            low, median, high = (branch.quantile(q) for q in (0.5 - share / 2, 0.5, 0.5 + share / 2))
            off = n.away_s[k] - median
            reach = high - median if off > 0 else median - low
            ratios.append(abs(off) / max(reach, 1e-6) if off else 0.0)
        return float(np.quantile(ratios, share)) if ratios else 1.0
