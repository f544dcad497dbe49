"""Baseline: a constant-velocity Kalman filter of position fixes, predicted through the gap.

| symbol | name | shape | unit |
| --- | --- | --- | --- |
| x | ``p``, ``v``: position and velocity | (2,), (2,) | m, m/s |
| q | ``accel_psd_m2ps3`` of the white acceleration on each axis | - | m^2/s^3 |
| r | ``position_noise_m`` of a fix on each axis | - | m |
| P | [[pp, pv], [pv, vv]], the same for both axes | (2, 2) | |

The motion and the noise are linear and equal on both axes, so the extended filter is this one, with one 2 x 2
covariance (Bar-Shalom, Li and Kirubarajan, Estimation with Applications to Tracking and Navigation, sec. 6.2.2).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from camnet.estimation.crossing.settings import FixFilterSettings
from camnet.types import Array

__all__ = ["FixFilter"]


@dataclass(slots=True)
class FixFilter:
    """Filter of one target; `restart` it for a new visit, `update` it with every sighting.

    Attributes
    ----------
    settings : noise
    t_s : time of the last fix, s (NaN before the first)
    p, v : (2,), (2,) estimate at that time
    covariance : pp, pv, vv
    """

    settings: FixFilterSettings
    t_s: float = float("nan")
    p: Array = field(default_factory=lambda: np.zeros(2))
    v: Array = field(default_factory=lambda: np.zeros(2))
    covariance: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def restart(self, t_s: float, fix: Array) -> None:
        """Begin at a fix (2,) with unknown velocity."""
        self.t_s, self.p, self.v = t_s, np.array(fix, dtype=np.float64), np.zeros(2)
        self.covariance = (self.settings.position_noise_m**2, 0.0, self.settings.first_speed_std_mps**2)

    def update(self, t_s: float, fix: Array) -> None:
        """Take in a fix (2,)."""
        dt = t_s - self.t_s
        q = self.settings.accel_psd_m2ps3
        pp, pv, vv = self.covariance
        # P^- = F P F^T + Q
        pp, pv, vv = pp + dt * (2 * pv + dt * vv) + q * dt**3 / 3, pv + dt * vv + q * dt**2 / 2, vv + q * dt
        s = pp + self.settings.position_noise_m**2
        gain_p, gain_v = pp / s, pv / s
        innovation = fix - (self.p + dt * self.v)
        self.t_s = t_s
        self.p = self.p + dt * self.v + gain_p * innovation
        self.v = self.v + gain_v * innovation
        # P = (I - K H) P^-
        self.covariance = ((1 - gain_p) * pp, (1 - gain_p) * pv, vv - gain_v * pv)

    def predict(self, t_s: float) -> Array:
        """Position (2,) expected at ``t_s``; the filter is left as it is."""
        return np.asarray(self.p + (t_s - self.t_s) * self.v)
