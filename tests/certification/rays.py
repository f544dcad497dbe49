"""Brute-force sight lines by PyBullet's own bodies and rays, for tests: no geometry is shared with the package."""

from __future__ import annotations

import numpy as np
import pybullet as pb


class Rays:
    """A PyBullet scene of solids: boxes (min, max) and upright cylinders (centre, radius, heights)."""

    def __init__(self) -> None:
        self.client = pb.connect(pb.DIRECT)

    def box(self, low, high) -> None:
        half = (0.5 * (np.array(high) - np.array(low))).tolist()
        shape = pb.createCollisionShape(pb.GEOM_BOX, halfExtents=half, physicsClientId=self.client)
        middle = (0.5 * (np.array(high) + np.array(low))).tolist()
        pb.createMultiBody(0, shape, basePosition=middle, physicsClientId=self.client)

    def cylinder(self, centre, radius, z) -> None:
        shape = pb.createCollisionShape(
            pb.GEOM_CYLINDER, radius=radius, height=z[1] - z[0], physicsClientId=self.client
        )
        middle = [*centre, 0.5 * (z[0] + z[1])]
        pb.createMultiBody(0, shape, basePosition=middle, physicsClientId=self.client)

    def clear(self, eyes, points) -> np.ndarray:
        """Whether nothing is hit between eyes (n, 3) and points (n, 3); starts a hair ahead of the eye."""
        eyes, points = np.asarray(eyes, float), np.asarray(points, float)
        starts = eyes + 1e-4 * (points - eyes) / np.linalg.norm(points - eyes, axis=-1, keepdims=True)
        out = []
        for k in range(0, len(starts), 4000):
            found = pb.rayTestBatch(
                starts[k : k + 4000].tolist(), points[k : k + 4000].tolist(), physicsClientId=self.client
            )
            out += [hit[0] < 0 for hit in found]
        return np.array(out, dtype=bool)

    def close(self) -> None:
        pb.disconnect(self.client)
