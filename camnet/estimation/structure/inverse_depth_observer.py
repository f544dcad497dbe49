"""Distance observer 3: the inverse-depth observer of Dani, Fischer, Kan, Dixon, Mechatronics 22(4), 2012.

| symbol | name | shape | unit | equation |
| --- | --- | --- | --- | --- |
| ``y = [x/z, y/z, 1/z]`` | ``inverse`` (y3) | (N,) | 1/m | state: y1, y2 are measured |
| ``xi = [y1 v_z - v_x, y2 v_z - v_y]`` | | (N, 2) | m/s | ``[y1', y2'] = Om + xi y3`` |
| ``Om`` | | (N, 2) | 1/s | the part of the flow that turning makes |
| ``y3' = v_z y3^2 + (y2 w_x - y1 w_y) y3 + k xi^T ([y1', y2'] - Om - xi y3)`` | | | 1/m/s | the observer |

The flow less ``Om`` is formed as in `flow`, over a window: with ``f = R_bm^T xi_3d`` the derotated flow of the unit
vector at the middle image, the flow of (x/z, y/z) is ``(f_xy - y f_z) / u_z``. The quadratic term is stepped exactly
(Riccati), the linear ones after it. The state is kept in the inverse of the range of depths, without which the
quadratic term runs away in finite time for a start nearer than the truth while the camera moves forward.
"""

from __future__ import annotations

import numpy as np

from camnet.estimation.structure.flow import FlowWindow
from camnet.estimation.structure.key_view import KeyView
from camnet.estimation.structure.observer_settings import ObserverSettings
from camnet.types import Array

__all__ = ["InverseDepthObserver"]


class InverseDepthObserver:
    """Observer 3; feed it `KeyView` after `KeyView`.

    Parameters
    ----------
    count : number N of features
    settings : see `ObserverSettings`
    """

    def __init__(self, count: int, settings: ObserverSettings) -> None:
        self._s = settings
        self._flow = FlowWindow(settings.flow_s)
        self.inverse = np.full(count, 1.0 / settings.start_m)

    def depths(self, view: KeyView) -> Array:
        """``z`` (N,) in m."""
        return np.asarray(1.0 / self.inverse)

    def update(self, view: KeyView) -> None:
        """Advance over the frame that led to ``view`` and take it in."""
        dt, (v, w), y3 = view.dt_s, (view.v_cam, view.w_cam), self.inverse
        flow = self._flow.update(view, np.zeros(len(y3)))
        y = view.u_ic[:, :2] / view.u_ic[:, 2:]
        y = np.where(np.isfinite(y), y, 0.0)
        # y3' = v_z y3^2 has the solution y3 / (1 - v_z y3 dt)
        y3 = y3 / np.maximum(1.0 - v[2] * y3 * dt, 0.1)
        xi = y * v[2] - v[:2]
        a, c = w[1] * y[:, 0] - w[0] * y[:, 1], np.zeros_like(y3)
        if flow is not None:
            measured = (flow.xi[:, :2] - y * flow.xi[:, 2:]) / view.u_ic[:, 2:]
            drive = self._s.k_inverse * np.sum(xi * measured, axis=1)
            usable = np.isfinite(drive)
            a[usable] += self._s.k_inverse * np.sum(xi * xi, axis=1)[usable]
            c[usable] += drive[usable]
        decay = np.exp(-a * dt)
        reach = np.where(np.abs(a * dt) > 1e-9, (1.0 - decay) / np.where(a == 0.0, 1.0, a), dt)
        low, high = self._s.distance_m
        self.inverse = np.clip(decay * y3 + reach * c, 1.0 / high, 1.0 / low)
