"""Camera path and points from a video or a folder of images (`camnet structure`).

1. Features: corners followed through the images, or the inner corners of a checkerboard found in each (``board``), for
   photographs too far apart to follow anything.
2. Key images: one is kept when the features have moved by ``key_px`` since the last one kept; of photographs all are.
3. `reconstruct` with the odometry's poses at the key images, or without.

The intrinsics come from a file; with a board they may be calibrated from the images themselves.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from camnet.errors import DataError
from camnet.estimation.structure.image_tracks import ImageTracks, TrackerSettings
from camnet.estimation.structure.reconstruct import Reconstruction, ReconstructionSettings, reconstruct
from camnet.estimation.structure.tracks import TrackedFrame
from camnet.geometry.pinhole import Pinhole
from camnet.geometry.rotations import slerp, to_matrix
from camnet.geometry.settings import Intrinsics
from camnet.importers.image_masks import open_masks
from camnet.importers.image_sequence import ImageSequence, open_images
from camnet.importers.opencv_camera import read_opencv_intrinsics
from camnet.importers.poses import read_tum
from camnet.report.encode import video_file
from camnet.report.structure_files import write_kitti, write_ply, write_tum
from camnet.types import Array, Pose

__all__ = ["StructureInput", "print_table", "run"]

#: rate of the annotated video of a folder, and images that a calibration needs
_FOLDER_HZ, _LEAST_CALIBRATION = 2.0, 5


@dataclass(frozen=True, slots=True)
class StructureInput:
    """What the command names.

    Attributes
    ----------
    source : video, or folder of images
    odometry : TUM file of the odometry's camera poses; None: no scale
    camera : OpenCV's camera file; None: calibrated from the board
    mask : image whose non-zero pixels may hold corners, or folder with one such image for each image
    board : inner corners across and down; None: corners of any kind
    settings, tracker : see their classes
    key_px : movement of the features between key images, pixels
    """

    source: Path
    odometry: Path | None = None
    camera: Path | None = None
    mask: Path | None = None
    board: tuple[int, int] | None = None
    settings: ReconstructionSettings = field(default_factory=ReconstructionSettings)
    tracker: TrackerSettings = field(default_factory=TrackerSettings)
    key_px: float = 15.0


def run(
    given: StructureInput, out_dir: Path, progress: Callable[[float], None] | None = None
) -> dict[str, Any]:
    """Reconstruct and write ``points.ply``, ``path_tum.txt``, ``path_kitti.txt`` and ``structure.mp4`` to a folder.

    Raises
    ------
    DataError
        Inputs that cannot be read or do not suffice.
    """
    images = open_images(given.source)
    tell = progress or (lambda share: None)
    frames = _board_frames(images, given) if given.board else _followed(images, given)
    tell(0.5)
    camera, calibration_px = _camera(images, given, frames)
    odometry = None if given.odometry is None else _odometry(given.odometry, frames, images)
    result = reconstruct([frame for _, frame in frames], camera, odometry, given.settings)
    tell(0.8)
    write_tum(out_dir / "path_tum.txt", result.t_s, result.p, result.q)
    write_kitti(out_dir / "path_kitti.txt", result.p, result.q)
    write_ply(
        out_dir / "points.ply",
        result.points,
        "metre" if result.metric else "arbitrary: the path's extent is 1",
        result.scale_sd if result.consistent else None,
    )
    _write_video(out_dir / "structure.mp4", images, frames, result, camera)
    tell(1.0)
    return _content(result, camera, calibration_px)


def _content(result: Reconstruction, camera: Pinhole, calibration_px: float | None) -> dict[str, Any]:
    sd = result.scale_sd if result.consistent else None  # of what does not fit nothing is claimed
    return {
        "images": len(result.t_s),
        "points": len(result.ids),
        "metric": result.metric,
        "scale": None
        if sd is None
        else {
            "odometry_scale": result.scale,
            "relative_sd": sd,
            "true_over_found_ci95": [float(np.exp(-1.96 * sd)), float(np.exp(1.96 * sd))],
        },
        "path_m" if result.metric else "path_length": float(
            np.sum(np.linalg.norm(np.diff(result.p, axis=0), axis=1))
        ),
        "reprojection_px": result.reprojection_px,
        "odometry_chi2": result.odometry_chi2,
        "odometry_chi2_limit": result.odometry_limit,
        "consistent": result.consistent,
        "camera": {
            "fx_px": float(camera.focal[0]),
            "fy_px": float(camera.focal[1]),
            "cx_px": float(camera.centre[0]),
            "cy_px": float(camera.centre[1]),
            "calibrated_here_rms_px": calibration_px,
        },
    }


def _board_frames(images: ImageSequence, given: StructureInput) -> list[tuple[int, TrackedFrame]]:
    """Images in which the board was found, with the numbers of the images."""
    assert given.board is not None
    masks = None if given.mask is None else open_masks(given.mask, images)
    out = []
    for k, grey in _grey(given, images):
        corners = _board_corners(grey, given.board)
        if corners is not None and (masks is None or masks.hold(k, corners)):
            out.append((k, TrackedFrame(_time(images, k), np.arange(len(corners)), corners)))
    if len(out) < 2:
        raise DataError(
            f"{given.source}: a board of {given.board[0]} x {given.board[1]} inner corners was found in {len(out)} "
            f"images{'' if masks is None else ' within the mask'}; two are needed"
        )
    return out


def _grey(given: StructureInput, images: ImageSequence) -> Iterator[tuple[int, Any]]:
    """Numbers and grey images, all of one size."""
    size: tuple[int, ...] | None = None
    for k, image in enumerate(images.frames()):
        grey = np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), dtype=np.uint8)
        if size is not None and grey.shape != size:
            name = images.images[k] if images.images else f"{given.source}, image {k}"
            raise DataError(
                f"{name}: {grey.shape[1]} x {grey.shape[0]} pixels; the images before have {size[1]} x {size[0]}, "
                "and one camera takes one size"
            )
        size = grey.shape
        yield k, grey


def _board_corners(grey: Any, board: tuple[int, int]) -> Array | None:  # noqa: ANN401 - OpenCV's image
    found, corners = cv2.findChessboardCornersSB(grey, board)
    if not found:
        found, corners = cv2.findChessboardCorners(grey, board)
        if not found:
            return None
        stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 50, 1e-3)
        corners = cv2.cornerSubPix(grey, corners, (7, 7), (-1, -1), stop)
    return np.asarray(corners, dtype=np.float64).reshape(-1, 2)


def _followed(images: ImageSequence, given: StructureInput) -> list[tuple[int, TrackedFrame]]:
    """Key images of corners that were followed."""
    masks = None if given.mask is None else open_masks(given.mask, images)

    plain = ((_time(images, k), grey) for k, grey in _grey(given, images))
    kept: list[tuple[int, TrackedFrame]] = []
    for k, frame in enumerate(ImageTracks(plain, given.tracker, mask=masks)):
        if not kept or _moved(kept[-1][1], frame) >= given.key_px:
            kept.append((k, frame))
    return kept


def _moved(a: TrackedFrame, b: TrackedFrame) -> float:
    """Median movement of the features that two images share, pixels; infinite if they share few."""
    shared = np.intersect1d(a.ids, b.ids)
    if len(shared) < 0.5 * len(a.ids):
        return np.inf
    away = b.pixels[np.isin(b.ids, shared)] - a.pixels[np.isin(a.ids, shared)]
    return float(np.median(np.linalg.norm(away, axis=1)))


def _time(images: ImageSequence, k: int) -> float:
    return k / (images.rate_hz or 1.0)


def _camera(
    images: ImageSequence, given: StructureInput, frames: list[tuple[int, TrackedFrame]]
) -> tuple[Pinhole, float | None]:
    """Return the camera, and the calibration's reprojection error if it was calibrated here."""
    if given.camera is not None:
        return Pinhole.from_settings(read_opencv_intrinsics(given.camera)), None
    if given.board is None:
        raise DataError("--camera: without a checkerboard (--board) the camera's intrinsics must be given")
    if len(frames) < _LEAST_CALIBRATION:
        raise DataError(
            f"{len(frames)} images of the board: a calibration needs {_LEAST_CALIBRATION}; give --camera instead"
        )
    columns, rows = given.board
    plane = np.zeros((columns * rows, 3), dtype=np.float32)
    plane[:, :2] = np.mgrid[0:columns, 0:rows].T.reshape(-1, 2)
    height, width = next(images.frames()).shape[:2]
    pixels = [frame.pixels.astype(np.float32) for _, frame in frames]
    start: Any = None
    rms, k, bend, _, _ = cv2.calibrateCamera([plane] * len(frames), pixels, (width, height), start, start)
    intrinsics = Intrinsics(
        width_px=width,
        height_px=height,
        fx_px=float(k[0, 0]),
        fy_px=float(k[1, 1]),
        cx_px=float(k[0, 2]),
        cy_px=float(k[1, 2]),
        distortion=tuple(float(x) for x in np.ravel(bend)),
    )
    return Pinhole.from_settings(intrinsics), float(rms)


