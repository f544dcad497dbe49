"""A rectangle of an image, resampled about a centre between the pixels; beyond the border the edge pixels repeat."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from camnet.errors import DataError
from camnet.types import Array

__all__ = ["Image", "checked_image", "cut", "shrink"]

#: (H, W) or (H, W, C), uint8
Image = NDArray[np.uint8]


def checked_image(image: object) -> Image:
    """Return a grey (H, W) or colour (H, W, 3) uint8 image as (H, W, C).

    Raises
    ------
    DataError : another type or shape, or an empty image
    """
    if not isinstance(image, np.ndarray):
        raise DataError(f"image: is a {type(image).__name__}; a NumPy array of uint8 was expected")
    if image.dtype != np.uint8:
        raise DataError(f"image: has dtype {image.dtype}; uint8 was expected")
    if image.ndim == 2:
        image = image[:, :, None]
    if image.ndim != 3 or image.shape[2] not in (1, 3) or image.size == 0:
        raise DataError(f"image: has shape {image.shape}; (H, W) or (H, W, 3), not empty, was expected")
    return image


def cut(image: Image, centre: Array, size: Array, shape: tuple[int, int]) -> Image:
    """Cut the rectangle of ``size`` (width, height) px about ``centre`` and bring it to ``shape`` (rows, columns).

    Shrinking by more than 2 averages over whole blocks of pixels first, so that no detail is aliased.

    Parameters
    ----------
    image : (H, W, C)
    centre : (2,) column, row in px, counted from the corner of the image
    size : (2,) width, height, px
    shape : rows, columns of the patch

    Returns
    -------
    (rows, columns, C)
    """
    step = size / np.array([shape[1], shape[0]])  # image pixels per patch pixel
    small, origin, block = shrink(image, centre, size, max(1, int(min(step))))
    return resample(small, (centre - origin) / block, step / block, shape)


def shrink(image: Image, centre: Array, size: Array, block: int) -> tuple[Image, Array, int]:
    """Mean over blocks of pixels of the part of an image about a rectangle.

    Returns
    -------
    small : the averaged part
    origin : (2,) where its corner lies in the image, px
    block : side of a block, px
    """
    if block <= 1:
        return image, np.zeros(2), 1
    height, width = image.shape[:2]
    first = np.clip(
        np.floor((centre - 0.5 * size) / block - 1).astype(int), 0, [width // block, height // block]
    )
    last = np.ceil((centre + 0.5 * size) / block + 1).astype(int)
    last = np.clip(last, first + 1, np.maximum([width // block, height // block], first + 1))
    (left, top), (right, bottom) = first * block, last * block
    part = image[top:bottom, left:right]
    if part.shape[0] < block or part.shape[1] < block:  # an image smaller than one block
        return image, np.zeros(2), 1
    shape = (part.shape[1] // block, part.shape[0] // block)
    small = cv2.resize(part[: shape[1] * block, : shape[0] * block], shape, interpolation=cv2.INTER_AREA)
    return _with_channels(small), np.array([left, top], dtype=float), block


def resample(image: Image, centre: Array, step: Array, shape: tuple[int, int]) -> Image:
    """Bilinear samples at ``step`` (2,) px apart, ``shape`` of them about ``centre``."""
    first = centre - 0.5 * step * np.array([shape[1] - 1, shape[0] - 1]) - 0.5  # in pixel centres
    matrix = np.array([[step[0], 0.0, first[0]], [0.0, step[1], first[1]]])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    out = cv2.warpAffine(image, matrix, (shape[1], shape[0]), flags=flags, borderMode=cv2.BORDER_REPLICATE)
    return _with_channels(out)


def _with_channels(image: object) -> Image:
    array = np.asarray(image, dtype=np.uint8)
    return array[:, :, None] if array.ndim == 2 else array
