"""Boxes in an image, and how far two of them agree.

Coordinates are continuous and count from the top left corner of the image: pixel column i covers [i, i + 1). The
centre of pixel (0, 0) is at (0.5, 0.5).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from camnet.errors import DataError
from camnet.types import Array

__all__ = ["Box", "overlap"]


@dataclass(frozen=True, slots=True)
class Box:
    """Upright box: left edge ``x``, top edge ``y``, ``width`` and ``height``, px.

    Raises
    ------
    DataError : a number is not finite, or the width or height is not above 0
    """

    x: float
    y: float
    width: float
    height: float

    def __post_init__(self) -> None:
        for name in ("x", "y", "width", "height"):
            value = getattr(self, name)
            if not math.isfinite(value):
                raise DataError(f"box: {name} is {value!r}; a finite number of pixels was expected")
            if name in ("width", "height") and value <= 0:
                raise DataError(f"box: {name} is {value!r}; a number of pixels above 0 was expected")

    @property
    def centre(self) -> Array:
        """Centre (2,), px."""
        return np.array([self.x + 0.5 * self.width, self.y + 0.5 * self.height])

    @staticmethod
    def about(centre: ArrayLike, width: float, height: float) -> Box:
        """Box of this size about ``centre`` (2,), px."""
        u, v = np.asarray(centre, dtype=float).tolist()
        return Box(u - 0.5 * width, v - 0.5 * height, float(width), float(height))

    def as_array(self) -> Array:
        """``[x, y, width, height]`` (4,), px."""
        return np.array([self.x, self.y, self.width, self.height])


def overlap(a: Box, b: Box) -> float:
    """Area of the intersection over the area of the union, in [0, 1]."""
    across = min(a.x + a.width, b.x + b.width) - max(a.x, b.x)
    down = min(a.y + a.height, b.y + b.height) - max(a.y, b.y)
    common = max(across, 0.0) * max(down, 0.0)
    return common / (a.width * a.height + b.width * b.height - common)
