"""Rendered input for the key-frame experiment: a corridor with posters and a floor, drawn at every image.

Four outer walls and the floor are drawn through their planes' homographies (`camnet.sensing.textured_planes`), blurred
by the lens and given noise of 2 grey levels. Corners are found in the first image of a key frame and followed by
`camnet.estimation.structure.image_tracks` until too few are left. Size and rate of the images are a third of those of
the camera of the simulated tracks: the shift between images is as many pixels, and drawing takes a 27th of the time.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from camnet.estimation.structure.image_tracks import ImageTracks, TrackerSettings
from camnet.experiments.key_frame_setup import CorridorScene, SetUp, WorldSettings
from camnet.experiments.key_frame_tracks import TrackedKeyFrame
from camnet.geometry.pinhole import Pinhole
from camnet.geometry.rotations import to_matrix
from camnet.geometry.settings import Intrinsics
from camnet.sensing.textured_planes import TexturedPlane, draw_planes
from camnet.types import Array, BoolArray

__all__ = ["RenderedKeyFrames", "corridor_planes", "image_setup"]

_SMALLER = 3
_GREY_SD, _BLUR_PX, _SAMPLES = 2.0, 0.6, 2
#: texture pixels a metre, and the sides of what is printed on posters and floor, m
_WALL_PX, _FLOOR_PX, _POSTER_CELL_M, _FLOOR_CELL_M = 300, 150, 0.08, 0.2


def image_setup(setup: SetUp) -> SetUp:
    """Return the set-up for rendered images: two loops, a third of the resolution and rate, pixel sizes to match."""
    c, s = setup.world.camera, 1.0 / _SMALLER
    small = Intrinsics(
        width_px=c.width_px // _SMALLER, height_px=c.height_px // _SMALLER, fx_px=s * c.fx_px, fy_px=s * c.fy_px,
        cx_px=s * c.cx_px, cy_px=s * c.cy_px,
    )  # fmt: skip
    world = setup.world.model_copy(update={"loops": 2, "frame_hz": s * setup.world.frame_hz, "camera": small})
    frames = setup.key_frames
    poses = frames.relative_pose.model_copy(update={"noise_px": s * frames.relative_pose.noise_px})
    fewer = frames.model_copy(update={"spacing_px": s * frames.spacing_px, "relative_pose": poses})
    gates = tuple(s * gate for gate in setup.gates_px)
    return setup.model_copy(update={"world": world, "key_frames": fewer, "gates_px": gates})


def corridor_planes(s: WorldSettings, rng: np.random.Generator) -> list[TexturedPlane]:
    """Four walls with posters, and the floor."""
    half = 0.5 * np.array(s.size_m) + s.wall_m
    ring = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]]) * half
    down = np.array([0.0, 0.0, -s.wall_height_m])
    planes = []
    for a, b in pairwise(ring):
        length = float(np.linalg.norm(b - a))
        corner, across = np.append(a, s.wall_height_m), np.append(b - a, 0.0)
        planes.append(TexturedPlane(corner, across, down, _posters(length, s.wall_height_m, rng)))
    shape = np.ceil(2.0 * half / _FLOOR_CELL_M).astype(int)
    floor = rng.integers(60, 190, (shape[1], shape[0]))
    cell = round(_FLOOR_CELL_M * _FLOOR_PX)
    picture = np.kron(floor, np.ones((cell, cell))).astype(np.uint8)
    corner = np.append(ring[3], 0.0)
    planes.append(
        TexturedPlane(
            corner, np.array([2.0 * half[0], 0.0, 0.0]), np.array([0.0, -2.0 * half[1], 0.0]), picture
        )
    )
    return planes


def _posters(length: float, height: float, rng: np.random.Generator) -> NDArray[np.uint8]:
    """Wall with posters of random cells, 0.4 to 0.9 m wide and 0.1 m apart."""
    cell = round(_POSTER_CELL_M * _WALL_PX)
    wall = np.full((round(height * _WALL_PX), round(length * _WALL_PX)), 150, dtype=np.uint8)
    left = 0
    while left < wall.shape[1]:
        wide, high = int(rng.integers(5, 12)), int(rng.integers(7, 12))
        top = int(rng.integers(0, max(wall.shape[0] - high * cell, 1)))
        poster = np.kron(rng.integers(20, 235, (high, wide)), np.ones((cell, cell))).astype(np.uint8)
        room = wall[top : top + high * cell, left : left + wide * cell]
        room[:] = poster[: room.shape[0], : room.shape[1]]
        left += wide * cell + round(0.1 * _WALL_PX)
    return wall


class RenderedKeyFrames:
    """Key frames read from rendered images; the protocol of `KeyFrameTracks`.

    Parameters
    ----------
    setup : from `image_setup`
    scene : the camera's true path
    rng : textures and noise
    """

    def __init__(self, setup: SetUp, scene: CorridorScene, rng: np.random.Generator) -> None:
        self._setup, self._truth, self._rng = setup, scene.truth, rng
        self._camera = Pinhole.from_settings(setup.world.camera)
        self._planes = corridor_planes(setup.world, rng)
        width, height = self._camera.size.astype(int).tolist()
        self._noise = (_GREY_SD * rng.standard_normal((height, width))).astype(np.float32)

    def image(self, k: int) -> NDArray[np.uint8]:
        """Return image k."""
        drawn = draw_planes(
            self._planes, self._camera, self._truth.p_world[k], self._truth.q_world[k], samples=_SAMPLES
        )
        shift = tuple(self._rng.integers(0, self._noise.shape).tolist())
        noisy = cv2.GaussianBlur(drawn, (0, 0), _BLUR_PX) + np.roll(self._noise, shift, axis=(0, 1))
        return np.asarray(np.clip(np.rint(noisy), 0, 255), dtype=np.uint8)

    def points(self, k: int, pixels: Array) -> Array:
        """Return the points (N, 3) that pixels (N, 2) of image k show; NaN where they show nothing."""
        rays = self._camera.unproject(pixels) @ to_matrix(self._truth.q_world[k]).T
        p, nearest = self._truth.p_world[k], np.full(len(rays), np.inf)
        for plane in self._planes:
            normal = np.cross(plane.across, plane.down)
            with np.errstate(divide="ignore"):
                d = ((plane.corner - p) @ normal) / (rays @ normal)
            # what lies beyond a plane's edge lies behind another plane of the closed corridor
            nearest = np.where((d > 0.0) & (d < nearest), d, nearest)
        return np.asarray(p + np.where(np.isfinite(nearest), nearest, np.nan)[:, None] * rays)

    def __iter__(self) -> Iterator[TrackedKeyFrame]:
        """Yield key frames until the images end."""
        first, images = 0, len(self._truth.t_s)
        while first < images:
            key = self._track(first, images)
            yield key
            first += len(key.seen)

    def _track(self, first: int, images: int) -> TrackedKeyFrame:
        s = self._setup.key_frames
        settings = TrackerSettings(corners=s.most_features, spacing_px=s.spacing_px, renew_share=0.0)
        stream = ((float(self._truth.t_s[k]), self.image(k)) for k in range(first, images))
        pixels: list[Array] = []
        seen: list[BoolArray] = []
        count = 0
        for frame in ImageTracks(stream, settings):
            if not seen:
                count = len(frame.ids)
            elif len(frame.ids) < s.least_features:
                break
            now, there = np.full((count, 2), np.nan), np.zeros(count, dtype=bool)
            now[frame.ids], there[frame.ids] = frame.pixels, True
            pixels.append(now)
            seen.append(there)
        return TrackedKeyFrame(
            first, np.arange(count), np.array(pixels), np.array(seen), self.points(first, pixels[0])
        )
