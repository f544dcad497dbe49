"""Rendered input for the distance observers: the board drawn at every image, its corners found and followed.

The board is drawn through its plane's homography (`camnet.sensing.textured_planes`), blurred by the lens (0.7 pixels)
and given noise of 2 grey levels. Its corners are found once, by OpenCV's checkerboard finder in the first image, and
followed from there (`camnet.estimation.structure.image_tracks`).
"""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np
from numpy.typing import NDArray

from camnet.errors import DataError
from camnet.estimation.structure.image_tracks import ImageTracks, TrackerSettings
from camnet.experiments.distance_observers_scene import BOARD, BoardScene, SetUp
from camnet.sensing.textured_planes import TexturedPlane, checkerboard, draw_planes
from camnet.types import Array

__all__ = ["board_plane", "board_tracks"]

_SQUARE_PX, _NOISE, _BLUR_PX = 48, 2.0, 0.7


def board_plane(setup: SetUp, points: Array) -> TexturedPlane:
    """Board whose inner corners are ``points`` (48, 3), with one square of margin beyond the outer squares."""
    columns, rows = BOARD
    right = points[1] - points[0]
    down = points[columns] - points[0]
    texture = checkerboard(columns + 1, rows + 1, _SQUARE_PX, _SQUARE_PX)
    corner = points[0] - 2.0 * right - 2.0 * down
    return TexturedPlane(corner, (columns + 3) * right, (rows + 3) * down, texture)


def board_tracks(setup: SetUp, scene: BoardScene, rng: np.random.Generator) -> ImageTracks:
    """Tracks of the 48 corners, numbered as ``scene.points_world``, read from rendered images.

    Raises
    ------
    DataError
        If OpenCV does not find the board in the first image.
    """
    images = _images(setup, scene, rng)
    t, first = next(images)
    found, corners = cv2.findChessboardCornersSB(first, BOARD)
    if not found:
        raise DataError("the checkerboard was not found in the first rendered image")
    start = corners.reshape(-1, 2).astype(np.float64)
    # OpenCV may begin at the opposite corner
    expected = scene.camera.project_world(
        scene.points_world,
        scene.path.states(scene.t_s[0]).p_world[0],
        scene.path.states(scene.t_s[0]).q_world[0],
    )
    if np.linalg.norm(start[0] - expected[0]) > np.linalg.norm(start[-1] - expected[0]):
        start = start[::-1]

    def sequence() -> Iterator[tuple[float, NDArray[np.uint8]]]:
        yield t, first
        yield from images

    return ImageTracks(sequence(), TrackerSettings(), np.ascontiguousarray(start))


def _images(
    setup: SetUp, scene: BoardScene, rng: np.random.Generator
) -> Iterator[tuple[float, NDArray[np.uint8]]]:
    plane = board_plane(setup, scene.points_world)
    truth = scene.path.states(scene.t_s)
    width, height = scene.camera.size.astype(int).tolist()
    # one field of noise, moved about: drawing two million numbers for every image takes longer than drawing the image
    noise = (_NOISE * rng.standard_normal((height, width))).astype(np.float32)
    for k, t in enumerate(scene.t_s.tolist()):
        image = draw_planes([plane], scene.camera, truth.p_world[k], truth.q_world[k])
        image = np.asarray(cv2.GaussianBlur(image, (0, 0), _BLUR_PX))
        shift = rng.integers(0, (height, width))
        image = image + np.roll(noise, tuple(shift.tolist()), axis=(0, 1))
        yield t, np.clip(np.rint(image), 0, 255).astype(np.uint8)
