"""Options about files of surveyed cameras, and reading them: any format of ``camnet.importers.cameras``."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from camnet.cli.inputs import image_size

__all__ = ["CAMERA_OPTIONS", "add_camera_files", "add_cameras", "surveyed_cameras"]

#: options that only files of surveyed cameras use, by their names in the parsed arguments
CAMERA_OPTIONS = ("image", "camera_unit", "camera_poses")
#: size of images where neither the file nor the user states one, px
_ASSUMED_PX = (1920, 1080)


def add_cameras(group: Any) -> None:  # noqa: ANN401 - argparse publishes no type for it
    """Add ``--cameras``."""
    group.add_argument(
        "--cameras",
        metavar="PATH",
        type=Path,
        help="camera files (KRTD, OpenCV, ROS, Kalibr, KITTI, COLMAP): a folder, a file, a quoted pattern; with "
        "--roads a .csv or .add.xml",
    )


def add_camera_files(group: Any) -> None:  # noqa: ANN401 - argparse publishes no type for it
    """Add what camera files leave open."""
    group.add_argument(
        "--image",
        metavar="WxH",
        help="size of the cameras' images, px, for files that do not state it (KRTD, KITTI; default: 1920x1080)",
    )
    group.add_argument(
        "--camera-unit",
        choices=("m", "cm", "mm"),
        help="unit of the camera files' lengths (default: m, refused where it cannot be)",
    )
    group.add_argument(
        "--camera-poses",
        metavar="FILE",
        type=Path,
        help="poses for camera files without (ROS) or relative to a camera (Kalibr): a table "
        "name,x,y,z,pan,tilt (or qw,qx,qy,qz), or a camera file with poses",
    )


def surveyed_cameras(args: argparse.Namespace) -> Any:  # noqa: ANN401 - imported late
    """Read ``--cameras`` as surveyed cameras."""
    from camnet.importers.cameras import CameraOptions, read_cameras

    size = None if args.image is None else image_size(args.image)
    return read_cameras(args.cameras, CameraOptions(size, _ASSUMED_PX, args.camera_unit, args.camera_poses))
