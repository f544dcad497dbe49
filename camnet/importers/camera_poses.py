"""Poses of cameras from a CSV table, for camera files that state none, and the axes of a direction.

| column | what |
| --- | --- |
| name | the camera's |
| x, y, z | optical centre, m |
| pan, tilt, roll | optical axis: degrees counter-clockwise from x, degrees below the horizon; roll clockwise about it |
| qw, qx, qy, qz | in place of these: camera frame (x right, y down, z forward) to world |
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from camnet.errors import DataError
from camnet.geometry.rotations import to_matrix
from camnet.importers._reading import known_columns, number, quoted
from camnet.importers._table import table_rows
from camnet.types import Array

__all__ = ["axes_of", "read_camera_poses"]

_PLACE, _ANGLES, _QUATERNION = ("x", "y", "z"), ("pan", "tilt"), ("qw", "qx", "qy", "qz")
_UNIT_TOLERANCE = 1e-3


def axes_of(pan_deg: float, tilt_deg: float, roll_deg: float = 0.0) -> Array:
    """Return the axes (3, 3), camera to world, of a camera that looks in a direction.

    Parameters
    ----------
    pan_deg : of the optical axis, counter-clockwise from x
    tilt_deg : of the optical axis below the horizon
    roll_deg : of the camera about its optical axis, clockwise as seen from behind
    """
    pan, tilt, roll = np.radians((pan_deg, tilt_deg, roll_deg))
    forward = np.array([np.cos(tilt) * np.cos(pan), np.cos(tilt) * np.sin(pan), -np.sin(tilt)])
    right = np.array([np.sin(pan), -np.cos(pan), 0.0])
    down = np.cross(forward, right)
    turn = np.array([[np.cos(roll), -np.sin(roll)], [np.sin(roll), np.cos(roll)]])
    return np.column_stack([np.column_stack([right, down]) @ turn, forward])


def read_camera_poses(path: Path) -> dict[str, tuple[Array, Array]]:
    """Read centres (3,) and axes (3, 3), camera to world, by the cameras' names.

    Raises
    ------
    DataError
        A column is missing or there twice, a value is not a number in its range, a quaternion is not of unit length,
        or a name is empty or there twice.
    """
    rows = table_rows(path)
    line, header = next(rows, (1, []))
    names = [name.strip().lower() for name in header]
    where = f"{path}, line {line}"
    needed = ("name", *_PLACE, *(_QUATERNION if "qw" in names else _ANGLES))
    if not set(needed) <= set(names) or len(set(names)) < len(names):
        raise DataError(f"{where}: the columns are {names}; {', '.join(needed)}, each once, were expected")
    known_columns(names, (*needed, "roll"), where)
    found: dict[str, tuple[Array, Array]] = {}
    for line, row in rows:
        where = f"{path}, line {line}"
        if len(row) != len(names):
            raise DataError(
                f"{where}: {len(row)} fields {quoted(','.join(row))}; the header has {len(names)}"
            )
        fields = dict(zip(names, row, strict=True))
        name = fields["name"].strip()
        if not name or name in found:
            raise DataError(f"{where}: name is {name!r}; a name that no other row has was expected")
        found[name] = _pose(fields, where)
    if not found:
        raise DataError(f"{path}: holds no row below its header; at least one pose was expected")
    return found


def _pose(fields: dict[str, str], where: str) -> tuple[Array, Array]:
    p = np.array([number(fields[axis], where, axis, 1e7) for axis in _PLACE])
    if "qw" in fields:
        q = np.array([number(fields[name], where, name, 2.0) for name in _QUATERNION])
        if abs(np.linalg.norm(q) - 1.0) > _UNIT_TOLERANCE:
            raise DataError(
                f"{where}: qw, qx, qy, qz has length {np.linalg.norm(q):.4g}; length 1 was expected"
            )
        return p, np.asarray(to_matrix(q / np.linalg.norm(q)))
    pan = number(fields["pan"], where, "pan", 720.0)
    tilt = number(fields["tilt"], where, "tilt", 90.0)
    roll = fields.get("roll", "").strip()
    return p, axes_of(pan, tilt, number(roll, where, "roll", 360.0) if roll else 0.0)
