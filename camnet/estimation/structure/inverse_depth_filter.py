"""Distance observer 4: an extended Kalman filter on (x/z, y/z, 1/z) of each feature (bell2019, section 3.4).

| symbol | name | shape | unit | equation |
| --- | --- | --- | --- | --- |
| ``y`` | ``state`` | (N, 3) | -, -, 1/m | (x/z, y/z, 1/z) |
| ``y1' = (y1 v_z - v_x) y3 + y1 y2 w_x - (1 + y1^2) w_y + y2 w_z`` | | | 1/s | motion of a stationary point |
| ``y2' = (y2 v_z - v_y) y3 + (1 + y2^2) w_x - y1 y2 w_y - y1 w_z`` | | | 1/s | |
| ``y3' = v_z y3^2 + (y2 w_x - y1 w_y) y3`` | | | 1/m/s | |
| ``R``, ``Q``, ``P_0`` | | | | ``r I2``, ``r diag(100, 100, 1e5)``, ``r diag(1, 1, 1.5e5)``, ``r = 1e-5`` |

Whether Q is per second or per step is not published; here it is per second, the density of the continuous filter.
The state is moved exactly, as the point ``p = (y1, y2, 1) / y3`` in the moving camera frame, and so is its Jacobian.
"""

from __future__ import annotations

import numpy as np

from camnet.estimation.structure.key_view import KeyView
from camnet.estimation.structure.observer_settings import ObserverSettings
from camnet.geometry.rotations import exp, to_matrix
from camnet.types import Array

__all__ = ["InverseDepthFilter"]


class InverseDepthFilter:
    """Observer 4; feed it `KeyView` after `KeyView`.

    Parameters
    ----------
    count : number N of features
    settings : see `ObserverSettings`
    """

    def __init__(self, count: int, settings: ObserverSettings) -> None:
        self._s = settings
        r = settings.filter_r
        self.state = np.zeros((count, 3))
        self.state[:, 2] = 1.0 / settings.start_m
        self.covariance = np.tile(np.diag(r * np.array(settings.filter_p)), (count, 1, 1))
        self._q, self._r = np.diag(r * np.array(settings.filter_q)), r * np.eye(2)
        self._started = False
        self._v = self._w = np.zeros(3)

    def depths(self, view: KeyView) -> Array:
        """``z`` (N,) in m, within the range of distances."""
        low, high = self._s.distance_m
        return np.asarray(1.0 / np.clip(self.state[:, 2], 1.0 / high, 1.0 / low))

    def update(self, view: KeyView) -> None:
        """Advance over the frame that led to ``view`` and take it in."""
        seen = view.seen
        z = view.u_ic[seen, :2] / view.u_ic[seen, 2:]
        if not self._started:
            self.state[seen, :2] = z
            self._started = True
        else:
            self._move(view.dt_s, 0.5 * (self._v + view.v_cam), 0.5 * (self._w + view.w_cam))
        self._v, self._w = view.v_cam, view.w_cam
        p = self.covariance[seen]
        s = p[:, :2, :2] + self._r
        gain = p[:, :, :2] @ np.linalg.inv(s)
        self.state[seen] += np.squeeze(gain @ (z - self.state[seen, :2])[..., None], -1)
        p = p - gain @ p[:, :2, :]
        self.covariance[seen] = 0.5 * (p + np.swapaxes(p, 1, 2))

    def _move(self, dt: float, v: Array, w: Array) -> None:
        """Exact motion: ``m = (y1, y2, 1)`` goes to ``R m - y3 t``; R, t of the camera's own motion."""
        turn = to_matrix(exp(-dt * w))
        shift = to_matrix(exp(-0.5 * dt * w)) @ v * dt
        m = np.column_stack([self.state[:, :2], np.ones(len(self.state))])
        moved = m @ turn.T - self.state[:, 2:] * shift
        scale = 1.0 / np.maximum(moved[:, 2], 0.05)
        after = np.column_stack([moved[:, :2] * scale[:, None], self.state[:, 2] * scale])
        # d(moved)/d(y1, y2, y3), then the division by its third component
        inner = np.concatenate(
            [np.broadcast_to(turn[:, :2], (len(m), 3, 2)), np.broadcast_to(-shift[:, None], (len(m), 3, 1))],
            axis=2,
        )
        rows = inner.copy()
        rows[:, 2] = [0.0, 0.0, 1.0]
        jacobian = (rows - after[:, :, None] * inner[:, 2:3, :]) * scale[:, None, None]
        self.state = after
        self.covariance = jacobian @ self.covariance @ np.swapaxes(jacobian, 1, 2) + dt * self._q
