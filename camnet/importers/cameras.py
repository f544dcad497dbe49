"""Camera files of any format that is read here: `read_cameras` finds the format by suffix and content.

A new format is a file with a reader that returns `CameraRecord`, and a row of ``CAMERA_FORMATS``.
"""

from __future__ import annotations

import glob
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from camnet.errors import DataError
from camnet.importers._reading import open_binary
from camnet.importers.camera_poses import read_camera_poses
from camnet.importers.colmap_cameras import read_colmap_cameras
from camnet.importers.kalibr_cameras import read_kalibr_cameras
from camnet.importers.kitti_cameras import read_kitti_cameras
from camnet.importers.krtd import read_krtd_record
from camnet.importers.opencv_camera import read_opencv_camera
from camnet.importers.placement import place_cameras
from camnet.importers.ros_camera import read_ros_camera
from camnet.importers.surveyed_camera import CameraRecord, SurveyedCamera
from camnet.types import Array

__all__ = [
    "CAMERA_FORMATS",
    "CameraFormat",
    "CameraOptions",
    "camera_format_of",
    "camera_records",
    "read_cameras",
]

#: what of a file is looked at to tell its format, bytes
_HEAD = 4096

Size = tuple[int, int]
Source = str | Path | Sequence[Path]


@dataclass(frozen=True)
class CameraOptions:
    """What camera files leave open.

    Attributes
    ----------
    image_px : width and height of the images; formats that state the size must state this one
    assumed_px : in its place for formats that do not hold the size; None: those are refused
    unit : of lengths in the files: ``m``, ``cm``, ``mm``; None: metres, refused where they cannot be
    poses : CSV table of poses, or a camera file that holds poses, for formats without or with relative ones
    """

    image_px: Size | None = None
    assumed_px: Size | None = None
    unit: str | None = None
    poses: Path | None = None


@dataclass(frozen=True)
class CameraFormat:
    """A format of camera files.

    Attributes
    ----------
    name : for people
    suffixes : of its files; empty: a folder
    marks : one of these bytes is in the first part of a file; empty: the suffix is enough
    read : records of a file; the size of images is given for formats that lack it
    sized : the file states the size of its images
    poses : in the world, relative to a camera of the file (``rig``), or not there
    """

    name: str
    suffixes: tuple[str, ...]
    marks: tuple[bytes, ...]
    read: Callable[[Path, Size], tuple[CameraRecord, ...]]
    sized: bool
    poses: Literal["world", "rig", "none"]


CAMERA_FORMATS: tuple[CameraFormat, ...] = (
    CameraFormat("KRTD", (".krtd",), (), lambda path, size: (read_krtd_record(path, *size),), False, "world"),
    CameraFormat(
        "OpenCV", (".yaml", ".yml", ".xml"), (b"opencv-matrix", b"opencv_storage"),
        lambda path, _: (read_opencv_camera(path),), True, "world",
    ),
    CameraFormat(
        "Kalibr", (".yaml", ".yml"), (b"distortion_coeffs",), lambda path, _: read_kalibr_cameras(path), True, "rig"
    ),
    CameraFormat(
        "ROS camera_info", (".yaml", ".yml"), (b"camera_matrix", b"distortion_model"),
        lambda path, _: (read_ros_camera(path),), True, "none",
    ),
    CameraFormat(
        "KITTI", (".txt",), (b"P0:", b"P1:", b"P2:"),
        lambda path, size: read_kitti_cameras(path, *size), False, "world",
    ),
    CameraFormat("COLMAP", (), (), lambda path, _: read_colmap_cameras(path), True, "world"),
)  # fmt: skip
_COLMAP = CAMERA_FORMATS[-1]
_SUFFIXES = tuple(dict.fromkeys(suffix for one in CAMERA_FORMATS for suffix in one.suffixes))


