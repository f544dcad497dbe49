"""Cameras from OpenCV's files, YAML or XML: matrix, distortion, image size and, where written, rvec and tvec.

``x_cam = R x_world + tvec`` with R of the rotation vector ``rvec`` (or the matrix itself).
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from camnet.errors import DataError
from camnet.geometry.rotations import exp, to_matrix
from camnet.geometry.settings import Intrinsics
from camnet.importers._fields import Fields, yaml_content
from camnet.importers._reading import Place, parse_xml
from camnet.importers.surveyed_camera import CameraRecord, intrinsics_of, rotation_of
from camnet.types import Array

__all__ = ["read_opencv_camera", "read_opencv_intrinsics"]

_K = ("camera_matrix", "cameraMatrix", "Camera_Matrix", "K")
_D = ("distortion_coefficients", "Distortion_Coefficients", "distCoeffs", "dist_coeffs", "D")
_R = ("rvec", "rotation_vector", "rotation_matrix", "R")
_T = ("tvec", "translation_vector", "T")
_SIZE = (("image_width", "image_Width", "width"), ("image_height", "image_Height", "height"))
_LENGTHS = (4, 5, 8, 12, 14)
_WIDEST_PX = 20_000


def read_opencv_intrinsics(path: Path) -> Intrinsics:
    """Read the intrinsics of a file; see `read_opencv_camera`."""
    return read_opencv_camera(path).intrinsics


def read_opencv_camera(path: Path) -> CameraRecord:
    """Read one camera; the file's stem names it.

    Raises
    ------
    DataError
        No such file, no YAML or XML, a field is missing or is no matrix of its size, only one of rvec and tvec is
        there, or the numbers are no camera.
    """
    fields = _xml_fields(path) if path.suffix.lower() == ".xml" else yaml_content(path)
    k_name = _named(fields, _K)
    k = _matrix(fields, k_name, (9,)).reshape(3, 3)
    d_name = fields.one_of(_D)
    bend = [] if d_name is None else _matrix(fields, d_name, _LENGTHS).tolist()
    width, height = (fields.whole(_named(fields, names), 1, _WIDEST_PX) for names in _SIZE)
    model = intrinsics_of(fields.at(k_name), k, bend, width, height)
    r_name, t_name = fields.one_of(_R), fields.one_of(_T)
    if (r_name is None) != (t_name is None):
        missing = "tvec" if t_name is None else "rvec"
        raise DataError(f"{fields.at(missing)}: is missing; rotation and translation come together")
    if r_name is None or t_name is None:
        return CameraRecord(path.stem, model)
    turn = _matrix(fields, r_name, (3, 9))
    rotation = rotation_of(fields.at(r_name), turn.reshape(3, 3)) if turn.size == 9 else to_matrix(exp(turn))
    return CameraRecord(path.stem, model, rotation, _matrix(fields, t_name, (3,)))


def _named(fields: Fields, names: tuple[str, ...]) -> str:
    """Return the spelling that the file uses; the first one if it uses none."""
    return fields.one_of(names) or names[0]


def _matrix(fields: Fields, name: str, counts: tuple[int, ...]) -> Array:
    """Return the numbers of a matrix in OpenCV's form, or of a plain list, row by row."""
    if not isinstance(fields.need(name), dict):
        return np.array(fields.numbers(name, counts))
    matrix = fields.child(name)
    data = np.array(matrix.numbers("data", counts))
    rows, columns = (matrix.whole(key, 1, 100) for key in ("rows", "cols"))
    if rows * columns != data.size:
        raise DataError(f"{matrix.at('data')}: holds {data.size} numbers; {rows} x {columns} were expected")
    return data


def _xml_fields(path: Path) -> Fields:
    """Return an ``opencv_storage`` as fields: elements with elements inside are mappings, the others text."""
    stack: list[dict[str, Any]] = []
    top: dict[str, Any] = {}

    def start(name: str, _: dict[str, str], place: Place) -> None:
        if stack and name in stack[-1]:
            raise DataError(f"{place}: the field {name!r} is there twice")
        inner: dict[str, Any] = top if not stack else {}
        if stack:
            stack[-1][name] = inner
        stack.append(inner)

    def end(name: str, text: str, _: Place) -> None:
        inner = stack.pop()
        if stack and not inner:
            stack[-1][name] = text.split() if name == "data" else text

    parse_xml(path, "opencv_storage", start, end)
    return Fields(str(path), top)
