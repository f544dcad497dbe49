"""The fiducial marker that a target carries: its pattern (an ArUco dictionary) and its place on the target.

| symbol | meaning |
| --- | --- |
| ``c0 .. c3`` | corners of the black square, clockwise as seen by a camera, from the pattern's top left |
| ``(a, b)`` | place on the marker: ``X = c0 + a (c1 - c0) + b (c3 - c0)``, so the black square is [0, 1]^2 |
| quiet zone | one module of white around the black square, without which nothing is detected |
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from camnet.errors import ConfigError
from camnet.geometry import rotations
from camnet.types import Array

__all__ = ["DICTIONARY", "MODULES", "QUIET", "Marker", "marker_on", "pattern"]

#: 250 patterns of 4 x 4 modules: large modules can be read from far away
DICTIONARY = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_250)
#: modules along an edge of the black square, its border included
MODULES = 6
#: width of the quiet zone as a share of the black square's edge
QUIET = 1.0 / MODULES
_COUNT = 250


@dataclass(frozen=True, eq=False, slots=True)
class Marker:
    """A marker on a target.

    Attributes
    ----------
    number : which pattern
    corners : (4, 3) corners of the black square in the body frame, m
    side_m : length of its edge, m
    p_body, q_body : (3,), (4,) pose of the marker's frame (x to the pattern's right, y up, z towards who sees it)
    """

    number: int
    corners: Array
    side_m: float
    p_body: Array
    q_body: Array

    def plate(self) -> Array:
        """Corners (4, 3) of the white plate, quiet zone included, in the body frame."""
        across, down = self.corners[1] - self.corners[0], self.corners[3] - self.corners[0]
        places = np.array(
            [[-QUIET, -QUIET], [1 + QUIET, -QUIET], [1 + QUIET, 1 + QUIET], [-QUIET, 1 + QUIET]]
        )
        return np.asarray(self.corners[0] + places @ np.stack([across, down]))

    def square(self) -> Array:
        """Corners (4, 3) in the marker's own frame, in the same order."""
        h = 0.5 * self.side_m
        return np.array([[-h, h, 0.0], [h, h, 0.0], [h, -h, 0.0], [-h, -h, 0.0]])


def marker_on(features: ArrayLike, number: int) -> Marker:
    """Marker in the middle of the rectangle that a target's feature points (4, 3) span, as large as fits.

    The points go round clockwise as seen by a camera, from the pattern's top left.

    Raises
    ------
    ConfigError
        The points are not the corners of a rectangle, or there is no such pattern.
    """
    points = np.asarray(features, dtype=np.float64)
    if not 0 <= number < _COUNT:
        raise ConfigError(f"sensing.level 'image': target number {number}; there are markers for {_COUNT}")
    if points.shape != (4, 3) or not _is_rectangle(points):
        raise ConfigError(
            f"sensing.level 'image': features_m {points.tolist()} must be the four corners of a rectangle, clockwise "
            "as seen by a camera: the marker is put there"
        )
    across, down = points[1] - points[0], points[3] - points[0]
    width, height = float(np.linalg.norm(across)), float(np.linalg.norm(down))
    side, middle = min(width, height), points.mean(axis=0)
    x, y = across / width, -down / height
    q = rotations.from_matrix(np.column_stack([x, y, np.cross(x, y)]))
    h = 0.5 * side
    corners = middle + np.array([-h * x + h * y, h * x + h * y, h * x - h * y, -h * x - h * y])
    return Marker(number, corners, side, middle, q)


def _is_rectangle(points: Array) -> bool:
    across, down = points[1] - points[0], points[3] - points[0]
    size = np.linalg.norm(across) * np.linalg.norm(down)
    closed = np.allclose(points[0] + across + down, points[2], atol=1e-6)
    return bool(size > 0.0 and closed and abs(across @ down) < 1e-6 * size)


@lru_cache(maxsize=_COUNT)
def pattern(number: int) -> NDArray[np.uint8]:
    """Modules (8, 8) of a plate, 0 black and 255 white, quiet zone included."""
    image = cv2.aruco.generateImageMarker(DICTIONARY, number, MODULES)
    plate = np.full((MODULES + 2, MODULES + 2), 255, dtype=np.uint8)
    plate[1:-1, 1:-1] = image
    plate.setflags(write=False)
    return plate
