"""Simulated tracks of key frames in the corridor: corners are chosen in an image and followed until too few are left.

A tracked corner is where its point projects, plus white noise, plus a drift that adds up from image to image, as of a
tracker whose template is the image before (bell2019, section 4.6: normalised cross-correlation). A small share of the
corners slips at each image and then drifts at a steady rate: what the gates are there for.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from camnet.estimation.structure.camera_path import CameraStates
from camnet.estimation.structure.key_frames.settings import KeyFrameSettings
from camnet.geometry.pinhole import Pinhole
from camnet.geometry.rotations import to_matrix
from camnet.settings import Fraction, NonNegative, Settings
from camnet.types import Array, BoolArray, IntArray

__all__ = ["KeyFrameTracks", "SimulatedKeyFrames", "TrackNoise", "TrackedKeyFrame"]

#: images that a key frame may live; a camera that stands would keep one for ever
_LONGEST = 300
_FAR_M = 6.0


class TrackNoise(Settings):
    """White noise and drift per image, pixels; share of the corners that slip at an image, and how fast they drift."""

    noise_px: NonNegative = 0.5
    drift_px: NonNegative = 0.31
    slip_share: Fraction = 0.0005
    slip_px: NonNegative = 0.5


@dataclass(frozen=True, eq=False, slots=True)
class TrackedKeyFrame:
    """One key frame's corners at its T images.

    Attributes
    ----------
    first : number of its first image
    ids : (N,) numbers of the points
    pixels : (T, N, 2) where they are
    seen : (T, N) whether they are tracked; lost ones do not come back
    points_world : (N, 3) the true points, m; for what is reported, not for estimators
    """

    first: int
    ids: IntArray
    pixels: Array
    seen: BoolArray
    points_world: Array


class KeyFrameTracks(Protocol):
    """A stream of key frames, each beginning with the image after the last of the one before."""

    def __iter__(self) -> Iterator[TrackedKeyFrame]:
        """Key frames in the order of time."""


class SimulatedKeyFrames:
    """Key frames of known points.

    Parameters
    ----------
    points_world : (P, 3) m; they hide nothing
    truth : the camera's states at all images
    camera : pinhole without distortion
    settings : how many corners and how far apart
    noise : see `TrackNoise`
    rng : generator of the noise
    """

    def __init__(
        self, points_world: Array, truth: CameraStates, camera: Pinhole, settings: KeyFrameSettings,
        noise: TrackNoise, rng: np.random.Generator,
    ) -> None:  # fmt: skip
        self._points, self._truth, self._camera = points_world, truth, camera
        self._s, self._noise, self._rng = settings, noise, rng
        self._turn = to_matrix(truth.q_world)

    def visible(self, image: int) -> tuple[IntArray, Array]:
        """Numbers (V,) of the points in an image, and where they project (V, 2), without noise."""
        p = self._truth.p_world[image]
        near = np.flatnonzero(np.max(np.abs(self._points - p), axis=1) < _FAR_M)
        p_cam = (self._points[near] - p) @ self._turn[image]
        ahead = p_cam[:, 2] > 0.1
        near, pixels = near[ahead], self._camera.project(p_cam[ahead])
        inside = self._camera.in_image(pixels)
        return near[inside], pixels[inside]

    def __iter__(self) -> Iterator[TrackedKeyFrame]:
        """Yield key frames until the images end; the last may be cut short."""
        first, images = 0, len(self._truth.t_s)
        while first < images:
            key = self._track(first)
            yield key
            first += len(key.seen)

    def _track(self, first: int) -> TrackedKeyFrame:
        ids = self._choose(first)
        span = slice(first, min(first + _LONGEST, len(self._truth.t_s)))
        away = self._points[ids] - self._truth.p_world[span, None]
        p_cam = np.einsum("tji,tnj->tni", self._turn[span], away)
        pixels = self._camera.project(np.where(p_cam[..., 2:] > 0.1, p_cam, [0.0, 0.0, -1.0]))
        pixels = pixels + self._errors(*p_cam.shape[:2])
        seen = (p_cam[..., 2] > 0.1) & self._camera.in_image(pixels)
        seen = np.logical_and.accumulate(seen, axis=0)
        enough = np.sum(seen, axis=1) >= self._s.least_features
        # an image without enough corners still is a key frame of its own, so that the next one can be tried
        last = max(int(np.argmin(enough)) if not enough.all() else len(enough), 1)
        return TrackedKeyFrame(first, ids, pixels[:last], seen[:last], self._points[ids])

    def _choose(self, image: int) -> IntArray:
        """Corners at least a spacing apart, in an order drawn at random."""
        ids, pixels = self.visible(image)
        chosen: list[int] = []
        for k in self._rng.permutation(len(ids)).tolist():
            apart = np.linalg.norm(pixels[chosen] - pixels[k], axis=1)
            if len(chosen) < self._s.most_features and not np.any(apart < self._s.spacing_px):
                chosen.append(k)
        return np.sort(ids[chosen])

    def _errors(self, images: int, count: int) -> Array:
        n = self._noise
        white, drift = self._rng.standard_normal((2, images, count, 2))
        slips = np.logical_or.accumulate(self._rng.random((images, count)) < n.slip_share, axis=0)
        rate = n.slip_px * self._rng.standard_normal((count, 2))
        step = n.drift_px * drift + slips[..., None] * rate
        step[0] = 0.0
        return np.asarray(n.noise_px * white + np.cumsum(step, axis=0), dtype=np.float64)
