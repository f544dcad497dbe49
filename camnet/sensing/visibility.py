"""Which camera sees which target, decided on the truth.

A target is visible when all its feature points are in the camera's frustum, when it is inside the region of the
camera's agent (an agent has no feedback from outside its region, harris2020 ch. 4), and when nothing blocks the
line of sight to any of the points. The cheap tests come first: sight lines are asked for only where the others pass.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike

from camnet.compiled import cached_njit
from camnet.geometry import rotations
from camnet.geometry.frustum import Frustum
from camnet.geometry.regions import Region
from camnet.geometry.rotations_compiled import to_matrix
from camnet.geometry.settings import CameraModel
from camnet.types import Array, BoolArray, IntArray, Snapshot

__all__ = ["RaysClear", "VisibilityTest", "features_world", "see", "who_may_see"]

#: (origins (K, 3), points (K, 3)) -> (K,): which sight lines nothing blocks
RaysClear = Callable[[Array, Array], BoolArray]


def features_world(p_world: ArrayLike, q_world: ArrayLike, features: ArrayLike) -> Array:
    """Feature points (..., K, 3) in the world, of targets at p (..., 3), q (..., 4), from points (K, 3) in the body."""
    points = np.asarray(features, dtype=np.float64) @ np.swapaxes(rotations.to_matrix(q_world), -1, -2)
    return np.asarray(points + np.asarray(p_world, dtype=np.float64)[..., None, :])


@cached_njit
def _in_frusta(
    a: Array,
    b: Array,
    camera_p: Array,
    camera_q: Array,
    points: Array,
    first: IntArray,
    allowed: BoolArray,
) -> BoolArray:
    """Whether all points of each target are in each camera's frustum (C, M); points (F, 3) in the world.

    Only pairs that are ``allowed`` (C, M) are looked at; the others are False.
    """
    n_cameras, n_targets = camera_p.shape[0], first.shape[0] - 1
    out = np.empty((n_cameras, n_targets), dtype=np.bool_)
    for c in range(n_cameras):
        r = to_matrix(camera_q[c])
        for m in range(n_targets):
            inside = allowed[c, m]
            if not inside:
                out[c, m] = False
                continue
            for f in range(first[m], first[m + 1]):
                d0, d1, d2 = (
                    points[f, 0] - camera_p[c, 0],
                    points[f, 1] - camera_p[c, 1],
                    points[f, 2] - camera_p[c, 2],
                )
                x = r[0, 0] * d0 + r[1, 0] * d1 + r[2, 0] * d2
                y = r[0, 1] * d0 + r[1, 1] * d1 + r[2, 1] * d2
                z = r[0, 2] * d0 + r[1, 2] * d1 + r[2, 2] * d2
                for k in range(6):
                    if a[c, k, 0] * x + a[c, k, 1] * y + a[c, k, 2] * z > b[c, k]:
                        inside = False
                        break
                if not inside:
                    break
            out[c, m] = inside
    return out


@cached_njit
def _points_world(target_p: Array, target_q: Array, features: Array, first: IntArray) -> Array:
    out = np.empty_like(features)
    for m in range(first.shape[0] - 1):
        r = to_matrix(target_q[m])
        for f in range(first[m], first[m + 1]):
            for i in range(3):
                out[f, i] = (
                    target_p[m, i]
                    + r[i, 0] * features[f, 0]
                    + r[i, 1] * features[f, 1]
                    + r[i, 2] * features[f, 2]
                )
    return out


@cached_njit
def see(
    a: Array,
    b: Array,
    camera_p: Array,
    camera_q: Array,
    target_p: Array,
    target_q: Array,
    features: Array,
    first: IntArray,
    allowed: BoolArray,
) -> BoolArray:
    """Whether each target, at ``target_p`` (M, 3), ``target_q`` (M, 4), is in each camera's frustum (C, M)."""
    return _in_frusta(
        a, b, camera_p, camera_q, _points_world(target_p, target_q, features, first), first, allowed
    )


@cached_njit
def who_may_see(inside: BoolArray, working: BoolArray, n_agents: int) -> tuple[BoolArray, IntArray]:
    """Pairs (C, M) that are not ruled out before looking, and the first region (M,) of each target (-1: none).

    Parameters
    ----------
    inside : (M, C) which target is in which camera's region; an agent (the first cameras) sees nothing outside its own
    working : (C,) which cameras work
    """
    n_targets, n_cameras = inside.shape
    allowed = np.empty((n_cameras, n_targets), dtype=np.bool_)
    region = np.full(n_targets, -1, dtype=np.int64)
    for m in range(n_targets):
        for c in range(n_cameras):
            allowed[c, m] = working[c] and (inside[m, c] or c >= n_agents)
            if inside[m, c] and region[m] < 0:
                region[m] = c
    return allowed, region


