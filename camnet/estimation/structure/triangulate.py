"""Where the rays of observations meet: the start of a bundle adjustment.

| symbol | name | shape | unit | equation |
| --- | --- | --- | --- | --- |
| ``u_k`` | | (K, 3) | - | unit rays of one point's observations, from the poses p_k |
| ``x`` | | (3,) | m | ``sum (I - u_k u_k^T) x = sum (I - u_k u_k^T) p_k``: least squares of distances from the rays |
| ``rho`` | | | 1/m | inverse depth in the anchor, the first pose that saw the point |
"""

from __future__ import annotations

import numpy as np

from camnet.estimation.structure.bundle.problem import Observations
from camnet.geometry.rotations import to_matrix
from camnet.types import Array, IntArray

__all__ = ["meeting_point", "start_points"]

#: halvings of an inverse depth that would put its point behind a camera, before it is set to zero
_HALVINGS = 20


def meeting_point(p: Array, u: Array) -> Array | None:
    """Point (3,) nearest K >= 2 rays from p (K, 3) along u (K, 3); None where they are all but parallel."""
    across = np.eye(3) - u[:, :, None] * u[:, None, :]
    normal = across.sum(axis=0)
    if np.linalg.eigvalsh(normal)[0] < 1e-8:
        return None
    return np.asarray(np.linalg.solve(normal, np.einsum("kij,kj->i", across, p)))


def start_points(seen: Observations, count: int, p: Array, q: Array) -> tuple[IntArray, Array]:
    """Anchors (count,) and starts (count, 3), ``(a, b, rho)``, from poses (P, 3), (P, 4).

    A point whose rays do not meet in front of all its cameras starts as far as is needed, at infinity if need be.
    """
    r = to_matrix(q)
    anchor, points = np.zeros(count, dtype=np.int64), np.zeros((count, 3))
    for j in range(count):
        mine = np.flatnonzero(seen.point == j)
        mine = mine[np.argsort(seen.pose[mine], kind="stable")]
        pose, ray = seen.pose[mine], np.column_stack([seen.xy[mine], np.ones(len(mine))])
        a = int(pose[0])
        anchor[j], points[j, :2] = a, seen.xy[mine[0]]
        along = np.squeeze(r[pose] @ ray[..., None], -1)
        met = meeting_point(p[pose], along / np.linalg.norm(along, axis=1, keepdims=True))
        depth = 0.0 if met is None else float((met - p[a]) @ r[a][:, 2])
        rho = 1.0 / depth if depth > 0.0 else 0.0
        for _ in range(_HALVINGS):
            x_z = np.sum(r[pose][:, :, 2] * (r[a] @ ray[0] + rho * (p[a] - p[pose])), axis=1)
            if np.all(x_z > 0.05):
                break
            rho *= 0.5
        points[j, 2] = rho
    return anchor, points
