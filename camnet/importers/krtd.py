"""KRTD camera models: an ASCII file of K, R, T and D with ``x_cam = R x_world + T``.

| symbol | name | shape | unit |
| --- | --- | --- | --- |
| K | upper triangular intrinsic matrix | 3x3 | px |
| R | rotation, world to camera | 3x3 | |
| T | translation, ``-R p_world`` | 3 | m |
| D | distortion in OpenCV's order (k1, k2, p1, p2, k3, ...) | any up to 14 | |

The image size is not in the file and has to be given.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from camnet.errors import DataError
from camnet.importers._reading import number, text_lines
from camnet.importers.surveyed_camera import (
    CameraRecord,
    SurveyedCamera,
    camera_of,
    intrinsics_of,
    rotation_of,
)

__all__ = ["read_krtd", "read_krtd_folder", "read_krtd_record"]

Row = tuple[int, list[float]]


def read_krtd(path: str | Path, width_px: int, height_px: int) -> SurveyedCamera:
    """Read one KRTD file as a camera in metres; see `read_krtd_record`."""
    record = read_krtd_record(path, width_px, height_px)
    assert record.rotation is not None
    assert record.translation is not None
    return camera_of(record.name, record.intrinsics, record.rotation, record.translation)


def read_krtd_record(path: str | Path, width_px: int, height_px: int) -> CameraRecord:
    """Read one KRTD file.

    Parameters
    ----------
    path : the file
    width_px, height_px : size of the images that K describes

    Raises
    ------
    DataError
        A number is missing or not finite, K is not a pinhole matrix without skew, the principal point is outside
        the image, or R is not a rotation.
    """
    path = Path(path)
    rows = _number_rows(path)
    k, k_line, rows = _take(path, rows, 9, "K (3 rows of 3 numbers)")
    r, r_line, rows = _take(path, rows, 9, "R (3 rows of 3 numbers)")
    t, _, rows = _take(path, rows, 3, "T (3 numbers)")
    distortion = [value for _, row in rows for value in row]
    rotation = rotation_of(f"{path}, line {r_line}", np.reshape(r, (3, 3)))
    intrinsics = intrinsics_of(
        f"{path}, line {k_line}", np.reshape(k, (3, 3)), distortion, width_px, height_px
    )
    return CameraRecord(path.stem, intrinsics, rotation, np.asarray(t))


def read_krtd_folder(folder: str | Path, width_px: int, height_px: int) -> tuple[SurveyedCamera, ...]:
    """Read every ``*.krtd`` file of a folder, in the order of their names."""
    folder = Path(folder)
    if not folder.is_dir():
        raise DataError(f"{folder}: no such folder of camera files")
    paths = sorted(folder.glob("*.krtd"))
    if not paths:
        raise DataError(f"{folder}: holds no *.krtd camera file")
    return tuple(read_krtd(path, width_px, height_px) for path in paths)


def _number_rows(path: Path) -> list[Row]:
    rows = []
    for line, text in text_lines(path):
        tokens = text.partition("#")[0].split()
        if tokens:
            rows.append((line, [number(token, f"{path}, line {line}", "a matrix entry") for token in tokens]))
    if not rows:
        raise DataError(f"{path}: is empty; a KRTD file holds K, R, T and D")
    return rows


def _take(path: Path, rows: list[Row], count: int, what: str) -> tuple[list[float], int, list[Row]]:
    """Take whole rows until ``count`` numbers are had."""
    values: list[float] = []
    first = rows[0][0] if rows else 0
    for used, (line, row) in enumerate(rows):
        if len(values) + len(row) > count or (count == 9 and len(row) != 3):
            raise DataError(f"{path}, line {line}: {len(row)} numbers {row} where {what} was expected")
        values += row
        if len(values) == count:
            return values, first, rows[used + 1 :]
    raise DataError(f"{path}: ends after {len(values)} numbers of {what}; {count} were expected")