@cached_njit
def _sight_lines(visible: BoolArray, camera_p: Array, points: Array, first: IntArray) -> tuple[Array, Array]:
    """Both ends (K, 3) of the sight lines of all visible pairs, in the order of the pairs."""
    count = 0
    for c in range(visible.shape[0]):
        for m in range(visible.shape[1]):
            if visible[c, m]:
                count += first[m + 1] - first[m]
    origins, ends = np.empty((count, 3)), np.empty((count, 3))
    k = 0
    for c in range(visible.shape[0]):
        for m in range(visible.shape[1]):
            if visible[c, m]:
                for f in range(first[m], first[m + 1]):
                    origins[k], ends[k] = camera_p[c], points[f]
                    k += 1
    return origins, ends


@cached_njit
def _hide(visible: BoolArray, clear: BoolArray, first: IntArray) -> None:
    """Unset the pairs of which some sight line, in the order of ``_sight_lines``, is not clear."""
    k = 0
    for c in range(visible.shape[0]):
        for m in range(visible.shape[1]):
            if visible[c, m]:
                for _ in range(first[m], first[m + 1]):
                    if not clear[k]:
                        visible[c, m] = False
                    k += 1


class VisibilityTest:
    """Visibility of M targets from C cameras.

    Parameters
    ----------
    cameras : C camera models, in the snapshot's order
    features : for each of the M targets its feature points (K, 3) in its body frame, m
    regions : for each camera the region outside which it sees nothing, or None
    """

    def __init__(
        self, cameras: Sequence[CameraModel], features: Sequence[ArrayLike], regions: Sequence[Region | None]
    ) -> None:
        if len(cameras) != len(regions):
            raise ValueError(
                f"{len(cameras)} cameras but {len(regions)} regions: give one, or None, for each camera"
            )
        self.frusta = Frustum.stack([Frustum.from_camera(camera) for camera in cameras])
        self._regions = {c: region for c, region in enumerate(regions) if region is not None}
        points = [np.array(f, dtype=np.float64).reshape(-1, 3) for f in features]
        self._features: Array = np.concatenate(points) if points else np.zeros((0, 3))
        self._first: IntArray = np.concatenate([[0], np.cumsum([len(p) for p in points])]).astype(np.int64)
        self._all: BoolArray = np.ones((len(cameras), len(points)), dtype=np.bool_)

    @property
    def packed(self) -> tuple[Array, Array, Array, IntArray]:
        """Frusta (C,6,3), (C,6), features (F,3) and where those of each target begin, as `see` takes them."""
        return self.frusta.A, self.frusta.b, self._features, self._first

    def clear(self, snapshot: Snapshot, visible: BoolArray, rays_clear: RaysClear) -> None:
        """Unset the pairs of ``visible`` (C, M) between which something blocks a sight line."""
        points = self._points(snapshot)
        origins, ends = _sight_lines(visible, snapshot.camera_p_world, points, self._first)
        if len(origins):
            _hide(visible, np.asarray(rays_clear(origins, ends), dtype=np.bool_), self._first)

    def in_view(self, snapshot: Snapshot) -> BoolArray:
        """Whether target m is in the frustum of camera c and in its region (C, M); occlusion is not looked at."""
        return self._in_view(snapshot, self._all)

    def __call__(
        self, snapshot: Snapshot, rays_clear: RaysClear | None = None, allowed: BoolArray | None = None
    ) -> BoolArray:
        """Whether camera c sees target m (C, M).

        Parameters
        ----------
        snapshot : the truth
        rays_clear : tells which sight lines are free; asked once, for the pairs that pass the other tests. Without
            it nothing blocks.
        allowed : (C, M) pairs that are looked at (all if None); the others do not see each other
        """
        visible = self._in_view(snapshot, self._all if allowed is None else allowed)
        if rays_clear is not None:
            self.clear(snapshot, visible, rays_clear)
        return visible

    def _points(self, snapshot: Snapshot) -> Array:
        return np.asarray(
            _points_world(snapshot.target_p_world, snapshot.target_q_world, self._features, self._first)
        )

    def _in_view(self, snapshot: Snapshot, allowed: BoolArray) -> BoolArray:
        visible: BoolArray = see(
            self.frusta.A,
            self.frusta.b,
            snapshot.camera_p_world,
            snapshot.camera_q_world,
            snapshot.target_p_world,
            snapshot.target_q_world,
            self._features,
            self._first,
            allowed,
        )
        for c, region in self._regions.items():
            if visible[c].any():
                visible[c] &= region.contains(snapshot.target_p_world)
        return visible
