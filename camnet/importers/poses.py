"""Camera or robot paths in the format of the TUM RGB-D benchmark: a line ``t x y z qx qy qz qw`` a pose.

Times are s, positions m, quaternions scalar last, body to reference frame. Lines that begin with # are comments.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from camnet.errors import DataError
from camnet.geometry.rotations import align_sign
from camnet.importers._reading import number, text_lines
from camnet.types import Array

__all__ = ["read_tum"]

_FIELDS = ("t", "x", "y", "z", "qx", "qy", "qz", "qw")
_UNIT_TOLERANCE = 1e-2


def read_tum(path: Path) -> tuple[Array, Array, Array]:
    """Read times (K,), positions (K, 3) and orientations (K, 4), scalar first, with continuous signs.

    Raises
    ------
    DataError
        A malformed line, a quaternion that is not of unit length, times that do not increase, or no pose at all.
    """
    rows: list[list[float]] = []
    for line, text in text_lines(path):
        if not text.strip() or text.lstrip().startswith("#"):
            continue
        where = f"{path}, line {line}"
        parts = text.split()
        if len(parts) != len(_FIELDS):
            raise DataError(f"{where}: {len(parts)} values; t x y z qx qy qz qw were expected")
        row = [number(part, where, field) for part, field in zip(parts, _FIELDS, strict=True)]
        length = float(np.linalg.norm(row[4:]))
        if abs(length - 1.0) > _UNIT_TOLERANCE:
            raise DataError(f"{where}: the quaternion has length {length:g}; length 1 was expected")
        if rows and row[0] <= rows[-1][0]:
            raise DataError(
                f"{where}: time {row[0]:g} is not after {rows[-1][0]:g}; increasing times were expected"
            )
        rows.append(row)
    if not rows:
        raise DataError(f"{path}: holds no pose; lines t x y z qx qy qz qw were expected")
    table = np.array(rows)
    q = table[:, [7, 4, 5, 6]]
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    for k in range(1, len(q)):
        q[k] = align_sign(q[k], q[k - 1])
    return table[:, 0], table[:, 1:4], q
