"""Random cameras, solids and points: the package's sight lines against PyBullet's bodies and rays.

PyBullet's side shares no geometry with the package: boxes and cylinders are its own primitives, other solids triangles,
and the pinhole is projected here. Each case has a distance to the nearest edge: of the view (its six planes) or of a
solid (where the sight line passes one of its edges).
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
import pybullet as pb

from camnet.certification.planar_shapes import convex_solids
from camnet.certification.sight_lines import Solids, seen_pairs
from camnet.certification.site import views_of
from camnet.geometry.frustum import Frustum
from camnet.geometry.polytope import PolytopeRegion
from camnet.geometry.regions import BoxRegion, CylinderRegion, Region
from camnet.geometry.rotations import look_at, to_matrix
from camnet.geometry.settings import CameraModel, Intrinsics

NEAR_EDGE_M = 0.1
_SIDES = 64
_FOLDED = 1e-6  # triangles that share an edge and are this parallel are one face


@dataclass(frozen=True)
class Counts:
    """Cases: how many, in view, within ``NEAR_EDGE_M`` of an edge, with disagreement; how far such are from one, m."""

    cases: int
    in_view: int
    near_edge: int
    disagree: int
    farthest_m: float


class Scene:
    """Solids as regions of the package, as bodies of PyBullet, and their edges (n, 2, 3)."""

    def __init__(self, client: int, rng: np.random.Generator) -> None:
        self.client, self.regions, self.edges = client, [], np.zeros((0, 2, 3))
        pb.resetSimulation(physicsClientId=client)
        for k in range(3):
            x, y = rng.uniform(-14.0, 14.0, 2)
            w, d, h = rng.uniform(0.3, 5.0, 3)
            self._box((x - w, y - d, 0.0 if k else 1.0), (x + w, y + d, 1.0 + h))
        self._cylinder(
            rng.uniform(-12.0, 12.0, 2), float(rng.uniform(0.2, 2.0)), (0.0, float(rng.uniform(1, 6)))
        )
        self._polytope(
            rng.uniform(-12.0, 12.0, 2), float(rng.uniform(0.5, 4.0)), float(rng.uniform(1.0, 5.0)), rng
        )

    def _add(self, region: Region, shape: int, centre: object, edges: np.ndarray) -> None:
        self.regions.append(region)
        pb.createMultiBody(0, shape, basePosition=list(centre), physicsClientId=self.client)  # type: ignore[call-overload]
        self.edges = np.concatenate([self.edges, edges])

    def _box(self, low: tuple[float, ...], high: tuple[float, ...]) -> None:
        a, b = np.array(low), np.array(high)
        half = (0.5 * (b - a)).tolist()
        shape = pb.createCollisionShape(pb.GEOM_BOX, halfExtents=half, physicsClientId=self.client)
        corners = np.array([[x, y, z] for x in (a[0], b[0]) for y in (a[1], b[1]) for z in (a[2], b[2])])
        pairs = [(i, j) for i in range(8) for j in range(i) if (corners[i] != corners[j]).sum() == 1]
        self._add(BoxRegion("box", low, high), shape, 0.5 * (a + b), corners[np.array(pairs)])

    def _cylinder(self, centre: np.ndarray, radius: float, z: tuple[float, float]) -> None:
        shape = pb.createCollisionShape(
            pb.GEOM_CYLINDER, radius=radius, height=z[1] - z[0], physicsClientId=self.client
        )
        angle = 2.0 * np.pi * np.arange(_SIDES) / _SIDES
        rim = centre + radius * np.c_[np.cos(angle), np.sin(angle)]
        low, high = np.c_[rim, np.full(_SIDES, z[0])], np.c_[rim, np.full(_SIDES, z[1])]
        rings = [np.stack([ring, np.roll(ring, 1, axis=0)], axis=1) for ring in (low, high)]
        edges = np.concatenate(rings)
        self._add(
            CylinderRegion("pillar", tuple(centre), radius, z), shape, (*centre, 0.5 * (z[0] + z[1])), edges
        )

    def _polytope(self, centre: np.ndarray, size: float, height: float, rng: np.random.Generator) -> None:
        from scipy.spatial import ConvexHull

        points = np.c_[centre + rng.uniform(-size, size, (9, 2)), rng.uniform(0.0, height, 9)]
        hull = ConvexHull(points)
        faces, normals = hull.simplices, hull.equations[:, :3]
        shape = pb.createCollisionShape(
            pb.GEOM_MESH,
            vertices=points.tolist(),
            indices=np.c_[faces, faces[:, ::-1]].ravel().tolist(),  # both sides
            flags=pb.GEOM_FORCE_CONCAVE_TRIMESH,
            physicsClientId=self.client,
        )
        edges = [
            points[np.intersect1d(faces[i], faces[j])]
            for i in range(len(faces))
            for j in hull.neighbors[i]
            if i < j and normals[i] @ normals[j] < 1.0 - _FOLDED
        ]
        region = PolytopeRegion("rock", points)
        self._add(region, shape, (0.0, 0.0, 0.0), np.array(edges))

    def clear(self, eyes: np.ndarray, points: np.ndarray) -> np.ndarray:
        """Whether a ray hits nothing; rays start a hair ahead of the eye, which may be on a wall."""
        away = points - eyes
        starts = eyes + 1e-4 * away / np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1e-9)
        out: list[bool] = []
        for k in range(0, len(starts), 8000):
            part = slice(k, k + 8000)
            found = pb.rayTestBatch(starts[part].tolist(), points[part].tolist(), physicsClientId=self.client)
            out += [hit[0] < 0 for hit in found]
        return np.array(out, dtype=bool)

    def place_on(self, count: int, rng: np.random.Generator) -> np.ndarray:
        """Random places on edges (count, 3)."""
        edge, share = rng.integers(len(self.edges), size=count), rng.random((count, 1))
        return self.edges[edge, 0] + share * (self.edges[edge, 1] - self.edges[edge, 0])


@numba.njit  # type: ignore[untyped-decorator]
def edge_distance(eyes: np.ndarray, points: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Least distance of each segment eye to point to any of the edges (n, 2, 3), m.

    C. Ericson, Real-Time Collision Detection, section 5.1.9.
    """
    out = np.empty(len(eyes))
    for n in range(len(eyes)):
        least = np.inf
        d1 = points[n] - eyes[n]
        a = (d1 * d1).sum()
        for k in range(len(edges)):
            d2, r = edges[k, 1] - edges[k, 0], eyes[n] - edges[k, 0]
            e, f, c, b = (d2 * d2).sum(), (d2 * r).sum(), (d1 * r).sum(), (d1 * d2).sum()
            denominator = a * e - b * b
            s = min(max((b * f - c * e) / denominator, 0.0), 1.0) if denominator > 1e-12 else 0.0
            t = (b * s + f) / e
            if t < 0.0:
                t, s = 0.0, min(max(-c / a, 0.0), 1.0)
            elif t > 1.0:
                t, s = 1.0, min(max((b - c) / a, 0.0), 1.0)
            gap = r + s * d1 - t * d2
            least = min(least, (gap * gap).sum())
        out[n] = np.sqrt(least)
    return out


