"""Distance observers 1 and 2 by integral concurrent learning (bell2019, sections 3.1 and 3.2).

| symbol | name | shape | unit | equation |
| --- | --- | --- | --- | --- |
| ``d_hat_{i/c}`` | ``d_ic`` | (N,) | m | ``d' = Om_1 [+ k (xi^T rho - xi^T xi d)] + [k1 (h_1 - d)]`` |
| ``d_hat_{k/c}`` | ``d_kc`` | | m | ``d' = Om_2 + [k2 (h_2 - d)]``, h_2 the mean over the features |
| ``d_hat_{i/k}`` | ``d_ik`` | (N,) | m | ``d' = [k3 (X - d)]`` |
| ``h_i = psi_i X_i`` | | (N, 2) | m | once learned, `stack.DistanceStack` |
| ``xi``, ``rho`` | | (N, 3) | 1/s, m/s | optical flow, `flow.FlowWindow`; observer 2 (extended) only |

Each law is linear, ``d' = Om + c - a d``, and what it steers to, ``c/a``, moves at Om itself: over a frame the distance
is first moved by ``int Om``, then ``d+ = c/a + (d - c/a) exp(-a dt)`` exactly (k xi^T xi is stiff for near points).
Departure from print: the flow is formed over
a window, so it speaks of the distance at the window's middle, which is the present one less the way since.
"""

from __future__ import annotations

import math

import numpy as np

from camnet.estimation.structure.flow import FlowWindow
from camnet.estimation.structure.key_view import KeyView
from camnet.estimation.structure.observer_settings import ObserverSettings
from camnet.estimation.structure.stack import DistanceStack
from camnet.types import Array, BoolArray

__all__ = ["DistanceObserver"]


class DistanceObserver:
    """Observer 1, or 2 where ``extended``; feed it `KeyView` after `KeyView` of one key frame.

    Parameters
    ----------
    count : number N of the key frame's features
    settings : see `ObserverSettings`
    extended : use the optical flow (observer 2)
    """

    def __init__(self, count: int, settings: ObserverSettings, extended: bool) -> None:
        self._s = settings
        self._flow = FlowWindow(settings.flow_s) if extended else None
        self.stack = DistanceStack(count, settings)
        self.d_ic = np.full(count, settings.start_m)
        self.d_ik = np.full(count, settings.start_m)
        self.d_kc = 0.0
        self._u = self._u_kc = np.full(3, np.nan)
        self._v = np.zeros(3)

    @property
    def learned(self) -> BoolArray:
        """Whether each distance is learned (N,)."""
        return self.stack.learned

    def depths(self, view: KeyView) -> Array:
        """``z`` (N,) in m: the estimated distances along the optical axis of a view."""
        return np.asarray(self.d_ic * view.u_ic[:, 2])

    def update(self, view: KeyView) -> None:
        """Advance over the frame that led to ``view`` and take it in."""
        s, dt = self._s, view.dt_s
        travelled = self._travelled(view)
        self.stack.update(view, travelled)
        a, c = np.zeros_like(self.d_ic), np.zeros_like(self.d_ic)
        if self._flow is not None:
            flow = self._flow.update(view, travelled[:, 0])
            if flow is not None:
                power = s.k * np.sum(flow.xi * flow.xi, axis=1)
                drive = s.k * np.sum(flow.xi * flow.rho, axis=1) - power * flow.lag_m
                usable = np.isfinite(power + drive)
                a[usable] += power[usable]
                c[usable] += drive[usable]
        h = self.stack.psi * self.stack.distance[:, None]
        usable = np.isfinite(h[:, 0])
        a[usable] += s.k1
        c[usable] += s.k1 * h[usable, 0]
        self.d_ic = exact_step(self.d_ic + travelled[:, 0], a, c, dt)
        keep = math.exp(-s.k1 * dt)
        self.d_kc += float(np.mean(travelled[:, 1]))
        if usable.any():
            self.d_kc = keep * self.d_kc + (1.0 - keep) * float(np.mean(h[usable, 1]))
        learned = self.stack.learned
        self.d_ik[learned] = keep * self.d_ik[learned] + (1.0 - keep) * self.stack.distance[learned]

    def _travelled(self, view: KeyView) -> Array:
        """``int Om`` (N, 2) in m over the frame, by the trapezoidal rule; what is unseen moves as at the other end."""
        v_then, v = self._v, view.v_cam
        out = np.zeros((len(self.d_ic), 2))
        if view.dt_s > 0.0 and not view.at_key:
            then, now = -self._u @ v_then, -view.u_ic @ v
            then = np.where(np.isfinite(then), then, now)
            out[:, 0] = 0.5 * view.dt_s * (then + np.where(np.isfinite(now), now, then))
            k_now = -view.u_kc @ v
            k_then = -self._u_kc @ v_then
            k_then = k_then if np.isfinite(k_then) else k_now
            out[:, 1] = 0.5 * view.dt_s * (k_then + k_now)
            out = np.nan_to_num(out)
        self._u, self._u_kc, self._v = view.u_ic, view.u_kc, v
        return out


def exact_step(x: Array, a: Array, c: Array, dt_s: float) -> Array:
    """Solution (N,) after ``dt_s`` of ``x' = c - a x`` with constants a >= 0, c (N,)."""
    decay = np.exp(-a * dt_s)
    # (1 - exp(-a dt)) / a, dt for a = 0
    reach = np.where(a * dt_s > 1e-9, (1.0 - decay) / np.where(a > 0.0, a, 1.0), dt_s)
    return np.asarray(decay * x + reach * c)
