"""A law of motion: round the origin, at one metre a second at one metre."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["whirl"]


def whirl(places: NDArray[np.float64], t_s: float) -> NDArray[np.float64]:
    """Return velocities (n, 2), m/s, at places (n, 2), m."""
    return np.stack([-places[:, 1], places[:, 0]], axis=1)
