"""Cameras from ROS's camera_info files (YAML): intrinsics and distortion; the format has no pose."""

from __future__ import annotations

from pathlib import Path

from camnet.errors import DataError
from camnet.importers._fields import yaml_content
from camnet.importers.surveyed_camera import CameraRecord, intrinsics_of

__all__ = ["read_ros_camera"]

#: numbers of coefficients of the models that OpenCV's formulas cover
_MODELS = {"plumb_bob": (4, 5), "rational_polynomial": (8,)}


def read_ros_camera(path: Path) -> CameraRecord:
    """Read one camera; ``camera_name`` names it, else the file's stem.

    Raises
    ------
    DataError
        A field is missing or has another number of values, the distortion is of a fisheye lens, the image is binned,
        or the numbers are no camera.
    """
    fields = yaml_content(path)
    width, height = (fields.whole(name, 1, 20_000) for name in ("image_width", "image_height"))
    k = fields.child("camera_matrix").matrix("data", 3, 3)
    model = fields.text("distortion_model")
    if model not in _MODELS:
        raise DataError(f"{fields.at('distortion_model')}: is {model!r}; {' or '.join(_MODELS)} was expected")
    bend = fields.child("distortion_coefficients").numbers("data", _MODELS[model])
    for name in ("binning_x", "binning_y"):
        if name in fields and fields.whole(name, 0, 64) > 1:
            raise DataError(
                f"{fields.at(name)}: is {fields.text(name)}; files of binned images are not supported"
            )
    name = fields.text("camera_name") if "camera_name" in fields else path.stem
    return CameraRecord(name, intrinsics_of(fields.at("camera_matrix"), k, bend, width, height))
