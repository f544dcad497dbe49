"""History stack of distances at the key frame, learned from windows of the motion (bell2019, section 3.1).

| symbol | name | shape | unit | equation |
| --- | --- | --- | --- | --- |
| ``Om_i`` | | (N, 2) | m/s | ``[-u_{i/c}^T v_c; -u_{k/c}^T v_c]`` |
| ``U_i`` | | (N, 2) | m | ``int_{t-s}^t Om_i`` |
| ``y_i`` | | (N, 2) | - | ``psi_i(t) - psi_i(t - s)``, so that ``y_i d_{i/k} = U_i`` |
| ``YY``, ``YU`` | ``yy``, ``yu`` | (N,) | -, m | ``sum y^T y``, ``sum y^T U`` |
| ``X_i`` | ``distance`` | (N,) | m | ``YU / YY`` once ``YY > lambda``: ``d_{i/k}``, learned |

A window begins at the key frame itself, where ``psi = [1; 0]`` exactly, while that is no more than ``window_s`` ago;
after that at the oldest informative image not older. A sample is taken where ``|y|`` and ``|U|`` exceed their bounds
and the distance it implies, ``y^T U / y^T y``, lies in the range of distances (Remark 3.2). The stack keeps all
samples: the sum of a scalar problem needs no selection; after ``stack_size`` of them nothing more is learned.
"""

from __future__ import annotations

from collections import deque

import numpy as np

from camnet.estimation.structure.geometry import distance_ratios, excitation
from camnet.estimation.structure.key_view import KeyView
from camnet.estimation.structure.observer_settings import ObserverSettings
from camnet.types import Array, BoolArray

__all__ = ["DistanceStack"]


class DistanceStack:
    """Stacks of N features.

    Parameters
    ----------
    count : N
    settings : see `ObserverSettings`
    """

    def __init__(self, count: int, settings: ObserverSettings) -> None:
        self._s = settings
        self.yy, self.yu = np.zeros(count), np.zeros(count)
        self.samples = np.zeros(count, dtype=np.int64)
        self.psi = np.full((count, 2), np.nan)
        self._integral = np.zeros((count, 2))
        self._past: deque[tuple[float, Array, Array]] = deque()

    @property
    def learned(self) -> BoolArray:
        """Whether ``YY > lambda`` (N,)."""
        return np.asarray(self.yy > self._s.stack_lambda)

    @property
    def distance(self) -> Array:
        """``X`` (N,) in m, NaN where not learned."""
        return np.where(self.learned, self.yu / np.where(self.learned, self.yy, 1.0), np.nan)

    def update(self, view: KeyView, travelled: Array) -> None:
        """Take one view; ``travelled`` (N, 2) is the integral of Om over the frame that led to it, m."""
        self._integral = self._integral + travelled
        if view.at_key:
            self._integral[:] = 0.0
            self.psi = np.tile([1.0, 0.0], (len(self.yy), 1))
            self._past.clear()
            self._past.append((view.t_s, self.psi, self._integral.copy()))
            return
        self.psi = np.full_like(self.psi, np.nan)
        if not view.informed:
            return
        psi = distance_ratios(view.u_ic, view.u_kc, view.r_kc, view.u_ik)
        psi[~(excitation(view.u_ic, view.u_kc) > self._s.lambda_a)] = np.nan
        self.psi = psi
        while self._past and view.t_s - self._past[0][0] > self._s.window_s:
            self._past.popleft()
        if self._past:
            _, psi_then, integral_then = self._past[0]
            self._learn(psi - psi_then, self._integral - integral_then)
        self._past.append((view.t_s, psi, self._integral.copy()))

    def _learn(self, y: Array, u: Array) -> None:
        s = self._s
        y_y, y_u = np.sum(y * y, axis=1), np.sum(y * u, axis=1)
        with np.errstate(invalid="ignore", divide="ignore"):
            implied = y_u / y_y
            good = (y_y >= s.least_y**2) & (np.sum(u * u, axis=1) >= s.least_u_m**2)
            good &= (
                (implied >= s.distance_m[0]) & (implied <= s.distance_m[1]) & (self.samples < s.stack_size)
            )
        self.yy[good] += y_y[good]
        self.yu[good] += y_u[good]
        self.samples[good] += 1
