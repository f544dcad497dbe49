"""Brute-force sight lines by PyBullet's own bodies and rays: no geometry is shared with the package."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pybullet as pb
import pytest


class Rays:
    """A PyBullet scene of solids: boxes (lowest, highest corner) and upright cylinders (centre, radius, heights)."""

    def __init__(self) -> None:
        self.client = pb.connect(pb.DIRECT)

    def box(self, low, high) -> None:
        low, high = np.array(low, float), np.array(high, float)
        half = (0.5 * (high - low)).tolist()
        shape = pb.createCollisionShape(pb.GEOM_BOX, halfExtents=half, physicsClientId=self.client)
        pb.createMultiBody(0, shape, basePosition=(0.5 * (low + high)).tolist(), physicsClientId=self.client)

    def cylinder(self, centre, radius, z) -> None:
        shape = pb.createCollisionShape(
            pb.GEOM_CYLINDER, radius=radius, height=z[1] - z[0], physicsClientId=self.client
        )
        middle = [*centre, 0.5 * (z[0] + z[1])]
        pb.createMultiBody(0, shape, basePosition=middle, physicsClientId=self.client)

    def clear(self, eyes, points) -> np.ndarray:
        """Whether nothing is hit between eyes (n, 3) and points (n, 3); rays start a hair ahead of the eye."""
        eyes, points = np.broadcast_arrays(np.asarray(eyes, float), np.asarray(points, float))
        away = points - eyes
        starts = eyes + 1e-4 * away / np.maximum(np.linalg.norm(away, axis=-1, keepdims=True), 1e-9)
        out = []
        for k in range(0, len(starts), 4000):
            found = pb.rayTestBatch(
                starts[k : k + 4000].tolist(), points[k : k + 4000].tolist(), physicsClientId=self.client
            )
            out += [hit[0] < 0 for hit in found]
        return np.array(out, dtype=bool)

    def clean(self) -> None:
        pb.resetSimulation(physicsClientId=self.client)


@pytest.fixture
def rays() -> Iterator[Rays]:
    scene = Rays()
    yield scene
    pb.disconnect(scene.client)
