"""Feature tracks from images: OpenCV's corners, followed by pyramidal Lucas-Kanade with a check backwards.

| step | what |
| --- | --- |
| find | ``goodFeaturesToTrack``, ``spacing_px`` apart and away from known corners; or points that are given |
| follow | ``calcOpticalFlowPyrLK`` from the last image to this one and back; kept if it returns to within ``back_px`` |
| refine | ``cornerSubPix`` from there, kept if it moves by less than ``refine_px``: no drift on real corners |
| renew | new corners once fewer than ``renew_share`` of ``corners`` are left |

A lost corner never comes back under its old number.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from camnet.estimation.structure.tracks import TrackedFrame
from camnet.settings import Fraction, NonNegative, Positive, Settings
from camnet.types import Array, BoolArray, IntArray

__all__ = ["ImageTracks", "TrackerSettings"]

_Image = NDArray[np.uint8]
_STOP = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 30, 0.01)


class TrackerSettings(Settings):
    """See the module's table."""

    corners: int = Field(default=150, ge=4)
    quality: Fraction = 0.01
    spacing_px: Positive = 15.0
    window_px: int = Field(default=21, ge=5)
    levels: int = Field(default=4, ge=0)
    back_px: Positive = 0.5
    refine_px: NonNegative = 1.5
    refine_window_px: int = Field(default=5, ge=1)
    renew_share: Fraction = 0.6


class ImageTracks:
    """Tracks through a sequence of images; iterating it once reads the images once.

    Parameters
    ----------
    images : times in s and grey images (height, width), in the order of time
    settings : see `TrackerSettings`
    start : (N, 2) corners to follow from the first image on, pixels; None: they are found, and renewed
    mask : (height, width) where corners may be, not zero, or a function that returns it for an image's number;
        None: everywhere
    """

    def __init__(
        self,
        images: Iterable[tuple[float, _Image]],
        settings: TrackerSettings,
        start: Array | None = None,
        mask: _Image | Callable[[int], _Image] | None = None,
    ) -> None:
        self._images, self._s, self._mask = images, settings, mask
        self._given = start

    def __iter__(self) -> Iterator[TrackedFrame]:
        """Follow corners from image to image."""
        ids: IntArray = np.empty(0, dtype=np.int64)
        pixels, fresh = np.empty((0, 2)), 0
        last: _Image | None = None
        for number, (t, image) in enumerate(self._images):
            if last is None:
                pixels = (
                    self._find(number, image, pixels)
                    if self._given is None
                    else self._refine(image, self._given)
                )
                ids, fresh = np.arange(len(pixels)), len(pixels)
            else:
                kept, pixels = self._follow(last, image, pixels)
                ids = ids[kept]
                if callable(self._mask):  # what is to be looked at moves in the image
                    inside = _inside(self._mask(number), pixels)
                    ids, pixels = ids[inside], pixels[inside]
                if self._given is None and len(ids) < self._s.renew_share * self._s.corners:
                    more = self._find(number, image, pixels)
                    ids = np.concatenate([ids, fresh + np.arange(len(more))])
                    pixels, fresh = np.concatenate([pixels, more]), fresh + len(more)
            last = image
            yield TrackedFrame(t, ids, pixels)

    def _find(self, number: int, image: _Image, known: Array) -> Array:
        """Corners (K, 2) that are not near the ones known."""
        s = self._s
        given = self._mask(number) if callable(self._mask) else self._mask
        mask = np.full(image.shape, 255, dtype=np.uint8) if given is None else given.copy()
        for x, y in known.tolist():
            cv2.circle(mask, (round(x), round(y)), round(s.spacing_px), 0, -1)
        wanted = s.corners - len(known)
        if wanted <= 0:
            return np.empty((0, 2))
        found: Any = cv2.goodFeaturesToTrack(image, wanted, s.quality, s.spacing_px, mask=mask)
        return (
            np.empty((0, 2))
            if found is None
            else self._refine(image, found.reshape(-1, 2).astype(np.float64))
        )

    def _follow(self, last: _Image, image: _Image, pixels: Array) -> tuple[IntArray, Array]:
        """Return indices of the corners that were followed, and where they are."""
        if len(pixels) == 0:
            return np.empty(0, dtype=np.int64), pixels
        s = self._s
        options: dict[str, Any] = {
            "winSize": (s.window_px, s.window_px),
            "maxLevel": s.levels,
            "criteria": _STOP,
        }
        before = pixels.astype(np.float32)[:, None]
        there, found, _ = cv2.calcOpticalFlowPyrLK(last, image, before, np.empty(0), **options)
        back, returned, _ = cv2.calcOpticalFlowPyrLK(image, last, there, np.empty(0), **options)
        good = (found.ravel() > 0) & (returned.ravel() > 0)
        good &= np.linalg.norm((back - before).reshape(-1, 2), axis=1) < s.back_px
        now = there.reshape(-1, 2).astype(np.float64)
        height, width = image.shape
        good &= np.all((now >= 0.0) & (now <= [width - 1.0, height - 1.0]), axis=1)
        kept = np.flatnonzero(good)
        return kept, self._refine(image, now[kept])

    def _refine(self, image: _Image, pixels: Array) -> Array:
        """Move to the corner proper where that is near."""
        s = self._s
        if s.refine_px == 0.0 or len(pixels) == 0:
            return np.asarray(pixels, dtype=np.float64)
        window = (s.refine_window_px, s.refine_window_px)
        start = np.ascontiguousarray(pixels, dtype=np.float32).reshape(-1, 1, 2)
        better = cv2.cornerSubPix(image, start, window, (-1, -1), _STOP).reshape(-1, 2)
        near = np.linalg.norm(better - pixels, axis=1, keepdims=True) < s.refine_px
        return np.where(near, better, pixels).astype(np.float64)


def _inside(mask: _Image, pixels: Array) -> BoolArray:
    """Return which pixels (N, 2) lie where the mask is not zero."""
    at = np.rint(pixels).astype(int)
    return np.asarray(mask[at[:, 1], at[:, 0]] > 0)