def outline_distance(eyes: np.ndarray, points: np.ndarray, pillar: CylinderRegion) -> np.ndarray:
    """Distance of each segment to the outline that an upright cylinder shows from aside, where lines touch it."""
    a, d = eyes[:, :2] - pillar.center[:2], points[:, :2] - eyes[:, :2]
    t = np.clip(-np.einsum("ni,ni->n", a, d) / np.maximum(np.einsum("ni,ni->n", d, d), 1e-12), 0.0, 1.0)
    aside = np.abs(np.linalg.norm(a + t[:, None] * d, axis=1) - pillar.radius_m)
    z = eyes[:, 2] + t * (points[:, 2] - eyes[:, 2])
    low, high = pillar.height
    return np.hypot(aside, np.maximum(np.maximum(low - z, z - high), 0.0))


def _camera(rng: np.random.Generator) -> CameraModel:
    width, height, focal = (
        int(rng.integers(320, 1920)),
        int(rng.integers(240, 1080)),
        float(rng.uniform(250, 900)),
    )
    optics = Intrinsics(
        width_px=width, height_px=height, fx_px=focal, fy_px=focal, cx_px=0.5 * width, cy_px=0.5 * height
    )
    return CameraModel(name="c", intrinsics=optics, near_m=0.5, far_m=float(rng.uniform(15.0, 40.0)))


