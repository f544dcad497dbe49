"""Masks of images: one for all of them, or a folder with one for each."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from camnet.errors import DataError
from camnet.importers.image_sequence import ImageSequence, open_images
from camnet.types import Array

__all__ = ["Masks", "open_masks"]

_Image = NDArray[np.uint8]


class Masks:
    """Masks by the number of the image; ``masks(k)`` is (height, width), not zero where points may be."""

    def __init__(self, files: tuple[Path, ...], size: tuple[int, int]) -> None:
        self._files, self._size = files, size
        self._last: tuple[int, _Image] | None = None

    def __call__(self, k: int) -> _Image:
        """Return the mask of image ``k`` (DataError: it cannot be read, or has another size than the images)."""
        number = k if len(self._files) > 1 else 0
        if self._last is None or self._last[0] != number:
            self._last = number, self._read(self._files[number])
        return self._last[1]

    def hold(self, k: int, pixels: Array) -> bool:
        """Whether at least nine in ten of the pixels (N, 2) lie inside the mask of image ``k``."""
        mask = self(k)
        at = np.clip(np.rint(pixels).astype(int), 0, np.array(self._size) - 1)
        return float(np.mean(mask[at[:, 1], at[:, 0]] > 0)) >= 0.9

    def _read(self, path: Path) -> _Image:
        image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        if image is None:
            raise DataError(
                f"{path}: cannot be read as an image; a mask, not zero where points may be, was expected"
            )
        if image.shape[::-1] != self._size:
            raise DataError(
                f"{path}: {image.shape[1]} x {image.shape[0]} pixels; the images have {self._size[0]} x {self._size[1]}"
            )
        if not image.any():
            raise DataError(
                f"{path}: is zero everywhere, so that no point may be anywhere; not zero where they may"
            )
        return np.asarray(image, dtype=np.uint8)


def open_masks(path: Path, images: ImageSequence) -> Masks:
    """Masks for a sequence of images.

    Raises
    ------
    DataError
        No such file or folder, or a folder with another number of masks than there are images.
    """
    height, width = next(images.frames()).shape[:2]
    if not path.is_dir():
        return Masks((path,), (width, height))
    masks = open_images(path)
    count = sum(1 for _ in images.frames()) if not images.images else len(images.images)
    if len(masks.images) != count:
        raise DataError(
            f"--mask {path}: {len(masks.images)} masks for {count} images; one for each was expected"
        )
    return Masks(tuple(masks.images), (width, height))