def camera_format_of(path: Path) -> CameraFormat:
    """Return the format of a camera file.

    Raises
    ------
    DataError
        The file cannot be read, or is of no format that is known here.
    """
    rows = [one for one in CAMERA_FORMATS if path.suffix.lower() in one.suffixes]
    if rows and not rows[0].marks:
        return rows[0]
    with open_binary(path) as stream:
        head = stream.read(_HEAD)
    for one in rows:
        if any(mark in head for mark in one.marks):
            return one
    known = ", ".join(f"{one.name} ({' '.join(one.suffixes) or 'folder'})" for one in CAMERA_FORMATS)
    raise DataError(f"{path}: is no camera file that is known here: {known}")


def read_cameras(path: Source, options: CameraOptions | None = None) -> tuple[SurveyedCamera, ...]:
    """Read the cameras of a file, of a folder of them, of a COLMAP model, or of a pattern such as ``cams/*.yaml``.

    Parameters
    ----------
    path : file, folder or pattern, or several files
    options : what the files leave open

    Raises
    ------
    DataError
        Whatever is wrong with a file, with its field and value; files of different kinds of poses together; or no
        camera file at all.
    """
    given = options or CameraOptions()
    found = [
        (one, record)
        for one, records in camera_records(path, given.image_px, given.assumed_px)
        for record in records
    ]
    kinds = {one.poses for one, _ in found}
    if "rig" in kinds and len({one.name for one, _ in found}) > 1:
        raise DataError(f"{path}: holds poses relative to a camera beside others; read such files alone")
    poses = None if given.poses is None else _poses(given.poses, given)
    rig = "rig" in kinds or (poses is not None and all(one.name == "KITTI" for one, _ in found))
    where = str(path) if isinstance(path, str | Path) else f"{path[0].parent}"
    return place_cameras([record for _, record in found], where, given.unit, poses, rig)


def _poses(path: Path, options: CameraOptions) -> dict[str, tuple[Array, Array]]:
    if path.name.lower().endswith((".csv", ".csv.gz")):
        return read_camera_poses(path)
    cameras = read_cameras(path, CameraOptions(options.image_px, options.assumed_px, options.unit))
    return {camera.name: (camera.p_world, camera.cam_from_world()[0].T) for camera in cameras}


def camera_records(
    path: Source, image_px: Size | None, assumed_px: Size | None = None
) -> list[tuple[CameraFormat, tuple[CameraRecord, ...]]]:
    """Read what camera files state, before cameras are placed; see `read_cameras`."""
    out = []
    for file in _files(path):
        one = _COLMAP if file.is_dir() else camera_format_of(file)
        size_px = image_px or assumed_px
        if not one.sized and size_px is None:
            raise DataError(f"{file}: a {one.name} file does not state the size of its images; give it")
        records = one.read(file, size_px or (0, 0))
        if one.sized and image_px is not None:
            _same_size(records, image_px, file)
        out.append((one, records))
    return out


def _same_size(records: Sequence[CameraRecord], image_px: Size, file: Path) -> None:
    for record in records:
        size = record.intrinsics.width_px, record.intrinsics.height_px
        if size != image_px:
            raise DataError(
                f"{file}: camera {record.name!r} has images of {size[0]} x {size[1]} px, not {image_px[0]} x "
                f"{image_px[1]} as given; leave the size out, the file states it"
            )


def _files(path: Source) -> Sequence[Path]:
    """Return the camera files that a path means; a COLMAP model is its folder."""
    if not isinstance(path, str | Path):
        return path
    text, place = str(path), Path(path)
    if any(c in text for c in "*?[") and not place.exists():
        found = sorted(Path(name) for name in glob.glob(text))
        if not found:
            raise DataError(f"{path}: no file matches this pattern")
        return found
    if place.is_dir():
        if (
            (place / "images.txt").exists()
            or (place / "cameras.txt").exists()
            or (place / "cameras.bin").exists()
        ):
            return [place]
        found = sorted(file for file in place.iterdir() if file.suffix.lower() in _SUFFIXES)
        if not found:
            raise DataError(f"{path}: holds no camera file (*{', *'.join(_SUFFIXES)}, or a COLMAP model)")
        return found
    if not place.exists():
        raise DataError(f"{path}: no such file or folder of camera files")
    return [place]
