"""Cameras that watch a site, each by one or several convex views; the whole image of a lens that distorts.

The frustum of a distorting lens is cut to the innermost border points, so that it is convex. That leaves out the
corners of the image. Here they are added as pyramids: the border of the image is sampled, and each pair of neighbouring
border rays with the middle of the image spans one. Where the lens model folds the image over before its border, the
border is the last place at which pixels still move away from the middle.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from camnet.certification.coverage import Views
from camnet.geometry.frustum import Frustum
from camnet.geometry.pinhole import Pinhole
from camnet.geometry.settings import Intrinsics
from camnet.types import Array, IntArray

__all__ = ["Watch", "lens_pieces", "watch_of"]

#: border points for each side of an image
_SIDE = 16
#: steps at which pixels are followed from the middle to the border, and halvings of the last one
_STEPS, _HALVINGS = 64, 30
#: the face of a frustum that ends its range
_FAR = 1

Piece = tuple[Array, Array, Array]


@dataclass(frozen=True, eq=False)
class Watch:
    """Cameras of a site.

    Attributes
    ----------
    names : C names
    views : convex views, one or several for each camera, faces in the order of ``Frustum``
    owner : (V,) camera of each view, ascending
    focal_px : (C,) smaller focal length, px; None for cameras of which only the footprint is known
    """

    names: tuple[str, ...]
    views: Views
    owner: IntArray
    focal_px: Array | None

    def capped(self, px_per_m: float) -> Watch:
        """Return the same cameras with views that end where they have fewer than ``px_per_m``."""
        if self.focal_px is None:
            raise ValueError("cameras without intrinsics have no pixels per metre")
        axis, eyes = self.views.normals[:, _FAR], self.views.position
        reach = np.einsum("vi,vi->v", axis, eyes) + self.focal_px[self.owner] / px_per_m
        offsets = self.views.offsets.copy()
        offsets[:, _FAR] = np.minimum(offsets[:, _FAR], reach)
        return replace(self, views=replace(self.views, offsets=offsets))

    def one(self, view: int) -> Views:
        """Return one of the views alone."""
        v, k = self.views, slice(view, view + 1)
        return Views(v.normals[k], v.offsets[k], v.bounds_xy[k], v.position[k])

    def density(self, camera: int, points: Array) -> Array:
        """Return the pixels per metre (n,) that a camera has at points (n, 3) in front of it."""
        if self.focal_px is None:
            raise ValueError("cameras without intrinsics have no pixels per metre")
        view = int(np.searchsorted(self.owner, camera))
        depth = (points - self.views.position[view]) @ self.views.normals[view, _FAR]
        return np.asarray(self.focal_px[camera] / np.maximum(depth, 1e-9))


def watch_of(
    names: Sequence[str], frusta: Sequence[Frustum], more: Sequence[list[Piece]], eyes: Array, focal: Array
) -> Watch:
    """Take each camera's frustum in the world, further pieces of its view in the world, and optical centres (C, 3)."""
    pieces: list[Piece] = []
    owner: list[int] = []
    for k, (frustum, others) in enumerate(zip(frusta, more, strict=True)):
        mine = [(frustum.A, frustum.b, frustum.corners), *others]
        pieces += mine
        owner += [k] * len(mine)
    normals, offsets, corners = (np.stack([piece[i] for piece in pieces]) for i in range(3))
    views = Views.create(normals, offsets, corners, np.asarray(eyes, dtype=float)[owner])
    return Watch(tuple(names), views, np.array(owner, dtype=np.int64), np.asarray(focal, dtype=float))


def lens_pieces(
    intrinsics: Intrinsics, near_m: float, far_m: float, p_world: Array, r_world: Array
) -> list[Piece]:
    """Return the parts of a distorting lens's view as half-spaces and corners in the world; none without distortion.

    Parameters
    ----------
    intrinsics : the lens
    near_m, far_m : range along the optical axis
    p_world, r_world : (3,) optical centre, (3, 3) camera to world
    """
    pinhole = Pinhole.from_settings(intrinsics)
    if not pinhole.distorted:
        return []
    border = _border(pinhole)
    middle = pinhole.normalise(pinhole.centre)
    return [
        _pyramid(np.array([middle, a, b]), near_m, far_m, p_world, r_world)
        for a, b in zip(border, np.roll(border, -1, axis=0), strict=True)
        if abs(_cross(a - middle, b - middle)) > 1e-12
    ]


def _border(pinhole: Pinhole) -> Array:
    """Return normalised coordinates (n, 2) around the largest part of the image that the lens maps one to one."""
    (w, h), t = pinhole.size, np.linspace(0.0, 1.0, _SIDE, endpoint=False)
    zero, one = np.zeros(_SIDE), np.ones(_SIDE)
    sides = ((t * w, zero), (w * one, t * h), (w * (1.0 - t), h * one), (zero, h * (1.0 - t)))
    pixels = np.concatenate([np.stack(side, axis=1) for side in sides])
    return np.array([_last_ray(pinhole, pixel) for pixel in pixels])


def _last_ray(pinhole: Pinhole, pixel: Array) -> Array:
    """Return the ray of the last pixel on the line from the middle to ``pixel`` that belongs to one ray."""
    low, high = 0.0, 1.0
    if _one_to_one(pinhole, pixel):
        return np.asarray(pinhole.normalise(pixel))
    for _ in range(_HALVINGS):
        share = 0.5 * (low + high)
        if _one_to_one(pinhole, pinhole.centre + share * (pixel - pinhole.centre)):
            low = share
        else:
            high = share
    return np.asarray(pinhole.normalise(pinhole.centre + low * (pixel - pinhole.centre)))


def _one_to_one(pinhole: Pinhole, pixel: Array) -> bool:
    """Whether pixels move away from the middle all along the ray of ``pixel``."""
    ray = pinhole.normalise(pixel)
    if not np.isfinite(ray).all():
        return False
    along = np.linspace(0.0, 1.0, _STEPS)[:, None] * ray
    pixels = pinhole.project(np.c_[along, np.ones(_STEPS)])
    away = np.linalg.norm(pixels - pinhole.centre, axis=1)
    return bool((np.diff(away) > 0.0).all())


def _cross(a: Array, b: Array) -> float:
    return float(a[0] * b[1] - a[1] * b[0])


def _pyramid(ring: Array, near_m: float, far_m: float, p: Array, r: Array) -> Piece:
    """Return half-spaces (6, 3), (6,) and corners (8, 3) of three rays (3, 2), cut at both ranges."""
    rays = np.c_[ring, np.ones(3)]
    sides = np.cross(rays, np.roll(rays, -1, axis=0))
    inward = np.sign(np.einsum("ij,ij->i", sides, np.roll(rays, -2, axis=0)))
    sides = -inward[:, None] * sides / np.linalg.norm(sides, axis=1, keepdims=True)
    a = np.array([[0.0, 0.0, -1.0], [0.0, 0.0, 1.0], *sides, sides[-1]]) @ r.T
    b = np.array([-near_m, far_m, 0.0, 0.0, 0.0, 0.0]) + a @ p
    corners = np.concatenate([near_m * rays, far_m * rays])[[0, 1, 2, 2, 3, 4, 5, 5]] @ r.T + p
    return a, b, corners
