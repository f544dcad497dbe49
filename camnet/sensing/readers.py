"""What a camera makes of one target in one frame, at the levels of features and of images.

    features: projected points + pixel noise -> PnP -> plausible? -> pose
    image:    marker drawn -> lens blur, gain, noise, 8 bits -> ArUco -> PnP of a square -> plausible? -> pose

Poses come from what the image shows and from the calibrated lens alone; the truth only makes the image.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Protocol

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from camnet.errors import ConfigError
from camnet.geometry import rotations
from camnet.geometry.settings import CameraModel
from camnet.sensing.edges import refine_corners
from camnet.sensing.marker import DICTIONARY, MODULES, Marker, marker_on
from camnet.sensing.marker_view import Lens, Patch, draw_marker, marker_motion
from camnet.sensing.pnp import BranchKeeper, Candidate, in_one_plane, plane_of, solve_pose
from camnet.sensing.settings import FeatureSettings, ImageSettings
from camnet.types import Array, Pose, Snapshot

__all__ = ["FeatureReader", "ImageReader", "Reader", "Render", "corner_detector", "develop", "surroundings"]

#: (camera, width, height) -> the scene as that camera sees it, (height, width, 3), RGB
Render = Callable[[int, int, int], NDArray[np.uint8]]

#: mean grey level around a marker, and the size of its blotches, pixels
_AROUND, _BLOTCH_PX = 110.0, 24
#: least perimeter of a marker as a share of the picture's size, in a whole image and in the patch around a marker
_LEAST_IN_IMAGE, _LEAST_IN_PATCH = 0.05, 0.5
#: standard deviation of a detected corner's coordinate, pixels, by which the two poses of a square are weighed
CORNER_NOISE_PX = 0.05


class Reader(Protocol):
    """Reads one target's pose from one camera's view of it."""

    def read(self, snapshot: Snapshot, camera: int, target: int, rng: np.random.Generator) -> Pose | None:
        """Pose of the target in the camera frame, None where none can be told; ``rng`` is for this view alone."""
        ...


class _Range:
    """Depths at which each camera can see at all."""

    def __init__(self, cameras: Sequence[CameraModel]) -> None:
        self._limits = [(camera.near_m, camera.far_m) for camera in cameras]

    def holds(self, camera: int, one: Candidate) -> bool:
        """Whether a pose is within the camera's range, a tenth beyond its ends included."""
        near, far = self._limits[camera]
        return bool(0.9 * near <= one.p[2] <= 1.1 * far)


class FeatureReader:
    """Level ``features``: see the module's head.

    Parameters
    ----------
    settings : noise and solver
    cameras : C cameras
    features : for each of the M targets its points (K, 3) in its body, m
    """

    def __init__(
        self, settings: FeatureSettings, cameras: Sequence[CameraModel], features: Sequence[ArrayLike]
    ) -> None:
        self._settings = settings
        self._lenses = [Lens(camera.intrinsics) for camera in cameras]
        self._range = _Range(cameras)
        self._points = [np.ascontiguousarray(f, dtype=np.float64).reshape(-1, 3) for f in features]
        self._methods = [_method(settings, points) for points in self._points]
        self._frames = [_local(points) for points in self._points]
        self._keepers = [[BranchKeeper(settings.pixel_noise_px) for _ in self._points] for _ in self._lenses]

    def read(self, snapshot: Snapshot, camera: int, target: int, rng: np.random.Generator) -> Pose | None:
        """See `Reader.read`."""
        points, lens = self._points[target], self._lenses[camera].pinhole
        q_camera = snapshot.camera_q_world[camera]
        in_world = rotations.rotate(snapshot.target_q_world[target], points) + snapshot.target_p_world[target]
        pixels = lens.project_world(in_world, snapshot.camera_p_world[camera], q_camera)
        pixels += self._settings.pixel_noise_px * rng.standard_normal(pixels.shape)
        seen = lens.normalise(pixels)
        if not np.isfinite(seen).all():
            return None
        s = self._settings
        frame, local = self._frames[target]
        found = solve_pose(local, frame, seen, float(lens.focal[0]), self._methods[target], s.refine)
        plausible = [
            one for one in found if one.error_px <= s.max_reprojection_px and self._range.holds(camera, one)
        ]
        if not plausible:
            return None
        one = self._keepers[camera][target].choose(plausible, len(points), q_camera, snapshot.t_s)
        return Pose(one.p, one.q)


