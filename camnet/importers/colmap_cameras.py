"""Cameras from COLMAP's text model: ``cameras.txt`` (lenses) and ``images.txt`` (poses, world to camera, qw first).

Every image is one camera, named by the stem of its file. COLMAP's unit of length is free: scale the model to metres
before.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from camnet.errors import DataError
from camnet.geometry.rotations import to_matrix
from camnet.geometry.settings import Intrinsics
from camnet.importers._reading import number, quoted, text_lines
from camnet.importers.surveyed_camera import CameraRecord, intrinsics_of
from camnet.numerals import read_whole

__all__ = ["read_colmap_cameras"]

#: parameters by lens model: places of fx, fy, cx, cy, then of the coefficients in OpenCV's order; -1 is 0
_MODELS: dict[str, tuple[int, tuple[int, ...], tuple[int, ...]]] = {
    "SIMPLE_PINHOLE": (3, (0, 0, 1, 2), ()),
    "PINHOLE": (4, (0, 1, 2, 3), ()),
    "SIMPLE_RADIAL": (4, (0, 0, 1, 2), (3, -1, -1, -1)),
    "RADIAL": (5, (0, 0, 1, 2), (3, 4, -1, -1)),
    "OPENCV": (8, (0, 1, 2, 3), (4, 5, 6, 7)),
    "FULL_OPENCV": (12, (0, 1, 2, 3), (4, 5, 6, 7, 8, 9, 10, 11)),
}
_UNIT_TOLERANCE = 1e-3


def read_colmap_cameras(folder: Path) -> tuple[CameraRecord, ...]:
    """Read ``cameras.txt`` and ``images.txt`` of a folder.

    Raises
    ------
    DataError
        A file is missing or binary, a row has another number of values, the lens model is unknown or a fisheye, a
        quaternion is not of unit length, an image names no camera, or a name is there twice.
    """
    lenses = _lenses(folder / "cameras.txt")
    path, found = folder / "images.txt", {}
    # each image has two lines; the second lists points and may be empty
    for line, text in _image_lines(path):
        where = f"{path}, line {line}"
        parts = text.split(maxsplit=9)
        if len(parts) != 10:
            raise DataError(
                f"{where}: {len(parts)} values; IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME expected"
            )
        names = ("QW", "QX", "QY", "QZ", "TX", "TY", "TZ")
        values = [number(part, where, field) for part, field in zip(parts[1:8], names, strict=True)]
        q = np.array(values[:4])
        if abs(np.linalg.norm(q) - 1.0) > _UNIT_TOLERANCE:
            raise DataError(f"{where}: QW QX QY QZ has length {np.linalg.norm(q):.4g}; length 1 was expected")
        if parts[8] not in lenses:
            raise DataError(f"{where}: CAMERA_ID is {quoted(parts[8])}, which cameras.txt does not have")
        name = Path(parts[9].strip()).stem
        if not name or name in found:
            raise DataError(
                f"{where}: NAME is {quoted(parts[9])}; a name that no other image has was expected"
            )
        rotation = to_matrix(q / np.linalg.norm(q))
        found[name] = CameraRecord(name, lenses[parts[8]], rotation, np.array(values[4:]))
    if not found:
        raise DataError(f"{path}: holds no image")
    return tuple(found.values())


def _image_lines(path: Path) -> list[tuple[int, str]]:
    lines = [(n, text) for n, text in text_lines(path) if not text.lstrip().startswith("#")]
    while lines and not lines[0][1].strip():
        del lines[0]
    return [row for row in lines[::2] if row[1].strip()]


def _lenses(path: Path) -> dict[str, Intrinsics]:
    if not path.exists() and path.with_suffix(".bin").exists():
        raise DataError(f"{path}: is missing; COLMAP's binary model was found: export it as text")
    found: dict[str, Intrinsics] = {}
    for line, text in text_lines(path):
        parts = text.split()
        if not parts or parts[0].startswith("#"):
            continue
        where = f"{path}, line {line}"
        if len(parts) < 4:
            raise DataError(
                f"{where}: {len(parts)} values; CAMERA_ID MODEL WIDTH HEIGHT PARAMS were expected"
            )
        if parts[0] in found:
            raise DataError(f"{where}: CAMERA_ID {parts[0]} is there twice")
        found[parts[0]] = _lens(parts, where)
    if not found:
        raise DataError(f"{path}: holds no camera")
    return found


def _lens(parts: list[str], where: str) -> Intrinsics:
    if parts[1] not in _MODELS:
        raise DataError(f"{where}: MODEL is {quoted(parts[1])}; one of {', '.join(_MODELS)} was expected")
    count, places, bends = _MODELS[parts[1]]
    size = []
    for field, text in zip(("WIDTH", "HEIGHT"), parts[2:4], strict=True):
        try:
            size.append(read_whole(text, 1, 20_000))
        except ValueError as error:
            raise DataError(f"{where}: {field} is {quoted(text)}; {error}") from None
    values = [number(text, where, "PARAMS") for text in parts[4:]]
    if len(values) != count:
        raise DataError(f"{where}: PARAMS has {len(values)} numbers; {parts[1]} has {count}")
    fx, fy, cx, cy = (values[k] for k in places)
    k = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    return intrinsics_of(where, k, [0.0 if b < 0 else values[b] for b in bends], size[0], size[1])
