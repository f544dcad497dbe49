"""Cameras from KITTI's ``calib.txt``: projection matrices ``P = s K [R t]`` (3, 4) of images without distortion.

K, R and t follow by an RQ decomposition with a positive diagonal of K; the size of the images is not in the file.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy import linalg

from camnet.errors import DataError
from camnet.importers._reading import number, text_lines
from camnet.importers.surveyed_camera import CameraRecord, intrinsics_of
from camnet.types import Array

__all__ = ["read_kitti_cameras"]

#: skew over focal length that rounding of the file explains
_SKEW = 1e-6


def read_kitti_cameras(path: Path, width_px: int, height_px: int) -> tuple[CameraRecord, ...]:
    """Read the cameras ``P0``, ``P1``, ... of a file; other rows (``Tr``, ``R0_rect``) are left aside.

    Raises
    ------
    DataError
        A row has no name or not twelve numbers, a name is there twice, a matrix is no camera, or none is there.
    """
    found: dict[str, CameraRecord] = {}
    for line, text in text_lines(path):
        if not text.strip():
            continue
        where = f"{path}, line {line}"
        name, colon, rest = text.partition(":")
        name = name.strip()
        if not colon:
            raise DataError(f"{where}: has no name and colon such as 'P0:'")
        if not (name.startswith("P") and name[1:].isdigit()):
            continue
        if name in found:
            raise DataError(f"{where}: {name} is there twice")
        values = [number(part, where, name) for part in rest.split()]
        if len(values) != 12:
            raise DataError(f"{where}: {name} has {len(values)} numbers; 12 were expected")
        found[name] = _record(f"{where}: {name}", name, np.reshape(values, (3, 4)), width_px, height_px)
    if not found:
        raise DataError(
            f"{path}: holds no projection matrix; rows such as 'P0: ' and 12 numbers were expected"
        )
    return tuple(found.values())


def _record(where: str, name: str, p: Array, width_px: int, height_px: int) -> CameraRecord:
    scale = float(np.linalg.norm(p[2, :3]))
    if not scale > 0.0 or abs(np.linalg.det(p[:, :3] / scale)) < 1e-9:
        raise DataError(f"{where}: its left 3 x 3 part is singular; K R of a camera was expected")
    p = p / scale
    if np.linalg.det(p[:, :3]) < 0:
        raise DataError(
            f"{where}: its left 3 x 3 part has a negative determinant, a reflection; K R was expected"
        )
    k, rotation = linalg.rq(p[:, :3])
    signs = np.diag(np.sign(np.diag(k)))
    k, rotation = k @ signs, signs @ rotation
    k = k / k[2, 2]
    if abs(k[0, 1]) > _SKEW * k[0, 0]:
        raise DataError(f"{where}: has skew {k[0, 1]:.3g}; only cameras without skew are supported")
    k[0, 1], k[1, 0], k[2] = 0.0, 0.0, (0.0, 0.0, 1.0)
    translation = np.linalg.solve(k, p[:, 3])
    return CameraRecord(name, intrinsics_of(where, k, (), width_px, height_px), rotation, translation)
