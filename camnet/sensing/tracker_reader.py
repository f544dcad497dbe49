"""Level ``image_tracker``: a target without a marker, followed from picture to picture by a correlation tracker.

    scene drawn -> noise, 8 bits -> box found about where the motion says (`camnet.sensing.visual`)
                -> ray through its middle -> ground -> pose

| symbol | name | shape | unit |
| --- | --- | --- | --- |
| b | box in the picture, its centre c | | px |
| h | half the body's height: the ray through c is cut with the plane z = h | | m |
| p(t) | places on the ground, newest last | (k, 2) | m |

**Place.** Seen from above the foot of a body is hidden under it, and the lower edge of the box is its far side as often
as its near one. The middle of the box is the middle of the body to first order, whichever way the camera looks; so
the ray through it is cut with the plane at half the body's height.

**Heading.** A box says nothing of it: it is the direction of travel, of a straight line through the last places; until
the target has moved by ``heading_m`` there is no pose.

**First box.** A tracker follows, it does not find. The first box of every sighting, and the one after a loss, is that
of a detector, which is not part of this: the body's outline in the picture, each edge off by ``detector_noise_px``.
"""

from __future__ import annotations

import itertools
import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from camnet.errors import ConfigError
from camnet.geometry import rotations
from camnet.geometry.settings import CameraModel
from camnet.sensing.marker_view import Lens
from camnet.sensing.readers import Render
from camnet.sensing.settings import TrackerSettings
from camnet.sensing.visual import Box, CorrelationSettings, CorrelationTracker
from camnet.types import Array, Pose, Snapshot

__all__ = ["TrackerReader"]

#: places from which the heading is taken, and a gap after which a sighting is a new one, s
_PLACES, _NEW_S = 12, 0.75
#: boxes count from the corner of the first pixel, projections from its middle
_HALF = 0.5


@dataclass(eq=False)
class _Sighting:
    """One target in one camera: its tracker, and where on the ground it was."""

    tracker: CorrelationTracker
    t_s: float
    width_at_1m: float
    places: deque[tuple[float, Array]] = field(default_factory=lambda: deque(maxlen=_PLACES))
    heading: float | None = None