def _local(points: Array) -> tuple[Pose, Array]:
    """Frame on the body in which points of one plane have z = 0 (the body's own for others), and the points in it."""
    if not in_one_plane(points):
        return Pose(np.zeros(3), rotations.IDENTITY), points
    frame = plane_of(points)
    local = (points - frame.p) @ rotations.to_matrix(frame.q)
    local[:, 2] = 0.0
    return frame, local


def _method(settings: FeatureSettings, points: Array) -> str:
    flat = in_one_plane(points)
    if settings.solver == "auto":
        return "ippe" if flat else "sqpnp"
    if settings.solver == "ippe" and not flat:
        raise ConfigError(
            "sensing.features.solver 'ippe': the target's features_m must lie in one plane; use 'sqpnp' or 'auto'"
        )
    return settings.solver


def corner_detector(least_share: float, windows_px: tuple[int, int]) -> cv2.aruco.ArucoDetector:
    """Detector of the markers' dictionary.

    Corners are left as found, for `refine_corners` to refine. The plate's own outline must not be taken for the
    marker's: outlines are told apart from a few hundredths of their size on.

    Parameters
    ----------
    least_share : least perimeter of a marker as a share of the picture's size
    windows_px : smallest and largest window, odd, over which the mean is taken that separates dark from light
    """
    parameters = cv2.aruco.DetectorParameters()
    parameters.minMarkerPerimeterRate = least_share
    parameters.minMarkerDistanceRate = 0.02
    parameters.adaptiveThreshWinSizeMin, parameters.adaptiveThreshWinSizeMax = windows_px
    parameters.adaptiveThreshWinSizeStep = max(2, (windows_px[1] - windows_px[0]) // 2)
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_NONE
    return cv2.aruco.ArucoDetector(DICTIONARY, parameters)


def surroundings(width: int, height: int, contrast: float) -> NDArray[np.float32]:
    """Grey levels (height, width) of a blotchy ground, always the same."""
    coarse = np.random.default_rng(0).standard_normal((height // _BLOTCH_PX + 3, width // _BLOTCH_PX + 3))
    smooth = cv2.resize(coarse.astype(np.float32), (width, height), interpolation=cv2.INTER_CUBIC)
    return np.asarray(_AROUND + contrast * smooth, dtype=np.float32)


def develop(
    pixels: NDArray[np.float32], settings: ImageSettings, rng: np.random.Generator
) -> NDArray[np.uint8]:
    """Picture (h, w), 8 bits, that a sensor makes of ideal grey levels: lens blur, gain, noise, rounding."""
    if settings.blur_px > 0.0:
        pixels = np.asarray(cv2.GaussianBlur(pixels, (0, 0), settings.blur_px), dtype=np.float32)
    gain = np.float32(np.exp(settings.gain_std * rng.standard_normal()))
    noise = rng.standard_normal(pixels.shape, dtype=np.float32)
    levels = gain * pixels + np.float32(settings.noise_levels) * noise
    return np.clip(np.rint(levels), 0, 255).astype(np.uint8)


class ImageReader:
    """Level ``image``: see the module's head.

    Parameters
    ----------
    settings : camera and picture
    cameras : C cameras
    features : for each of the M targets the corners (4, 3) between which its marker is, m
    render : draws the whole scene, for ``renderer: pybullet``
    """

    def __init__(
        self,
        settings: ImageSettings,
        cameras: Sequence[CameraModel],
        features: Sequence[ArrayLike],
        render: Render | None = None,
    ) -> None:
        if settings.renderer == "pybullet" and (settings.exposure_s or settings.readout_s):
            raise ConfigError(
                f"sensing.image: renderer 'pybullet' shows one instant; exposure_s {settings.exposure_s:g} and "
                f"readout_s {settings.readout_s:g} must be 0, or use renderer 'homography'"
            )
        if settings.renderer == "pybullet" and render is None:
            raise ConfigError("sensing.image: renderer 'pybullet' needs a world that renders")
        self._settings, self._render = settings, render
        self._lenses = _shared_lenses(cameras)
        self._range = _Range(cameras)
        self._markers = [marker_on(f, m) for m, f in enumerate(features)]
        self._detectors: dict[int, cv2.aruco.ArucoDetector] = {}
        sizes = {(lens.intrinsics.width_px, lens.intrinsics.height_px) for lens in self._lenses}
        self._around = {size: surroundings(*size, settings.background_contrast) for size in sizes}
        self._keepers = [[BranchKeeper(CORNER_NOISE_PX) for _ in self._markers] for _ in cameras]

    def read(self, snapshot: Snapshot, camera: int, target: int, rng: np.random.Generator) -> Pose | None:
        """See `Reader.read`."""
        patch = self.patch(snapshot, camera, target)
        if patch is None:
            return None
        marker, lens = self._markers[target], self._lenses[camera]
        picture = develop(patch.pixels, self._settings, rng)
        offset = np.array([patch.left, patch.top])
        seen = self.corners(picture, marker, lambda pixels: lens.normalise(pixels + offset))
        if seen is None:
            return None
        frame = Pose(marker.p_body, marker.q_body)
        found = solve_pose(marker.square(), frame, seen, lens.intrinsics.fx_px, "square")
        limit = self._settings.max_reprojection_px
        plausible = [one for one in found if one.error_px <= limit and self._range.holds(camera, one)]
        if not plausible:
            return None
        q_camera = snapshot.camera_q_world[camera]
        one = self._keepers[camera][target].choose(plausible, 4, q_camera, snapshot.t_s)
        return Pose(one.p, one.q)

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_detectors": {}}  # OpenCV's objects are made again when needed

    def patch(self, snapshot: Snapshot, camera: int, target: int) -> Patch | None:
        """Ideal picture of the target's marker and what is around it; None if it is not in the image."""
        s, lens = self._settings, self._lenses[camera]
        k = lens.intrinsics
        if self._render is not None and s.renderer == "pybullet":
            scene = cv2.cvtColor(self._render(camera, k.width_px, k.height_px), cv2.COLOR_RGB2GRAY)
            return Patch(_through_lens(np.asarray(scene, dtype=np.float32), lens), 0, 0)
        marker = self._markers[target]
        plane, rate = marker_motion(snapshot, camera, target, marker)
        around = self._around[k.width_px, k.height_px]
        return draw_marker(lens, plane, rate, marker, around, s.samples, s.exposure_s, s.readout_s)

    def corners(
        self, picture: NDArray[np.uint8], marker: Marker, normalise: Callable[[Array], Array]
    ) -> Array | None:
        """Corners (4, 2) of the marker in what ``normalise`` makes of pixels (..., 2); None if it was not found."""
        corners, numbers, _ = self._detector(picture).detectMarkers(picture)
        # where nothing is found there are no corners, and numbers is None
        for found, number in zip(corners, np.ravel(numbers), strict=False):
            if number == marker.number:
                return refine_corners(picture, found.reshape(4, 2).astype(np.float64), MODULES, normalise)
        return None

    def _detector(self, picture: NDArray[np.uint8]) -> cv2.aruco.ArucoDetector:
        """Detector for a patch or a whole image; in a patch a window of two or three modules is enough."""
        window = 0 if self._settings.renderer == "pybullet" else 2 * (max(picture.shape) // 6) + 1
        if window not in self._detectors:
            self._detectors[window] = (
                corner_detector(_LEAST_IN_PATCH, (window, window))
                if window
                else corner_detector(_LEAST_IN_IMAGE, (13, 53))
            )
        return self._detectors[window]


def _shared_lenses(cameras: Sequence[CameraModel]) -> list[Lens]:
    """One lens for each camera; equal ones share their rays."""
    known: dict[str, Lens] = {}
    return [known.setdefault(c.intrinsics.model_dump_json(), Lens(c.intrinsics)) for c in cameras]


def _through_lens(scene: NDArray[np.float32], lens: Lens) -> NDArray[np.float32]:
    """Give a picture without distortion that of the lens."""
    if not lens.pinhole.distorted:
        return scene
    k = lens.intrinsics
    corners = lens.rays(0, 0, k.width_px, k.height_px)
    middles = 0.25 * (corners[:-1, :-1] + corners[1:, :-1] + corners[:-1, 1:] + corners[1:, 1:])
    where = (middles * lens.pinhole.focal + lens.pinhole.centre).astype(np.float32)
    bent = cv2.remap(scene, where[..., 0], where[..., 1], cv2.INTER_LINEAR)
    return np.asarray(bent, dtype=np.float32)
