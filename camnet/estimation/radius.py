"""Empirical radius of the position error, growing while the target is unseen.

Each re-sighting tells how wrong the prediction was after so many seconds. The radius grows at the largest such rate of
the last few gaps, times a margin; before the first re-sighting, at half the speed at the exit (a heading wrong by half
a radian). It is a record of what happened, not a certificate.
"""

from __future__ import annotations

import math
from collections import deque

__all__ = ["ErrorRadius"]

REMEMBERED_GAPS = 8
MARGIN = 1.5
#: share of the exit speed at which the radius grows before any gap has been crossed
BLIND_SHARE = 0.5
#: time constant of the mean square residual while seen, in measurements
MEMORY = 100.0


class ErrorRadius:
    """Radius for one target and one region of exit."""

    def __init__(self, start_m: float = 0.05) -> None:
        self._mean_square = (start_m / 3.0) ** 2
        self._rates: deque[float] = deque(maxlen=REMEMBERED_GAPS)

    def seen(self, residual_m: float) -> None:
        """Note that a measurement while seen differed from the estimate by ``residual_m``."""
        self._mean_square += (residual_m**2 - self._mean_square) / MEMORY

    def crossed(self, residual_m: float, duration_s: float) -> None:
        """At a re-sighting after ``duration_s`` the prediction was wrong by ``residual_m``."""
        if duration_s > 0.0:
            self._rates.append(residual_m / duration_s)

    def base(self) -> float:
        """Three standard deviations of the residuals while seen, m."""
        return 3.0 * math.sqrt(self._mean_square)

    def growth(self, speed_mps: float) -> float:
        """Growth while unseen, m/s."""
        return MARGIN * max(self._rates) if self._rates else BLIND_SHARE * speed_mps
