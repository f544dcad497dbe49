"""Brute-force sight lines by PyBullet's own bodies and rays: no geometry is shared with the package."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pybullet as pb
import pytest

from camnet.geometry.rotations import look_at, to_matrix


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

    def sees(self, world, camera, point) -> np.ndarray:
        """Whether one fixed camera of a world's data sees points (n, 3), by projection and rays."""
        model = next(m for m in world["cameras"] if m["name"] == camera["camera"])
        c, eye = model["intrinsics"], np.array(camera["pose"]["position_m"], float)
        ray = (point - eye) @ to_matrix(look_at(eye, np.array(camera["pose"]["look_at_m"], float)))
        inside = (ray[:, 2] > model["near_m"]) & (ray[:, 2] < model["far_m"])
        rows = np.flatnonzero(inside)
        u, v = (c[f"f{a}_px"] * ray[rows, j] / ray[rows, 2] + c[f"c{a}_px"] for j, a in enumerate("xy"))
        inside[rows] = (u >= 0) & (v >= 0) & (u <= c["width_px"]) & (v <= c["height_px"])
        rows = np.flatnonzero(inside)
        inside[rows] = self.clear(np.repeat(eye[None], len(rows), axis=0), point[rows])
        return inside

    def longest_hidden(self, world, step_m=0.02) -> float:
        """Longest stretch of the first road, closed, on which no camera sees all features, by projection and rays."""
        for solid in world["occluders"]:
            self.box(solid["shape"]["min_m"], solid["shape"]["max_m"])
        corners = np.array(world["roads"][0]["points_m"], float)
        corners = np.vstack([corners, corners[:1]])
        length = np.linalg.norm(np.diff(corners, axis=0), axis=1)
        ends = np.r_[0.0, np.cumsum(length)]
        s = np.arange(0.0, ends[-1], step_m)
        i = np.searchsorted(ends, s, side="right") - 1
        along = (np.diff(corners, axis=0) / length[:, None])[i]
        across = np.c_[-along[:, 1], along[:, 0]]
        place = corners[i] + (s - ends[i])[:, None] * along
        seen = np.zeros(len(s), dtype=bool)
        for camera in world["fixed_cameras"]:
            whole = np.ones(len(s), dtype=bool)
            for x, y in ((0.12, 0.12), (0.12, -0.12), (-0.12, -0.12), (-0.12, 0.12)):
                point = np.c_[place + x * along + y * across, np.full(len(s), 0.3)]
                whole &= self.sees(world, camera, point)
            seen |= whole
        best = run = 0
        for here in np.r_[seen, seen]:
            run = 0 if here else run + 1
            best = max(best, run)
        return best * step_m

    def clean(self) -> None:
        pb.resetSimulation(physicsClientId=self.client)


@pytest.fixture
def rays() -> Iterator[Rays]:
    scene = Rays()
    yield scene
    pb.disconnect(scene.client)
