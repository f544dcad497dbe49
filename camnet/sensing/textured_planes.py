"""Images of textured rectangles, drawn through the known homographies of their planes.

| symbol | name | shape | unit | equation |
| --- | --- | --- | --- | --- |
| ``o``, ``e_u``, ``e_v`` | ``corner``, ``across``, ``down`` | (3,) | m | points ``o + a e_u + b e_v``, a, b in [0, 1] |
| ``M = [e_u, e_v, o]`` | | (3, 3) | m | in the camera frame |
| ``(a, b, 1) / z = M^-1 (x, y, 1)`` | | (3,) | | where the ray of a pixel hits the plane, and at which depth z |

The nearest rectangle that a ray hits is seen. Each pixel is the mean of ``samples`` x ``samples`` rays spread evenly
over its square; pixel i spans [i - 1/2, i + 1/2] (OpenCV's convention). Textures are read bilinearly from the level of
a pyramid whose pixels are about as large as the samples, so that far planes do not shimmer. Lens distortion is not
drawn.

The fast path beside PyBullet's software renderer, for scenes that are made of planes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from camnet.compiled import cached_njit
from camnet.errors import ConfigError
from camnet.geometry.pinhole import Pinhole
from camnet.geometry.rotations import to_matrix
from camnet.types import Array

__all__ = ["TexturedPlane", "checkerboard", "draw_planes"]

_Grey = NDArray[np.float32]
#: rectangles are cut at this depth, m
_NEAR_M = 0.05


@dataclass(frozen=True, eq=False)
class TexturedPlane:
    """A rectangle (or parallelogram) with a picture on it, seen from both sides.

    Attributes
    ----------
    corner : (3,) the picture's top left corner, world, m
    across, down : (3,), (3,) from there to its top right and to its bottom left corner, m
    texture : (h, w) grey levels 0 to 255
    """

    corner: Array
    across: Array
    down: Array
    texture: NDArray[np.uint8]

    @cached_property
    def pyramid(self) -> tuple[_Grey, ...]:
        """The texture at full size, half size and so on."""
        levels = [self.texture.astype(np.float32)]
        while min(levels[-1].shape) >= 4:
            h, w = levels[-1].shape
            half = cv2.resize(levels[-1], ((w + 1) // 2, (h + 1) // 2), interpolation=cv2.INTER_AREA)
            levels.append(np.asarray(half, dtype=np.float32))
        return tuple(levels)


def checkerboard(columns: int, rows: int, square_px: int, margin_px: int) -> NDArray[np.uint8]:
    """Picture of a board of ``columns`` x ``rows`` squares, black first, on a white margin."""
    x, y = np.meshgrid(np.arange(columns), np.arange(rows))
    squares = np.where((x + y) % 2 == 0, 30, 220).astype(np.uint8)
    board = np.kron(squares, np.ones((square_px, square_px), dtype=np.uint8))
    return np.pad(board, margin_px, constant_values=220)


def draw_planes(
    planes: Sequence[TexturedPlane],
    camera: Pinhole,
    p_world: Array,
    q_world: Array,
    background: float | _Grey = 110.0,
    samples: int = 3,
) -> _Grey:
    """Draw what a camera sees (height, width), grey levels.

    Parameters
    ----------
    planes : rectangles in the world
    camera : pinhole without distortion
    p_world, q_world : (3,) m and (4,) camera frame to world
    background : grey level, or picture (height, width), where there is no rectangle
    samples : rays along each edge of a pixel

    Raises
    ------
    ConfigError
        If the camera has lens distortion.
    """
    if camera.distorted:
        raise ConfigError(
            f"distortion {camera.distortion.tolist()}: textured planes are drawn without; use zeros"
        )
    width, height = camera.size.astype(int).tolist()
    out = np.empty((height, width), dtype=np.float32)
    out[:] = background
    r = to_matrix(q_world)
    # one sum and one depth for each ray: the nearest rectangle of each is kept
    boxes = [_box(plane, camera, p_world, r) for plane in planes]
    there = [k for k, box in enumerate(boxes) if box is not None]
    if not there:
        return out
    left, top = (min(boxes[k][i] for k in there) for i in (0, 1))  # type: ignore[index]
    right, bottom = (max(boxes[k][i] for k in there) for i in (2, 3))  # type: ignore[index]
    shape = (bottom - top, right - left, samples * samples)
    inverse_depth = np.zeros(shape, dtype=np.float32)
    rays = np.repeat(out[top:bottom, left:right, None], samples * samples, axis=2)
    for k in there:
        plane, box = planes[k], boxes[k]
        assert box is not None
        m = np.column_stack([plane.across, plane.down, plane.corner - p_world])
        to_plane: Array = np.asarray(np.linalg.inv(r.T @ m), dtype=np.float64)
        texture = _level(plane, camera, p_world, r, samples)
        _draw(
            rays,
            inverse_depth,
            to_plane,
            texture,
            camera.focal,
            camera.centre,
            left,
            top,
            np.array(box),
            samples,
        )
    out[top:bottom, left:right] = rays.mean(axis=2)
    return out


def _box(plane: TexturedPlane, camera: Pinhole, p: Array, r: Array) -> tuple[int, int, int, int] | None:
    """Pixels [left, right) x [top, bottom) around what lies in front of the camera; None if nothing does."""
    o, u, v = plane.corner, plane.across, plane.down
    ring = np.array([o, o + u, o + u + v, o + v]) - p
    cam = ring @ r
    kept = []
    for a, b in zip(cam, np.roll(cam, -1, axis=0), strict=True):
        if a[2] >= _NEAR_M:
            kept.append(a)
        if (a[2] < _NEAR_M) != (b[2] < _NEAR_M):
            kept.append(a + (_NEAR_M - a[2]) / (b[2] - a[2]) * (b - a))
    if not kept:
        return None
    pixels = camera.project(np.array(kept))
    low = np.maximum(np.floor(pixels.min(axis=0) - 1.0), 0.0).astype(int)
    high = np.minimum(np.ceil(pixels.max(axis=0) + 2.0), camera.size).astype(int)
    return None if np.any(high <= low) else (int(low[0]), int(low[1]), int(high[0]), int(high[1]))


def _level(plane: TexturedPlane, camera: Pinhole, p: Array, r: Array, samples: int) -> _Grey:
    """Level of the pyramid whose pixels are about as large as the samples, at the nearest corner."""
    o, u, v = plane.corner, plane.across, plane.down
    depth = max(_NEAR_M, float(np.min(((np.array([o, o + u, o + u + v, o + v]) - p) @ r)[:, 2])))
    px_per_m = float(np.max(camera.focal)) * samples / depth
    texture_per_m = max(
        plane.texture.shape[1] / np.linalg.norm(u), plane.texture.shape[0] / np.linalg.norm(v)
    )
    level = int(np.clip(np.floor(np.log2(max(texture_per_m / px_per_m, 1.0))), 0, len(plane.pyramid) - 1))
    return plane.pyramid[level]


@cached_njit(error_model="numpy")
def _draw(
    rays: _Grey, inverse_depth: _Grey, to_plane: Array, texture: _Grey, focal: Array, centre: Array,
    left: int, top: int, box: NDArray[np.int64], samples: int,
) -> None:  # fmt: skip
    """Draw one rectangle into the rays (h, w, samples^2) of a part of the image that begins at (left, top)."""
    h, w = texture.shape
    for row in range(box[1], box[3]):
        for column in range(box[0], box[2]):
            for k in range(samples * samples):
                x = (column - 0.5 + (k % samples + 0.5) / samples - centre[0]) / focal[0]
                y = (row - 0.5 + (k // samples + 0.5) / samples - centre[1]) / focal[1]
                near = to_plane[2, 0] * x + to_plane[2, 1] * y + to_plane[2, 2]
                if near <= inverse_depth[row - top, column - left, k]:
                    continue
                a = (to_plane[0, 0] * x + to_plane[0, 1] * y + to_plane[0, 2]) / near
                b = (to_plane[1, 0] * x + to_plane[1, 1] * y + to_plane[1, 2]) / near
                if a < 0.0 or a > 1.0 or b < 0.0 or b > 1.0:
                    continue
                s = min(max(a * w - 0.5, 0.0), w - 1.0)
                t = min(max(b * h - 0.5, 0.0), h - 1.0)
                i, j = min(int(s), w - 2), min(int(t), h - 2)
                s, t = s - i, t - j
                upper = (1.0 - s) * texture[j, i] + s * texture[j, i + 1]
                lower = (1.0 - s) * texture[j + 1, i] + s * texture[j + 1, i + 1]
                rays[row - top, column - left, k] = (1.0 - t) * upper + t * lower
                inverse_depth[row - top, column - left, k] = near
