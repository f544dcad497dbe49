"""Integral windows from measured poses (parikh2018, below (7); harris2020 (3-11)).

| symbol | name | shape | unit |
| --- | --- | --- | --- |
| Y | ``row``: int sigma^T dtau | (p,) | s |
| Deta | ``increment``: columns as in ``propagate``, the window's duration in the unit column | (8,) | m, rad, s |

Twist form: the pose increment is ``[p1 - p0; log(q0^-1 q1)]``; the logarithm equals the integral of the body rate up to
a commutator of third order in the duration, and exactly when the axis does not turn. Stacked form:
``[p1 - p0; q1 - q0]`` with the sign carried continuously through the window.

Each end is the mean of ``average`` samples: averaging m windows that are shifted by one sample each gives
``mean(Deta) = mean(Y) W``, a valid window with the noise of its ends divided by sqrt(m). Windows follow each other
without overlap: the next begins with the samples at which the last one ended.
"""

from __future__ import annotations

import numpy as np

from camnet.compiled import cached_njit
from camnet.estimation.propagate import COLUMNS, UNIT
from camnet.geometry.rotations_compiled import align_sign, conjugate, log, multiply
from camnet.types import Array

__all__ = ["WindowCollector", "increment_of"]


def increment_of(p0: Array, q0: Array, p1: Array, q1: Array, duration: float, stacked: bool) -> Array:
    """Increment (8,) from pose 0 to pose 1 after ``duration`` s, the unit column included."""
    out = np.zeros(COLUMNS)
    out[0:3] = p1 - p0
    if stacked:
        out[3:7] = align_sign(q1, q0) - q0
    else:
        out[3:6] = log(multiply(conjugate(q0), q1))
    out[UNIT] = duration
    return out


@cached_njit
def _store(
    ts: Array, ps: Array, qs: Array, sigmas: Array, i: int, t: float, p: Array, q: Array, sigma: Array
) -> None:
    """Write sample ``i``, the quaternion with the sign of the one before."""
    ts[i] = t
    ps[i] = p
    sigmas[i] = sigma
    qs[i] = align_sign(q, qs[i - 1]) if i > 0 else q


class WindowCollector:
    """Collects samples and hands out a window each ``window_s`` of uninterrupted measurements.

    A window has n intervals of about one sensing period; with m-fold averaging it is made of n + m samples.
    """

    def __init__(self, kernels: int, window_s: float, period_s: float, average: int, stacked: bool) -> None:
        self._intervals = max(1, round(window_s / period_s))
        self._average = min(average, self._intervals)
        self._stacked = stacked
        capacity = self._intervals + self._average
        self._t = np.zeros(capacity)
        self._p = np.zeros((capacity, 3))
        self._q = np.zeros((capacity, 4))
        self._sigma = np.zeros((capacity, kernels))
        self._filled = 0

    def clear(self) -> None:
        """Forget the samples: the measurements were interrupted."""
        self._filled = 0

    def push(self, t_s: float, p: Array, q: Array, sigma: Array) -> tuple[Array, Array] | None:
        """Add a measured pose and its sigma (p,); returns (row, increment) when a window is complete."""
        _store(self._t, self._p, self._q, self._sigma, self._filled, t_s, p, q, sigma)
        self._filled += 1
        if self._filled < len(self._t):
            return None
        window = self._close()
        keep, m = self._intervals, self._average
        for array in (self._t, self._p, self._q, self._sigma):
            array[:m] = array[keep : keep + m]
        self._filled = m
        return window

    def _close(self) -> tuple[Array, Array]:
        n, m = self._intervals, self._average
        # trapezoid weights of each of the m shifted windows, averaged
        dt = np.diff(self._t)
        weights = np.zeros(n + m)
        for shift in range(m):
            weights[shift : shift + n] += 0.5 * dt[shift : shift + n]
            weights[shift + 1 : shift + n + 1] += 0.5 * dt[shift : shift + n]
        row = (weights / m) @ self._sigma
        duration = float(self._t[n : n + m].mean() - self._t[:m].mean())
        if self._stacked:
            out = np.zeros(COLUMNS)
            out[0:3] = self._p[n : n + m].mean(axis=0) - self._p[:m].mean(axis=0)
            out[3:7] = self._q[n : n + m].mean(axis=0) - self._q[:m].mean(axis=0)
            out[UNIT] = duration
            return row, out
        q0 = self._q[:m].mean(axis=0)
        q1 = self._q[n : n + m].mean(axis=0)
        p0, p1 = self._p[:m].mean(axis=0), self._p[n : n + m].mean(axis=0)
        return row, increment_of(p0, q0 / np.linalg.norm(q0), p1, q1 / np.linalg.norm(q1), duration, False)
