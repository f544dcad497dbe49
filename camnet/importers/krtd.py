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

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from camnet.errors import DataError
from camnet.geometry.rotations import from_matrix
from camnet.geometry.settings import FixedPose, Intrinsics
from camnet.importers._reading import number, text_lines
from camnet.types import Array

__all__ = ["KrtdCamera", "read_krtd", "read_krtd_folder"]

_ORTHONORMAL_TOLERANCE = 1e-3
_OPENCV_LENGTHS = (0, 4, 5, 8, 12, 14)  # the numbers of distortion coefficients that OpenCV accepts

#: widest view: image size over focal length (170 degrees); lens models end before
_WIDEST = 2.0 * math.tan(math.radians(85.0))

#: how far the principal point may be from the image's middle, as a share of its size
_OFF_CENTRE = 0.35

Row = tuple[int, list[float]]


@dataclass(frozen=True, eq=False, slots=True)
class KrtdCamera:
    """One camera of a KRTD file.

    Attributes
    ----------
    name : the file's stem
    intrinsics : pinhole model and distortion
    p_world : (3,) optical centre, m
    q_world : (4,) camera frame to world, scalar first, q0 not negative
    """

    name: str
    intrinsics: Intrinsics
    p_world: Array
    q_world: Array

    def fixed_pose(self) -> FixedPose:
        """Return the pose as a world file states it."""
        x, y, z = self.p_world.tolist()
        a, b, c, d = self.q_world.tolist()
        return FixedPose(position_m=(x, y, z), quaternion_wxyz=(a, b, c, d))


def read_krtd(path: str | Path, width_px: int, height_px: int) -> KrtdCamera:
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
    rotation = _rotation(f"{path}, line {r_line}", np.reshape(r, (3, 3)))
    intrinsics = _intrinsics(f"{path}, line {k_line}", np.reshape(k, (3, 3)), distortion, width_px, height_px)
    q_world = from_matrix(rotation.T)
    p_world = -rotation.T @ np.asarray(t)
    p_world.setflags(write=False)
    q_world.setflags(write=False)
    return KrtdCamera(path.stem, intrinsics, p_world, q_world)


def read_krtd_folder(folder: str | Path, width_px: int, height_px: int) -> tuple[KrtdCamera, ...]:
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


def _rotation(where: str, r: Array) -> Array:
    """Check that R is a rotation to the file's precision and return the nearest exact one."""
    gap = float(np.max(np.abs(r @ r.T - np.eye(3))))
    if gap > _ORTHONORMAL_TOLERANCE:
        raise DataError(
            f"{where}: R is not orthonormal, R R^T differs from the identity by {gap:.3g}; "
            f"at most {_ORTHONORMAL_TOLERANCE:g} is allowed"
        )
    if np.linalg.det(r) < 0:
        raise DataError(f"{where}: R has determinant {np.linalg.det(r):.3f}, a reflection; +1 was expected")
    u, _, vt = np.linalg.svd(r)
    return np.asarray(u @ vt)


def _degrees(focal: float, size: float) -> float:
    return 2.0 * math.degrees(math.atan(0.5 * size / focal))


def _intrinsics(where: str, k: Array, distortion: list[float], width_px: int, height_px: int) -> Intrinsics:
    if width_px <= 0 or height_px <= 0:
        raise DataError(
            f"{where}: the image size given is {width_px} x {height_px} px; both must be positive"
        )
    if k[2].tolist() != [0, 0, 1] or k[1, 0] != 0:
        raise DataError(f"{where}: K is {k.tolist()}; an upper triangle with last row 0 0 1 was expected")
    if k[0, 1] != 0:
        raise DataError(f"{where}: K has skew {k[0, 1]:g}; only cameras without skew (0) are supported")
    for name, value, size in (("fx", k[0, 0], width_px), ("fy", k[1, 1], height_px)):
        if value <= 0:
            raise DataError(f"{where}: {name} is {value:g}; a positive focal length in pixels was expected")
        if value < size / _WIDEST:
            raise DataError(
                f"{where}: {name} is {value:g}, a view of {_degrees(value, size):.1f} degrees across {size} px; a "
                f"focal length in pixels, for less than {_degrees(1.0, _WIDEST):.0f} degrees, was expected"
            )
    for name, value, size in (("cx", k[0, 2], width_px), ("cy", k[1, 2], height_px)):
        if not 0 < value < size:
            raise DataError(f"{where}: {name} is {value:g}; the image ends at {size} px: is its size right?")
        if abs(value / size - 0.5) > _OFF_CENTRE:
            raise DataError(
                f"{where}: {name} is {value:g}, far from the middle of {size} px: are width and height right?"
            )
    if len(distortion) > _OPENCV_LENGTHS[-1]:
        raise DataError(f"{where}: D has {len(distortion)} numbers; OpenCV's models have at most 14")
    length = next(n for n in _OPENCV_LENGTHS if n >= len(distortion))
    padded = (*distortion, *([0.0] * (length - len(distortion))))
    return Intrinsics(
        width_px=width_px,
        height_px=height_px,
        fx_px=float(k[0, 0]),
        fy_px=float(k[1, 1]),
        cx_px=float(k[0, 2]),
        cy_px=float(k[1, 2]),
        distortion=padded if any(padded) else (),
    )
