"""Speed as a state beside the learned field: how fast the target now goes along the way it has learned.

| symbol | name | unit |
| --- | --- | --- |
| r = sum Deta^T (Y W) / sum norm(Y W)^2, over the positions of recent windows | ratio of present and learned pace | - |
| a, b | r - 1 at the end of a sighting, r - 1 at the beginning of the next | - |
| g = sum a b / (sum a^2 + a0^2) | what is left of a deviation after a gap, over the gaps so far | - |

A function of place has one speed in each place. A target that drives the same way at another speed
follows the same path in another time: ``eta' = (1 + d) W^T sigma``. The deviation d used across a gap is
``sqrt(g) a``: a deviation that decays exponentially to the share g at the far end has about this mean on the way. For
a target with one speed in each place the deviations are noise, do not recur, and d is about zero.
"""

from __future__ import annotations

import math

from camnet.estimation.propagate import UNIT
from camnet.types import Array

__all__ = ["Pace", "scaled"]

#: windows after which an earlier one counts 1/e
MEMORY_WINDOWS = 6.0
#: windows that tell the pace at the beginning of a sighting
ENTRY_WINDOWS = 5
#: deviation that is taken for noise until gaps have shown otherwise
NOISE = 0.05
#: cosine between learned and present motion from which on the ways are the same
SAME_WAY = 0.9
#: limits of the factor
LOWEST, HIGHEST = 0.4, 2.5


class Pace:
    """Pace of one target, over all its regions."""

    def __init__(self) -> None:
        self._along, self._square = 0.0, 0.0
        self._entry_along, self._entry_square, self._windows = 0.0, 0.0, 0
        self._exit: float | None = None
        self._ab, self._aa = 0.0, NOISE**2

    def observe(self, row: Array, increment: Array, weights: Array) -> None:
        """Take note of a window (row (p,), increment (8,)) where the weights (p, 8) are known to answer for it."""
        learned = row @ weights[:, 0:3]
        moved = increment[0:3]
        along, square = float(learned @ moved), float(learned @ learned)
        if along <= 0.0 or along * along < SAME_WAY**2 * square * float(moved @ moved):
            # another way, not another pace
            return
        fade = math.exp(-1.0 / MEMORY_WINDOWS)
        self._along, self._square = fade * self._along + along, fade * self._square + square
        self._windows += 1
        if self._windows <= ENTRY_WINDOWS:
            self._entry_along += along
            self._entry_square += square

    def _deviation(self) -> float | None:
        if self._windows < ENTRY_WINDOWS or self._square <= 0.0:
            return None
        return self._along / self._square - 1.0

    def leave(self, lost: bool = True) -> None:
        """End the sighting: learn how much of the last exit's deviation was left at its beginning.

        ``lost`` says that a gap follows; a target handed over in view shows nothing about gaps.
        """
        deviation = self._deviation()
        if deviation is not None and self._exit is not None and self._entry_square > 0.0:
            self._ab += self._exit * (self._entry_along / self._entry_square - 1.0)
            self._aa += self._exit**2
        self._exit = deviation if lost else None
        self._along, self._square = 0.0, 0.0
        self._entry_along, self._entry_square, self._windows = 0.0, 0.0, 0

    @property
    def persistence(self) -> float:
        """Share g of a deviation that lasts over a gap, in [0, 1]."""
        return min(1.0, max(0.0, self._ab / self._aa))

    def scale(self, seen: bool) -> float:
        """Factor on the learned velocities across the gap in progress, or one that began now (``seen``)."""
        deviation = self._deviation() if seen else self._exit
        if deviation is None:
            return 1.0
        return min(HIGHEST, max(LOWEST, 1.0 + math.sqrt(self.persistence) * deviation))


def scaled(weights: Array, factor: float) -> Array:
    """Weights (p, 8) of the motion at another pace; the unit output stays."""
    out = factor * weights
    out[:, UNIT] = weights[:, UNIT]
    return out
