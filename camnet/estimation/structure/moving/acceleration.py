"""Acceleration model of a moving target by integral concurrent learning (bell2019, section 5.3).

| symbol | name | shape | unit | equation |
| --- | --- | --- | --- | --- |
| ``nu = [v_m; w_m]`` | ``nu`` | (6,) | m/s, rad/s | target's velocities, in axes that do not turn with the camera |
| ``sigma`` | ``Basis`` | (L,) | | ``[1; nu; kernels of the place]``, see below |
| ``W`` | ``weights`` | (L, 6) | | ``nu' = W^T sigma + eps`` |
| ``Y_m = int sigma^T`` | | (1, L) | s | over a window of ``window_s`` |
| ``U_m = nu(t) - nu(t - s_w)`` | | (1, 6) | | |
| ``Y_S``, ``U_S`` | ``gram``, ``moment`` | (L, L), (L, 6) | | ``sum Y^T Y``, ``sum Y^T U`` |
| ``W'`` | ``step`` | | | ``Gamma sigma nu~^T + Gamma k_W (U_S - Y_S W)``, taken implicitly |

sigma: kernels over the place in the ground plane (of any origin) are normalised by their sum plus a floor, so that far
away they vanish instead of dividing zero by zero. Departures from print: the paper learns nu' in the camera frame,
where it holds ``-w_c^x v_m``, which is no function of target and camera poses and of nu; here nu is in scene axes. The
condition ``lmin(Y_S) > lambda`` with L kernels is never met by real data; a ridge takes its place. The learning law is
stiff and linear, so it is integrated implicitly.
"""

from __future__ import annotations

import numpy as np

from camnet.settings import Positive, Settings
from camnet.types import Array

__all__ = ["AccelerationModel", "AccelerationSettings"]


class AccelerationSettings(Settings):
    """``gamma``, ``k_w``: gains. ``ridge``: share of the mean diagonal of Y_S. ``width_m``: of the kernels."""

    window_s: Positive = 1.0
    gamma: Positive = 1.0
    k_w: Positive = 10.0
    ridge: Positive = 1e-3
    width_m: Positive = 0.7
    floor: Positive = 1e-3


class AccelerationModel:
    """Learns ``nu' = W^T sigma(p, nu)`` from windows; ``rate`` is what it says.

    Parameters
    ----------
    settings : see there
    centres : (M, 2) kernels in the ground plane, m
    """

    def __init__(self, settings: AccelerationSettings, centres: Array) -> None:
        self._s, self._centres = settings, centres
        size = len(centres) + 7
        self.weights = np.zeros((size, 6))
        self.gram, self.moment = np.zeros((size, size)), np.zeros((size, 6))
        self.windows = 0
        self._inverse: Array = np.eye(size)
        self._for = (0, 0.0)

    def sigma(self, p: Array, nu: Array) -> Array:
        """Regressors (..., L) at positions (..., 3), m, and velocities (..., 6), scene axes."""
        square = np.sum((np.asarray(p)[..., None, :2] - self._centres) ** 2, axis=-1)
        kernels = np.exp(-0.5 * square / self._s.width_m**2)
        kernels = kernels / (np.sum(kernels, axis=-1, keepdims=True) + self._s.floor)
        one = np.ones_like(kernels[..., :1])
        return np.concatenate([one, nu, kernels], axis=-1)

    def rate(self, p: Array, nu: Array) -> Array:
        """``nu'`` (6,) in m/s^2 and rad/s^2."""
        return np.asarray(self.sigma(p, nu) @ self.weights)

    def add_window(self, row: Array, change: Array) -> None:
        """Take in a window: ``int sigma`` (L,) and the change of nu (6,)."""
        self.gram += np.outer(row, row)
        self.moment += np.outer(row, change)
        self.windows += 1

    def learn_stretch(self, t_s: Array, p: Array, nu: Array) -> None:
        """Take in a seen stretch (K,), (K, 3), (K, 6) as windows that follow each other by half their length."""
        if len(t_s) < 2:
            return
        rows = self.sigma(p, nu)
        steps = 0.5 * (rows[1:] + rows[:-1]) * np.diff(t_s)[:, None]
        whole = np.vstack([np.zeros(rows.shape[1]), np.cumsum(steps, axis=0)])
        start = float(t_s[0])
        while start + self._s.window_s <= t_s[-1] + 1e-9:
            a, b = (int(np.argmin(np.abs(t_s - x))) for x in (start, start + self._s.window_s))
            self.add_window(whole[b] - whole[a], nu[b] - nu[a])
            start += 0.5 * self._s.window_s

    def step(self, dt_s: float, sigma: Array | None = None, error: Array | None = None) -> None:
        """Advance the weights by ``dt_s``; with feedback ``sigma`` (L,), ``nu~`` (6,) while the target is seen."""
        s = self._s
        right = self.weights + dt_s * s.gamma * s.k_w * self.moment
        if sigma is not None and error is not None:
            right = right + dt_s * s.gamma * np.outer(sigma, error)
        self.weights = self._implicit(dt_s) @ right

    def _implicit(self, dt_s: float) -> Array:
        """``(I + dt Gamma k_W (Y_S + ridge I))^-1``, kept while neither changes."""
        if self._for != (self.windows, dt_s):
            s, size = self._s, len(self.gram)
            ridge = s.ridge * float(np.trace(self.gram)) / size
            whole = np.eye(size) + dt_s * s.gamma * s.k_w * (self.gram + ridge * np.eye(size))
            self._inverse, self._for = np.asarray(np.linalg.inv(whole)), (self.windows, dt_s)
        return self._inverse