def _odometry(path: Path, frames: list[tuple[int, TrackedFrame]], images: ImageSequence) -> list[Pose]:
    """Odometry's poses at the images: row by row for a folder, interpolated in time for a video."""
    t, p, q = read_tum(path)
    if images.images:
        if len(t) != len(images.images):
            raise DataError(
                f"{path}: {len(t)} poses for {len(images.images)} images; a pose an image was expected"
            )
        return [Pose(p[k], q[k]) for k, _ in frames]
    out = []
    for _, frame in frames:
        if not t[0] - 1e-6 <= frame.t_s <= t[-1] + 1e-6:
            raise DataError(
                f"{path}: poses from {t[0]:g} to {t[-1]:g} s; an image was taken at {frame.t_s:g} s"
            )
        k = int(np.clip(np.searchsorted(t, frame.t_s) - 1, 0, max(len(t) - 2, 0)))
        share = (frame.t_s - t[k]) / (t[k + 1] - t[k]) if len(t) > 1 else 0.0
        after = min(k + 1, len(t) - 1)
        out.append(Pose(p[k] + share * (p[after] - p[k]), slerp(q[k], q[after], np.array(share))))
    return out


def _write_video(
    path: Path,
    images: ImageSequence,
    frames: list[tuple[int, TrackedFrame]],
    result: Reconstruction,
    camera: Pinhole,
) -> None:
    """Key images with their features, near ones red and far ones blue, and where the points project to."""
    wanted = {number: k for k, (number, _) in enumerate(frames)}
    depths = np.concatenate(
        [((result.points - result.p[k]) @ to_matrix(result.q[k]))[:, 2] for k in range(len(frames))]
    )
    low, high = np.percentile(depths, [5.0, 95.0])
    with video_file(path, images.rate_hz or _FOLDER_HZ) as add:
        for number, image in enumerate(images.frames()):
            if number not in wanted:
                continue
            k = wanted[number]
            picture = image[: image.shape[0] // 2 * 2, : image.shape[1] // 2 * 2].copy()
            frame = frames[k][1]
            projected = camera.project_world(result.points, result.p[k], result.q[k])
            z = ((result.points - result.p[k]) @ to_matrix(result.q[k]))[:, 2]
            for i, (u, v), depth in zip(result.ids.tolist(), projected.tolist(), z.tolist(), strict=True):
                if i not in frame.ids or not np.isfinite(u + v):
                    continue
                share = float(np.clip((depth - low) / max(high - low, 1e-9), 0.0, 1.0))
                colour = (round(255 * share), 60, round(255 * (1.0 - share)))
                cv2.circle(picture, (round(u), round(v)), 4, colour, 1, cv2.LINE_AA)
            for u, v in frame.pixels.tolist():
                cv2.circle(picture, (round(u), round(v)), 1, (255, 255, 255), -1)
            add(np.asarray(picture[:, :, ::-1], dtype=np.uint8))


def print_table(result: dict[str, Any]) -> None:
    """Print what was found."""
    lines = [
        f"{result['points']} points from {result['images']} images; reprojection {result['reprojection_px']:.2f} px"
    ]
    if result["metric"]:
        lines.append(
            f"odometry against images: chi2 {result['odometry_chi2']:.1f}, limit {result['odometry_chi2_limit']:.1f}"
        )
    else:
        lines.append("no odometry: the size is arbitrary (the path's extent is 1)")
    if result["scale"] is not None:
        low, high = result["scale"]["true_over_found_ci95"]
        lines.append(
            f"path {result['path_m']:.3f} m; true size over size found: 95 % in [{low:.3f}, {high:.3f}]"
        )
    if not result["consistent"]:
        lines.append(
            "NOT CONSISTENT: images and odometry (or images and a rigid scene) do not fit each other"
        )
    sys.stdout.write("\n".join(lines) + "\n")
