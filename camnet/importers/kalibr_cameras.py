"""Cameras from Kalibr's camera chains (YAML): ``cam0``, ``cam1``, ... each posed relative to the one before.

``T_cn_cnm1`` (4, 4) takes points of the camera before to this one; ``cam0`` is the frame of the rig, so the poses
returned are ``x_cam = R x_cam0 + T``.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from camnet.errors import DataError
from camnet.importers._fields import Fields, yaml_content
from camnet.importers.surveyed_camera import CameraRecord, intrinsics_of, rotation_of
from camnet.types import Array

__all__ = ["read_kalibr_cameras"]


def read_kalibr_cameras(path: Path) -> tuple[CameraRecord, ...]:
    """Read a camera chain; a camera is named by the first part of its ROS topic, else ``cam0``, ``cam1``, ...

    Raises
    ------
    DataError
        A camera is missing in the row, a field is missing or has another number of values, the lens model is not
        pinhole with ``radtan`` distortion, or a transformation is not rigid.
    """
    fields = yaml_content(path)
    keys = [f"cam{k}" for k in range(len(fields.content))]
    if not keys or set(keys) != set(fields.content):
        raise DataError(
            f"{path}: has the fields {', '.join(fields.content) or 'none'}; cam0, cam1, ... were expected"
        )
    out: list[CameraRecord] = []
    pose = np.eye(4)
    for k, key in enumerate(keys):
        one = fields.child(key)
        if k > 0:
            pose = _rigid(one) @ pose
        name = _name(one, key)
        if name in {record.name for record in out}:
            raise DataError(f"{one.at('rostopic')}: the camera name {name!r} is there twice")
        out.append(_record(one, name, pose))
    return tuple(out)


def _record(one: Fields, name: str, pose: Array) -> CameraRecord:
    for field, expected in (("camera_model", "pinhole"), ("distortion_model", "radtan")):
        if one.text(field) != expected:
            raise DataError(f"{one.at(field)}: is {one.text(field)!r}; only {expected!r} is supported")
    fx, fy, cx, cy = one.numbers("intrinsics", (4,))
    width, height = one.numbers("resolution", (2,))
    if width != int(width) or height != int(height):
        raise DataError(f"{one.at('resolution')}: is {width:g}, {height:g}; whole pixels were expected")
    k = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    bend = one.numbers("distortion_coeffs", (4,))
    model = intrinsics_of(one.at("intrinsics"), k, bend, int(width), int(height))
    return CameraRecord(name, model, pose[:3, :3], pose[:3, 3])


def _rigid(one: Fields) -> Array:
    pose = one.matrix("T_cn_cnm1", 4, 4)
    if pose[3].tolist() != [0.0, 0.0, 0.0, 1.0]:
        raise DataError(f"{one.at('T_cn_cnm1')}: its last row is {pose[3].tolist()}; 0 0 0 1 was expected")
    pose[:3, :3] = rotation_of(one.at("T_cn_cnm1"), pose[:3, :3])
    return pose


def _name(one: Fields, key: str) -> str:
    topic = one.text("rostopic") if "rostopic" in one else ""
    return next((part for part in topic.split("/") if part), key)
