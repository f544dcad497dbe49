"""From camera files to cameras in the site's frame: the unit of length, poses given apart, and whether axes are right.

Files say nothing of their unit and seldom of their axes. Stated poses are therefore looked at: cameras that hang
hundreds of metres high, or that look at the sky upside down, are errors that name the likely cause.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from camnet.errors import DataError
from camnet.importers.surveyed_camera import CameraRecord, SurveyedCamera, placed_camera
from camnet.types import Array

__all__ = ["UNITS_M", "check_placement", "place_cameras"]

#: units of length of camera files, m
UNITS_M = {"m": 1.0, "cm": 0.01, "mm": 0.001}
#: higher above the plane z = 0 than this no camera of a site hangs unless the unit is stated, m
_HIGHEST_M = 150.0
#: farthest place in metres: projected coordinates of any zone on Earth are nearer
_FARTHEST_M = 2e7
#: sine of the elevation above which an optical axis looks at the sky
_SKY = 0.5
#: and from which it looks straight up
_ZENITH = 0.99

Pose = tuple[Array, Array]


def place_cameras(
    records: Sequence[CameraRecord],
    where: str,
    unit: str | None = None,
    poses: Mapping[str, Pose] | None = None,
    rig: bool = False,
) -> tuple[SurveyedCamera, ...]:
    """Return the cameras in the site's frame, checked.

    Parameters
    ----------
    records : as the files have them
    where : the file or folder, for messages
    unit : of the files' lengths, a key of ``UNITS_M``; None: metres, refused where they cannot be
    poses : by camera: centre (3,), m, and axes (3, 3), camera to world
    rig : the records' poses are relative to each other; ``poses`` places one of them, and with it all

    Raises
    ------
    DataError
        A camera has no pose, a pose names no camera, the unit is unknown or looks wrong, or the axes do.
    """
    if unit is not None and unit not in UNITS_M:
        raise DataError(f"unit {unit!r}: one of {', '.join(UNITS_M)} was expected")
    given = dict(poses or {})
    names = [record.name for record in records]
    if len(set(names)) < len(names):
        twice = next(n for n in names if names.count(n) > 1)
        raise DataError(
            f"{where}: camera {twice!r} is there twice; where files of several formats have it, give a pattern such as "
            "'*.yaml'"
        )
    strange = sorted(set(given) - set(names))
    if strange and not set(given) & set(names):
        raise DataError(f"{where}: no camera is called {strange[0]!r}; there are {', '.join(names[:12])}")
    scale = UNITS_M[unit or "m"]
    if rig:
        cameras = _rig(records, given, where, scale)
    else:
        cameras = tuple(_single(record, given.get(record.name), where, scale) for record in records)
    check_placement(cameras, where, unit)
    return cameras


def _centre(record: CameraRecord, scale: float) -> Pose:
    assert record.rotation is not None
    assert record.translation is not None
    return -record.rotation.T @ record.translation * scale, record.rotation.T


def _single(record: CameraRecord, pose: Pose | None, where: str, scale: float) -> SurveyedCamera:
    if pose is None:
        if record.rotation is None:
            raise DataError(
                f"{where}: camera {record.name!r} has no pose, and its format holds none; give it in a table of poses "
                "(name,x,y,z,pan,tilt)"
            )
        pose = _centre(record, scale)
    return placed_camera(record.name, record.intrinsics, *pose)


def _rig(
    records: Sequence[CameraRecord], given: Mapping[str, Pose], where: str, scale: float
) -> tuple[SurveyedCamera, ...]:
    """Place a rig by the first of its cameras whose pose is given."""
    anchor = next((record for record in records if record.name in given), None)
    if anchor is None:
        raise DataError(
            f"{where}: its poses are relative to the camera {records[0].name!r}; give that camera's own in a table of "
            "poses (name,x,y,z,pan,tilt)"
        )
    p_anchor, world_r_anchor = given[anchor.name]
    p_local, rig_r_anchor = _centre(anchor, scale)
    world_r_rig = world_r_anchor @ rig_r_anchor.T
    origin = p_anchor - world_r_rig @ p_local
    out = []
    for record in records:
        p, axes = _centre(record, scale)
        out.append(
            placed_camera(record.name, record.intrinsics, origin + world_r_rig @ p, world_r_rig @ axes)
        )
    return tuple(out)


def check_placement(cameras: Sequence[SurveyedCamera], where: str, unit: str | None) -> None:
    """Refuse cameras that cannot stand like this.

    Raises
    ------
    DataError
        A camera is farther away than any frame reaches, the cameras hang so high that another unit is likely (unless
        the unit is stated), all of them look straight up, or one looks at the sky upside down, as cameras with
        OpenGL's axes (y up, z back) do.
    """
    for camera in cameras:
        if not np.abs(camera.p_world).max() < _FARTHEST_M:
            raise DataError(
                f"{where}: camera {camera.name!r} is at {camera.p_world.tolist()}, beyond any site"
            )
    high = float(np.median([camera.p_world[2] for camera in cameras]))
    if unit is None and high > _HIGHEST_M:
        raise DataError(
            f"{where}: its cameras hang {high:.0f} m above z = 0: are these centimetres (or millimetres)? State the "
            f"unit, one of {', '.join(UNITS_M)}"
        )
    all_axes = [camera.cam_from_world()[0].T for camera in cameras]
    if all(axes[2, 2] > _ZENITH for axes in all_axes):
        raise DataError(
            f"{where}: its cameras look straight up: are the poses in the frame of a camera (z forward)? A world with "
            "z up was expected; place them with a table of poses (name,x,y,z,pan,tilt)"
        )
    for camera, axes in zip(cameras, all_axes, strict=True):
        if axes[2, 2] > _SKY and axes[2, 1] > 0.0:
            raise DataError(
                f"{where}: camera {camera.name!r} looks at the sky with its image upside down: are its axes OpenGL's "
                "(x right, y up, z back)? x right, y down, z forward was expected, in a world with z up"
            )