def _pictured(camera: CameraModel, eye: np.ndarray, q: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Whether the pinhole puts points into the picture and between the near and the far plane."""
    x, y, z = ((points - eye) @ to_matrix(q)).T
    c = camera.intrinsics
    ahead = (z >= camera.near_m) & (z <= camera.far_m)
    u, v = (f * a / np.where(ahead, z, 1.0) + o for f, a, o in ((c.fx_px, x, c.cx_px), (c.fy_px, y, c.cy_px)))
    return ahead & (u >= 0) & (v >= 0) & (u <= c.width_px) & (v <= c.height_px)


def _eye(scene: Scene, rng: np.random.Generator) -> np.ndarray:
    """A place in the open, or on a wall of a box, in no solid: rays that begin inside hit nothing."""
    while True:
        on_wall = rng.random() < 0.4
        if on_wall:
            (x0, y0, z0), (x1, y1, z1) = scene.regions[1].bounds
            eye = np.array([rng.choice([x0, x1]), rng.uniform(y0, y1), rng.uniform(z0 + 0.1, z1)])
        else:
            eye = np.array([*rng.uniform(-20.0, 20.0, 2), rng.uniform(2.0, 9.0)])
        others = [region for k, region in enumerate(scene.regions) if not (on_wall and k == 1)]
        if not any(region.contains(eye[None])[0] for region in others):
            return eye


def _points(
    scene: Scene, eye: np.ndarray, q: np.ndarray, frustum: Frustum, n: int, rng: np.random.Generator
) -> np.ndarray:
    """A third behind edges of solids, a sixth at the rim of the view, the rest in front of the camera."""
    ahead = to_matrix(q)[:, 2]
    turned = ahead + rng.normal(scale=0.3, size=(n, 3))
    points = eye + rng.uniform(1.0, 25.0, (n, 1)) * turned / np.linalg.norm(turned, axis=1, keepdims=True)
    third, sixth = n // 3, n // 6
    edge = scene.place_on(third, rng)
    points[:third] = (
        eye + (edge - eye) * rng.uniform(1.02, 1.6, (third, 1)) + rng.normal(scale=0.05, size=(third, 3))
    )
    rim = points[third : third + sixth]
    plane = rng.integers(4, size=sixth) + len(frustum.b) - 4
    off = np.einsum("ni,ni->n", frustum.A[plane], rim) - frustum.b[plane]
    points[third : third + sixth] = (
        rim - (off + rng.normal(scale=0.05, size=sixth))[:, None] * frustum.A[plane]
    )
    return points


def compare(cases: int, seed: int, per_camera: int = 1000) -> Counts:
    """Compare ``cases`` random sight lines, ``per_camera`` at a time."""
    rng, client = np.random.default_rng(seed), pb.connect(pb.DIRECT)
    total = np.zeros(4, dtype=int)
    farthest = 0.0
    try:
        while total[0] < cases:
            scene, camera = Scene(client, rng), _camera(rng)
            eye = _eye(scene, rng)
            q = look_at(eye, np.array([*rng.uniform(-12.0, 12.0, 2), rng.uniform(0.0, 2.0)]))
            frustum = Frustum.from_camera(camera).in_world(eye, q)
            n = min(per_camera, cases - int(total[0]))
            points = _points(scene, eye, q, frustum, n, rng)
            eyes = np.repeat(eye[None], n, axis=0)
            solids = Solids.of([part for region in scene.regions for part in convex_solids(region)])
            ours = seen_pairs(
                points[:, None], np.zeros(n, dtype=np.int64), views_of([frustum], eye[None]), solids
            )
            theirs = _pictured(camera, eye, q, points)
            rows = np.flatnonzero(theirs)
            theirs[rows] = scene.clear(eyes[rows], points[rows])
            depth = points @ frustum.A.T - frustum.b
            rim = np.where((depth <= NEAR_EDGE_M).all(axis=1), np.abs(depth).min(axis=1), np.inf)
            away = np.minimum(rim, edge_distance(eyes, points, scene.edges))
            pillars = [region for region in scene.regions if isinstance(region, CylinderRegion)]
            away = np.minimum.reduce([away, *(outline_distance(eyes, points, pillar) for pillar in pillars)])
            wrong = ours != theirs
            total += [n, theirs.sum(), (away <= NEAR_EDGE_M).sum(), wrong.sum()]
            farthest = max(farthest, float(away[wrong].max(initial=0.0)))
    finally:
        pb.disconnect(client)
    return Counts(*total.tolist(), farthest)