class TrackerReader:
    """Reads poses from pictures by following boxes; see the module's head.

    Parameters
    ----------
    settings : noise of the picture and of the first box, trust in the tracker
    cameras : C cameras
    features : for each of the M targets points (K, 3) of its body, m; their box, down to the ground, is its outline
    render : draws the whole scene

    Raises
    ------
    ConfigError
        The world does not render, or a lens is distorted.
    """

    def __init__(
        self,
        settings: TrackerSettings,
        cameras: Sequence[CameraModel],
        features: Sequence[ArrayLike],
        render: Render | None,
    ) -> None:
        if render is None:
            raise ConfigError("sensing.level 'image_tracker' needs a world that renders")
        self._settings, self._render = settings, render
        self._lenses = [Lens(camera.intrinsics) for camera in cameras]
        for camera, lens in zip(cameras, self._lenses, strict=True):
            if lens.pinhole.distorted:
                raise ConfigError(
                    f"camera {camera.name!r}: level 'image_tracker' needs a lens without distortion"
                )
        self._bodies = [_corners(np.asarray(f, dtype=float).reshape(-1, 3)) for f in features]
        self._known: dict[tuple[int, int], _Sighting] = {}
        self._picture: tuple[float, int, NDArray[np.uint8]] | None = None

    def read(self, snapshot: Snapshot, camera: int, target: int, rng: np.random.Generator) -> Pose | None:
        """See `camnet.sensing.readers.Reader.read`."""
        picture = self._drawn(snapshot, camera, rng)
        sighting = self._known.get((camera, target))
        box = None
        if sighting is not None and snapshot.t_s - sighting.t_s <= _NEW_S:
            box = self._follow(sighting, picture, snapshot, camera, target)
        if box is None or sighting is None:
            sighting, box = self._detect(picture, snapshot, camera, target, rng)
            if sighting is None or box is None:
                self._known.pop((camera, target), None)
                return None
            self._known[camera, target] = sighting
        sighting.t_s = snapshot.t_s
        place = self._on_ground(box.centre, snapshot, camera, 0.5 * self._height(target))
        if place is None:
            return None
        sighting.places.append((snapshot.t_s, place[:2]))
        self._turn(sighting)
        return None if sighting.heading is None else _relative(place, sighting.heading, snapshot, camera)

    def _drawn(self, snapshot: Snapshot, camera: int, rng: np.random.Generator) -> NDArray[np.uint8]:
        """Picture (h, w, 3) of a camera, drawn once a frame whatever the number of targets."""
        if self._picture is not None and self._picture[:2] == (snapshot.t_s, camera):
            return self._picture[2]
        k = self._lenses[camera].intrinsics
        scene = self._render(camera, k.width_px, k.height_px)[..., :3].astype(np.float32)
        scene += np.float32(self._settings.noise_levels) * rng.standard_normal(scene.shape, dtype=np.float32)
        picture = cv2.cvtColor(np.clip(scene, 0, 255).astype(np.uint8), cv2.COLOR_RGB2BGR)
        self._picture = (snapshot.t_s, camera, np.asarray(picture))
        return self._picture[2]

    # --- the box -----------------------------------------------------------------------------------------------------

    def _follow(
        self, sighting: _Sighting, picture: NDArray[np.uint8], snapshot: Snapshot, camera: int, target: int
    ) -> Box | None:
        """Box about where the last places and the camera's own motion put the target; None when it is lost."""
        place = np.array([*_ahead(sighting, snapshot.t_s), 0.5 * self._height(target)])
        lens = self._lenses[camera].pinhole
        hint = lens.project_world(
            place[None], snapshot.camera_p_world[camera], snapshot.camera_q_world[camera]
        )
        if not np.isfinite(hint).all():
            return None
        result = sighting.tracker.update(
            picture, hint[0] + _HALF, sighting.width_at_1m / self._depth(place, snapshot, camera)
        )
        if result.psr < self._settings.least_psr:
            return None
        sighting.width_at_1m = result.box.width * self._depth(place, snapshot, camera)
        return result.box

    def _detect(
        self,
        picture: NDArray[np.uint8],
        snapshot: Snapshot,
        camera: int,
        target: int,
        rng: np.random.Generator,
    ) -> tuple[_Sighting | None, Box | None]:
        """Start a tracker on the outline of the body in the picture, as a detector would give it."""
        at, turn = snapshot.target_p_world[target], snapshot.target_q_world[target]
        corners = rotations.rotate(turn, self._bodies[target]) + at
        lens = self._lenses[camera].pinhole
        pixels = lens.project_world(corners, snapshot.camera_p_world[camera], snapshot.camera_q_world[camera])
        if not np.isfinite(pixels).all():
            return None, None
        noise = self._settings.detector_noise_px * rng.standard_normal(4)
        x0, y0, x1, y1 = np.concatenate([pixels.min(axis=0), pixels.max(axis=0)]) + _HALF + noise
        box = Box(x0, y0, max(x1 - x0, 4.0), max(y1 - y0, 4.0))
        height, width = picture.shape[:2]
        if not (0 <= box.centre[0] < width and 0 <= box.centre[1] < height):
            return None, None
        tracker = CorrelationTracker(CorrelationSettings(min_psr=self._settings.least_psr))
        tracker.start(picture, box)
        old = self._known.get((camera, target))
        depth = self._depth(at, snapshot, camera)
        sighting = _Sighting(tracker, snapshot.t_s, box.width * depth)
        if (
            old is not None and snapshot.t_s - old.t_s <= _NEW_S
        ):  # lost for a moment: the way it went still holds
            sighting.places, sighting.heading = old.places, old.heading
        return sighting, box

    # --- the pose ----------------------------------------------------------------------------------------------------

    def _height(self, target: int) -> float:
        return float(self._bodies[target][:, 2].max())

    @staticmethod
    def _depth(place: Array, snapshot: Snapshot, camera: int) -> float:
        away = place - snapshot.camera_p_world[camera]
        return max(
            float(rotations.rotate(rotations.conjugate(snapshot.camera_q_world[camera]), away)[2]), 0.1
        )

    def _on_ground(self, pixel: Array, snapshot: Snapshot, camera: int, height_m: float) -> Array | None:
        """Point (3,) on the ground below where the ray through ``pixel`` meets the plane z = ``height_m``."""
        x, y = self._lenses[camera].pinhole.normalise(pixel[None] - _HALF)[0]
        ray = rotations.rotate(snapshot.camera_q_world[camera], np.array([x, y, 1.0]))
        eye = snapshot.camera_p_world[camera]
        if not ray[2] < -1e-6:
            return None
        met = eye + (height_m - eye[2]) / ray[2] * ray
        return np.array([met[0], met[1], 0.0])

    def _turn(self, sighting: _Sighting) -> None:
        """Heading: slope of a straight line through the last places, once they are far enough apart."""
        p = np.array([place for _, place in sighting.places])
        if np.linalg.norm(p[-1] - p[0]) < self._settings.heading_m:
            return
        v = _velocity(sighting)
        sighting.heading = math.atan2(v[1], v[0])


def _velocity(sighting: _Sighting) -> Array:
    """Least-squares velocity (2,) through the last places, m/s."""
    if len(sighting.places) < 3:
        return np.zeros(2)
    t = np.array([when for when, _ in sighting.places])
    p = np.array([place for _, place in sighting.places])
    t -= t.mean()
    return np.asarray(t @ (p - p.mean(axis=0)) / float(t @ t))


def _ahead(sighting: _Sighting, t_s: float) -> Array:
    when, place = sighting.places[-1]
    return np.asarray(place + (t_s - when) * _velocity(sighting))


def _relative(place: Array, heading: float, snapshot: Snapshot, camera: int) -> Pose:
    """Pose in the camera frame of a target at ``place`` (3,) that looks along ``heading``."""
    back = rotations.conjugate(snapshot.camera_q_world[camera])
    q = np.array([math.cos(0.5 * heading), 0.0, 0.0, math.sin(0.5 * heading)])
    return Pose(rotations.rotate(back, place - snapshot.camera_p_world[camera]), rotations.multiply(back, q))


def _corners(points: Array) -> Array:
    """Corners (8, 3) of the box about points (K, 3), from the ground up."""
    low, high = points.min(axis=0), points.max(axis=0)
    low[2] = 0.0
    return np.array(list(itertools.product(*zip(low, high, strict=True))))
