"""Camera paths and point clouds as files that other programs read.

| file | format |
| --- | --- |
| ``path_tum.txt`` | TUM RGB-D: ``t x y z qx qy qz qw``, camera frame to the frame of the first camera |
| ``path_kitti.txt`` | KITTI: the first three rows of the pose's 4 x 4 matrix, row by row |
| ``points.ply`` | ASCII PLY; scale and its uncertainty in comments |
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from camnet.geometry.rotations import to_matrix
from camnet.storage.whole_file import write_text
from camnet.types import Array

__all__ = ["write_kitti", "write_ply", "write_tum"]


def write_tum(path: Path, t_s: Array, p: Array, q: Array) -> None:
    """Write poses (K,), (K, 3), (K, 4), scalar first, in TUM's format."""
    rows = np.column_stack([t_s, p, q[:, 1:], q[:, :1]])
    text = "".join(" ".join(f"{value:.9g}" for value in row) + "\n" for row in rows.tolist())
    write_text(path, "# t x y z qx qy qz qw\n" + text)


def write_kitti(path: Path, p: Array, q: Array) -> None:
    """Write poses (K, 3), (K, 4), scalar first, in KITTI's format."""
    rows = np.concatenate([to_matrix(q), p[:, :, None]], axis=2).reshape(len(p), 12)
    write_text(path, "".join(" ".join(f"{value:.12g}" for value in row) + "\n" for row in rows.tolist()))


def write_ply(path: Path, points: Array, unit: str, scale_sd: float | None) -> None:
    """Write points (M, 3) with their unit and the relative standard deviation of the scale in comments."""
    uncertainty = "unknown" if scale_sd is None else f"{scale_sd:.6g}"
    head = (
        "ply\nformat ascii 1.0\n"
        f"comment unit {unit}\ncomment relative standard deviation of the scale {uncertainty}\n"
        f"element vertex {len(points)}\nproperty double x\nproperty double y\nproperty double z\nend_header\n"
    )
    write_text(path, head + "".join(f"{x:.9g} {y:.9g} {z:.9g}\n" for x, y, z in points.tolist()))
