"""Intrinsics from OpenCV's calibration files, YAML or XML: matrix, distortion coefficients, image size."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from pydantic import ValidationError

from camnet.errors import DataError
from camnet.geometry.settings import Intrinsics

__all__ = ["read_opencv_intrinsics"]


def read_opencv_intrinsics(path: Path) -> Intrinsics:
    """Read the intrinsics of a file.

    Raises
    ------
    DataError
        No such file, no such entries, or numbers that are no camera.
    """
    if not path.is_file():
        raise DataError(f"{path}: no such file; a camera file of OpenCV (YAML or XML) was expected")
    try:
        storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    except (cv2.error, SystemError) as error:
        raise DataError(f"{path}: cannot be read as a camera file of OpenCV (YAML or XML)") from error
    try:
        matrix = storage.getNode("camera_matrix").mat()
        distortion = storage.getNode("distortion_coefficients").mat()
        size = [storage.getNode(name).real() for name in ("image_width", "image_height")]
    finally:
        storage.release()
    if np.shape(matrix) != (3, 3):
        raise DataError(f"{path}: camera_matrix: a 3 x 3 matrix was expected")
    k = np.asarray(matrix, dtype=np.float64)
    bend = () if distortion is None else tuple(float(x) for x in np.ravel(distortion))
    try:
        return Intrinsics(
            width_px=int(size[0]),
            height_px=int(size[1]),
            fx_px=float(k[0, 0]),
            fy_px=float(k[1, 1]),
            cx_px=float(k[0, 2]),
            cy_px=float(k[1, 2]),
            distortion=bend,
        )
    except ValidationError as error:
        first = error.errors()[0]
        raise DataError(f"{path}: {first['loc'][0]}: {first['input']!r}; {first['msg']}") from None
