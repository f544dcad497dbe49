r"""What convex occluders hide of the targets' plane: the shadow is widened by the target's extent, not the occluder.

| symbol | name | meaning |
| --- | --- | --- |
| S | | every point q whose line of sight from the eye e meets the occluder O: e + l (o - e), o in O, l >= 1 |
| rho | ``extent_m`` | radius of the target's ball |
| dark(h) | ``shadow_polygon`` | places (x, y) at which a ball of radius rho about (x, y, h) may meet S |

S is convex. A ball about (x, y, h) meets it only where S has a point between the heights h - rho and h + rho no
further than rho from (x, y). The part of S between these heights has its corners on the two planes or in O, so its
outline from above is the convex hull of both cuts and of O's corners between them; grown by rho it is dark(h). An
occluder grown by rho before the shadow is cast would swallow a camera that is mounted on it.
"""

from __future__ import annotations

import numpy as np
import shapely
from scipy.spatial import HalfspaceIntersection

from camnet.geometry.polytope import largest_ball
from camnet.types import Array

__all__ = ["shadow_polygon"]

#: an eye less than twice this (m) above the targets is as low as they are
_LEVEL_M = 1e-3
#: an occluder that reaches the eye's height is cut this far below it, as a share of the eye's height above the targets
_BELOW_EYE = 1e-5
#: what is thinner than this (m) is contact
_CONTACT_M = 1e-9
#: pieces of a quarter turn where a shadow is grown; chords would cut corners by 0.2 % of the extent
_QUARTER = 16


def shadow_polygon(
    eye: Array, normals: Array, limits: Array, height_m: float, extent_m: float, reach_m: float = 1e4
) -> shapely.Geometry:
    """Return what a convex occluder hides of the plane z = ``height_m`` from an eye above or below it.

    Parameters
    ----------
    eye : (3,) optical centre, m
    normals, limits : (F, 3), (F,) occluder, B x <= c
    height_m : height of the targets' reference points, m
    extent_m : radius of the targets' extent, m
    reach_m : shadows are cut this far from the eye; it must be beyond the camera's range
    """
    if eye[2] < height_m:  # seen in the mirror of the plane
        normals, limits = normals * np.array([1.0, 1.0, -1.0]), limits - 2.0 * height_m * normals[:, 2]
        eye = np.array([eye[0], eye[1], 2.0 * height_m - eye[2]])
    low, high = height_m - extent_m, height_m + extent_m
    top = float(eye[2]) - _BELOW_EYE * (float(eye[2]) - high)
    inside = bool((normals @ eye < limits - _CONTACT_M).all())
    if (
        inside or eye[2] - high < 2.0 * _LEVEL_M
    ):  # inside the occluder, or as low as the target: nothing can be told
        return shapely.Point(eye[:2]).buffer(reach_m)
    parts = [_cast(eye, normals, limits, low, top, reach_m)]
    if extent_m > 0.0:
        parts += [
            _cast(eye, normals, limits, high, top, reach_m),
            _corners(normals, limits, low, high)[:, :2],
        ]
    points = np.concatenate(parts)
    if len(points) == 0:
        return shapely.Polygon()
    hull = shapely.MultiPoint(points).convex_hull
    return (
        shapely.buffer(hull, extent_m / np.cos(0.25 * np.pi / _QUARTER), quad_segs=_QUARTER)
        if extent_m > 0.0
        else hull
    )


def _corners(normals: Array, limits: Array, low: float, high: float) -> Array:
    """Return the corners (K, 3) of a solid's part between two heights; none where it has no inner part."""
    a = np.r_[normals, [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]]
    b = np.r_[limits, high, -low]
    if not high - low > _CONTACT_M:
        return np.zeros((0, 3))
    inside, room = largest_ball(a, b)
    if not room > _CONTACT_M:
        return np.zeros((0, 3))
    return np.asarray(HalfspaceIntersection(np.c_[a, -b], inside).intersections)


def _cast(eye: Array, normals: Array, limits: Array, height_m: float, top: float, reach_m: float) -> Array:
    """Return the corners (K, 2) of what a solid's part between two heights covers of the lower one from the eye."""
    corners = _corners(normals, limits, height_m, top)
    ratio = (eye[2] - height_m) / (eye[2] - corners[:, 2])
    cast = eye[:2] + (corners[:, :2] - eye[:2]) * ratio[:, None]
    away = np.linalg.norm(cast - eye[:2], axis=1, keepdims=True)
    far = away > reach_m * 1e3  # corners at the eye's height cast to infinity; keep their direction
    return np.asarray(
        np.where(far, eye[:2] + (cast - eye[:2]) / np.maximum(away, 1e-12) * reach_m * 1e3, cast)
    )
