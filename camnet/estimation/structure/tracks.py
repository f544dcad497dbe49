"""Feature tracks: where numbered points are in each image. One protocol for simulated and real tracks.

Anything that yields `TrackedFrame` in the order of time is `FeatureTracks`: `SimulatedTracks` here, ``image_tracks``
for corners followed through real images. A number (``ids``) means one physical point for as long as the tracker can
tell; it is never used again.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from camnet.errors import ConfigError
from camnet.estimation.structure.camera_path import CameraPath
from camnet.geometry.pinhole import Pinhole
from camnet.geometry.rotations import to_matrix
from camnet.types import Array, BoolArray, IntArray

__all__ = ["FeatureTracks", "SimulatedTracks", "TrackedFrame", "match"]


@dataclass(frozen=True, eq=False, slots=True)
class TrackedFrame:
    """Features seen in one image.

    Attributes
    ----------
    t_s : time of the image, s
    ids : (N,) numbers of the features, ascending
    pixels : (N, 2) where they are, pixels, lens distortion included
    """

    t_s: float
    ids: IntArray
    pixels: Array


class FeatureTracks(Protocol):
    """A stream of tracked frames."""

    def __iter__(self) -> Iterator[TrackedFrame]:
        """Frames in the order of time."""


def match(frame: TrackedFrame, ids: IntArray) -> tuple[Array, BoolArray]:
    """Pixels (M, 2) of the features ``ids`` (M,) in a frame, NaN where absent, and whether each is there (M,)."""
    pixels = np.full((len(ids), 2), np.nan)
    if len(frame.ids) == 0:
        return pixels, np.zeros(len(ids), dtype=bool)
    place = np.minimum(np.searchsorted(frame.ids, ids), len(frame.ids) - 1)
    there = frame.ids[place] == ids
    pixels[there] = frame.pixels[place[there]]
    return pixels, np.asarray(there)


class SimulatedTracks:
    """Projections of known points, with pixel noise.

    Parameters
    ----------
    points_world : (N, 3) points, m
    path : the camera's true path
    camera : its pinhole
    t_s : (K,) times of the images, s
    noise_px : standard deviation of each coordinate, pixels
    rng : generator of the noise
    normals_world : (N, 3) outward normals: a point is seen from its front only; None: from everywhere
    near_m, far_m : range of depths in which points are seen, m

    Raises
    ------
    ConfigError
        If the noise is negative.
    """

    def __init__(
        self,
        points_world: Array,
        path: CameraPath,
        camera: Pinhole,
        t_s: Array,
        noise_px: float,
        rng: np.random.Generator,
        normals_world: Array | None = None,
        near_m: float = 0.1,
        far_m: float = np.inf,
    ) -> None:
        if not noise_px >= 0.0:
            raise ConfigError(
                f"noise_px {noise_px!r}: give a standard deviation in pixels that is not negative"
            )
        self._points, self._normals = np.asarray(points_world, dtype=np.float64), normals_world
        self._path, self._camera = path, camera
        self._t, self._noise, self._rng = np.asarray(t_s, dtype=np.float64), noise_px, rng
        self._near, self._far = near_m, far_m

    def __iter__(self) -> Iterator[TrackedFrame]:
        """Yield each image's features; a second pass draws new noise."""
        truth = self._path.states(self._t)
        turns = to_matrix(truth.q_world)
        for k, t in enumerate(self._t.tolist()):
            away = self._points - truth.p_world[k]
            p_cam = away @ turns[k]
            pixels = self._camera.project(p_cam)
            seen = self._camera.in_image(pixels) & (p_cam[:, 2] > self._near) & (p_cam[:, 2] < self._far)
            if self._normals is not None:
                seen &= np.sum(away * self._normals, axis=1) < 0.0
            # noise for every point, seen or not: what one point gets does not hang on the others
            pixels = pixels + self._noise * self._rng.standard_normal(pixels.shape)
            yield TrackedFrame(t, np.flatnonzero(seen), pixels[seen])
