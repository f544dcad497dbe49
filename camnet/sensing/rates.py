"""Velocities from poses, by regression over the most recent ones (parikh2018, section VII: the last 20).

| symbol | meaning |
| --- | --- |
| ``s_i = (t_i - t_N) / T`` | time before the newest sample, over the length of the window |
| ``r_i = log(q_N^-1 q_i)`` | rotation vector from the newest orientation, in its body frame |
| ``y_i = [p_i ; r_i]`` | fitted by ``c0 + c1 s (+ c2 s^2)``; the rates are ``c1 / T`` |

Since ``q(t) = q_N exp(r(t))`` with ``r(t_N) = 0``, the slope of r at the newest sample is the angular velocity in the
body frame, without any small-angle approximation.

Degree 1 is what parikh2018 used, there at 360 Hz: it gives the rates in the middle of the window. Degree 2 gives
those at its end, with about four times the noise: for n samples dt apart and noise s the standard deviation is
``s sqrt(12 / n^3) / dt`` against ``s sqrt(192 / n^3) / dt``.
"""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from camnet.compiled import cached_njit
from camnet.geometry.rotations_compiled import conjugate, log, multiply
from camnet.types import Array, Twist

__all__ = ["RateRegression", "regress_rates"]


@cached_njit
def _slopes(t: Array, p: Array, q: Array, newest: int, degree: int) -> Array:
    """Rates (6,) at sample ``newest``; NaN where the times do not determine them."""
    n = t.shape[0]
    length = t[newest] - np.min(t)
    out = np.full(6, np.nan)
    if length <= 0.0:
        return out
    inverse = conjugate(q[newest])
    y = np.empty((n, 6))
    mean = np.zeros(6)
    m1 = m2 = 0.0
    for i in range(n):
        s = (t[i] - t[newest]) / length
        m1 += s / n
        m2 += s * s / n
        y[i, :3] = p[i] - p[newest]
        y[i, 3:] = log(multiply(inverse, q[i]))
        mean += y[i] / n
    # sums about the mean: a = s - m1, b = s^2 - m2
    aa = ab = bb = 0.0
    ay = np.zeros(6)
    by = np.zeros(6)
    for i in range(n):
        s = (t[i] - t[newest]) / length
        a, b = s - m1, s * s - m2
        aa += a * a
        ab += a * b
        bb += b * b
        for k in range(6):
            ay[k] += a * (y[i, k] - mean[k])
            by[k] += b * (y[i, k] - mean[k])
    if degree == 1:
        out[:] = ay / (aa * length)
        return out
    det = aa * bb - ab * ab
    if det > 1e-12 * aa * bb:
        out[:] = (bb * ay - ab * by) / (det * length)
    return out


def regress_rates(t: ArrayLike, p: ArrayLike, q: ArrayLike, degree: Literal[1, 2] = 1) -> Twist | None:
    """Rates at the last of n poses at times t (n,) s, positions p (n, 3) m, orientations q (n, 4) of either sign.

    Returns
    -------
    Twist or None
        Velocity in the frame of the positions and angular velocity in the body frame; None when there are too few
        different times.
    """
    times = np.ascontiguousarray(t, dtype=np.float64)
    slopes = _slopes(
        times,
        np.ascontiguousarray(p, dtype=np.float64),
        np.ascontiguousarray(q, dtype=np.float64),
        len(times) - 1,
        degree,
    )
    return None if math.isnan(slopes[0]) else Twist(slopes[:3], slopes[3:])


class RateRegression:
    """Rates of one body from a moving window of its poses.

    Parameters
    ----------
    window : number of samples in the window
    degree : 1 or 2, see above
    min_samples : samples from which on rates are given; the whole window if None
    max_gap_s : a longer time between two samples empties the window; never if None
    """

    def __init__(
        self,
        window: int,
        degree: Literal[1, 2] = 1,
        min_samples: int | None = None,
        max_gap_s: float | None = None,
    ) -> None:
        least = degree + 2
        self._min = window if min_samples is None else min_samples
        if not least <= self._min <= window:
            raise ValueError(
                f"window {window} and min_samples {self._min}: degree {degree} needs {least} <= min_samples <= window"
            )
        self._degree = degree
        self._max_gap_s = math.inf if max_gap_s is None else max_gap_s
        self._t: Array = np.zeros(window)
        self._p: Array = np.zeros((window, 3))
        self._q: Array = np.zeros((window, 4))
        self.reset()

    def reset(self) -> None:
        """Forget all samples."""
        self._count = 0
        self._newest = -1
        self._last_s = -math.inf

    def push(self, t_s: float, p: Array, q: Array) -> None:
        """Add the pose p (3,), q (4,) at time ``t_s``, not before the last one.

        Raises
        ------
        ValueError
            When time runs backwards.
        """
        if t_s < self._last_s:
            raise ValueError(
                f"sample at {t_s} s after one at {self._last_s} s: push samples in the order of time"
            )
        if t_s - self._last_s > self._max_gap_s:
            self.reset()
        self._last_s = t_s
        i = self._newest = (self._newest + 1) % len(self._t)
        self._t[i], self._p[i], self._q[i] = t_s, p, q
        self._count = min(self._count + 1, len(self._t))

    def rates(self) -> Twist | None:
        """Velocity in the frame of the positions and angular velocity in the body frame; None with too few samples."""
        if self._count < self._min:
            return None
        n = self._count
        slopes = _slopes(self._t[:n], self._p[:n], self._q[:n], self._newest, self._degree)
        return None if math.isnan(slopes[0]) else Twist(slopes[:3], slopes[3:])
