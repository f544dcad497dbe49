"""The part of a camera's image that shows a marker, drawn through the known homography of its plane.

| symbol | name | unit |
| --- | --- | --- |
| ``x = (x, y, 1)`` | ray of a point of the image, lens distortion taken out | - |
| ``M(tau) = [c1 - c0, c3 - c0, c0]`` | the marker's plane in the camera frame, 3 x 3 | m |
| ``(a, b, 1) ~ M^-1 x`` | place on the marker that the ray hits: the homography | - |
| ``tau = (v / H - 1/2) t_r + e`` | when row v of H is exposed; e within half the exposure; t_r readout | s |

Each pixel is the mean of ``samples`` points of its square, spread evenly over both its edges and, by another
irrational step, over the exposure: pixel integration, motion blur and rolling shutter come out of one sum. Where a
pixel sees one colour alone, one look is enough. ``M`` moves at the constant relative velocity of target and
camera; pixel i spans [i - 1/2, i + 1/2] (OpenCV's convention).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RectBivariateSpline

from camnet.compiled import cached_njit
from camnet.geometry.pinhole import Pinhole
from camnet.geometry.rotations import skew
from camnet.geometry.rotations_compiled import to_matrix
from camnet.geometry.settings import Intrinsics
from camnet.sensing.marker import MODULES, QUIET, Marker, pattern
from camnet.types import Array, Snapshot

__all__ = ["BLACK", "MARGIN_PX", "WHITE", "Lens", "Patch", "draw_marker", "marker_motion", "undistort"]

#: grey levels of the printed marker
BLACK, WHITE = 30.0, 220.0
#: surroundings drawn beyond the plate, pixels
MARGIN_PX = 6
#: steps of the inverse distortion at most, and pixels between the points where it is solved for
_STEPS, _KNOT_PX = 60, 8
#: irrational steps that spread a pixel's points over its height and over the exposure: 1/g, 1/p with g^2 = g + 1,
#: p^3 = p + 1
_SPREAD_1, _SPREAD_2 = 0.6180339887498949, 0.7548776662466927


@dataclass(frozen=True, eq=False)
class Lens:
    """A camera's intrinsics with the rays of its pixels' corners at hand."""

    intrinsics: Intrinsics

    @cached_property
    def pinhole(self) -> Pinhole:
        """The camera."""
        return Pinhole.from_settings(self.intrinsics)

    @cached_property
    def _corner_rays(self) -> Array:
        """Normalised coordinates (height + 1, width + 1, 2) of all pixels' corners, distortion taken out.

        What the lens adds is smooth: it is solved for at every eighth pixel and carried on by cubic splines.
        """
        k, camera = self.intrinsics, self.pinhole
        u, v = np.arange(k.width_px + 1) - 0.5, np.arange(k.height_px + 1) - 0.5
        seen = (np.stack(np.meshgrid(u, v), axis=-1) - camera.centre) / camera.focal
        if not camera.distorted:
            return np.asarray(seen)
        few = [np.linspace(x[0], x[-1], max(5, len(x) // _KNOT_PX)) for x in (u, v)]
        knots = np.stack(np.meshgrid(*few), axis=-1)
        added = undistort(camera, knots) - (knots - camera.centre) / camera.focal
        for axis in range(2):
            seen[..., axis] += RectBivariateSpline(few[1], few[0], added[..., axis])(v, u)
        return np.asarray(seen)

    def rays(self, left: int, top: int, right: int, bottom: int) -> Array:
        """Rays (bottom - top + 1, right - left + 1, 2) of the corners of the pixels [left, right) x [top, bottom)."""
        return self._corner_rays[top : bottom + 1, left : right + 1]

    def normalise(self, pixels: Array) -> Array:
        """Normalised coordinates (..., 2) of pixels (..., 2) in the image, linear within a pixel; NaN stays."""
        if not self.pinhole.distorted:
            return np.asarray((pixels - self.pinhole.centre) / self.pinhole.focal)
        grid = self._corner_rays
        known = np.isfinite(pixels).all(axis=-1, keepdims=True)
        place = np.clip(np.where(known, pixels + 0.5, 0.0), 0.0, np.array(grid.shape[1::-1]) - 1.0 - 1e-9)
        u, v = np.moveaxis(place.astype(int), -1, 0)
        s, t = np.moveaxis(place - np.floor(place), -1, 0)[..., None]
        top = (1 - s) * grid[v, u] + s * grid[v, u + 1]
        low = (1 - s) * grid[v + 1, u] + s * grid[v + 1, u + 1]
        return np.where(known, (1 - t) * top + t * low, np.nan)


def undistort(pinhole: Pinhole, pixels: Array) -> Array:
    """Normalised coordinates (..., 2) of pixels (..., 2) by fixed-point iteration.

    Where the distortion folds the image (far outside the calibrated part) it stays where it got to.
    """
    seen = (pixels - pinhole.centre) / pinhole.focal
    rays = np.concatenate([seen, np.ones_like(seen[..., :1])], axis=-1)
    for _ in range(_STEPS):
        miss = (pinhole.project(rays) - pixels) / pinhole.focal
        rays[..., :2] -= miss
        if np.abs(miss).max() < 1e-10:
            break
    return np.ascontiguousarray(rays[..., :2])


@dataclass(frozen=True, eq=False, slots=True)
class Patch:
    """A part of an image: ``pixels`` (h, w), grey levels, whose first pixel is (``left``, ``top``)."""

    pixels: NDArray[np.float32]
    left: int
    top: int


def marker_motion(snapshot: Snapshot, camera: int, target: int, marker: Marker) -> tuple[Array, Array]:
    """Plane M (3, 3) of a target's marker in the camera frame, m, and its rate (3, 3), m/s."""
    r_c = to_matrix(snapshot.camera_q_world[camera])
    r_m = to_matrix(snapshot.target_q_world[target])
    corners_world = marker.corners @ r_m.T  # about the target's origin
    p = (snapshot.target_p_world[target] - snapshot.camera_p_world[camera] + corners_world) @ r_c
    spin = marker.corners @ skew(snapshot.target_w_body[target]).T @ r_m.T
    v = (snapshot.target_v_world[target] - snapshot.camera_v_world[camera] + spin) @ r_c
    v -= p @ skew(snapshot.camera_w_cam[camera]).T
    planes = (np.column_stack([x[1] - x[0], x[3] - x[0], x[0]]) for x in (p, v))
    plane, rate = planes
    return plane, rate


def draw_marker(
    lens: Lens,
    plane: Array,
    rate: Array,
    marker: Marker,
    background: NDArray[np.float32],
    samples: int = 16,
    exposure_s: float = 0.0,
    readout_s: float = 0.0,
) -> Patch | None:
    """Draw the surroundings of a marker as the camera sees it; None if too little of it is in the image.

    Parameters
    ----------
    lens : the camera
    plane, rate : (3, 3), (3, 3) of `marker_motion`
    background : (height, width) grey levels of what is around the marker
    samples : points in each pixel
    exposure_s, readout_s : time over which a row is exposed, and from the first row to the last
    """
    box = _box(lens, plane, rate, 0.5 * (exposure_s + readout_s))
    if box is None:
        return None
    left, top, right, bottom = box
    out: NDArray[np.float32] = background[top:bottom, left:right].astype(np.float32)
    rays = lens.rays(left, top, right, bottom)
    share = (np.arange(top, bottom) / lens.intrinsics.height_px - 0.5) * readout_s
    reach = 0.75 / _module_px(lens, plane)  # a little more than half a pixel's diagonal
    _draw(out, rays, plane, rate, share, exposure_s, samples, reach, pattern(marker.number))
    return Patch(out, left, top)


def _box(lens: Lens, plane: Array, rate: Array, reach_s: float) -> tuple[int, int, int, int] | None:
    """Pixels [left, right) x [top, bottom) around the plate at the ends of the exposure."""
    q = QUIET
    places = np.array([[-q, -q, 1.0], [1 + q, -q, 1.0], [1 + q, 1 + q, 1.0], [-q, 1 + q, 1.0]])
    ends = (-reach_s, reach_s) if reach_s else (0.0,)
    corners = np.concatenate([places @ (plane + tau * rate).T for tau in ends])
    if not (corners[:, 2] > 0.0).all():
        return None
    pixels = lens.pinhole.project(corners)
    low = np.maximum(np.floor(pixels.min(axis=0)).astype(int) - MARGIN_PX, 0)
    size = np.array([lens.intrinsics.width_px, lens.intrinsics.height_px])
    high = np.minimum(np.ceil(pixels.max(axis=0)).astype(int) + MARGIN_PX + 1, size)
    if (high - low < 2 * MARGIN_PX).any():
        return None
    return int(low[0]), int(low[1]), int(high[0]), int(high[1])


def _module_px(lens: Lens, plane: Array) -> float:
    """Smallest extent of a module in the image, pixels, judged at the plate's corners."""
    step, smallest = 1e-4, math.inf
    for a, b in ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)):
        places = np.array([[a, b, 1.0], [a + step, b, 1.0], [a, b + step, 1.0]]) @ plane.T
        x = lens.pinhole.focal * places[:, :2] / places[:, 2:]
        jacobian = (x[1:] - x[0]) / (step * MODULES)
        (p, q), (r, s) = jacobian.tolist()
        size, det = p * p + q * q + r * r + s * s, abs(p * s - q * r)
        # smaller singular value of a 2 x 2 matrix
        smallest = min(
            smallest, math.sqrt(max(0.0, 0.5 * (size - math.sqrt(max(0.0, size**2 - 4 * det**2)))))
        )
    return smallest


@cached_njit(error_model="numpy")
def _homography(plane: Array, rate: Array, tau: float, h: Array) -> None:
    """Inverse of ``plane + tau rate`` up to scale (adjugate), in modules of the plate, into h (3, 3)."""
    m = plane + tau * rate
    for i in range(3):
        for j in range(3):
            a, b, c, d = (i + 1) % 3, (i + 2) % 3, (j + 1) % 3, (j + 2) % 3
            h[j, i] = m[a, c] * m[b, d] - m[a, d] * m[b, c]
    for i in range(3):
        h[0, i] = MODULES * h[0, i] + h[2, i]
        h[1, i] = MODULES * h[1, i] + h[2, i]


@cached_njit(error_model="numpy")
def _module(h: Array, x: float, y: float) -> tuple[float, float]:
    w = 1.0 / (h[2, 0] * x + h[2, 1] * y + h[2, 2])
    return (h[0, 0] * x + h[0, 1] * y + h[0, 2]) * w, (h[1, 0] * x + h[1, 1] * y + h[1, 2]) * w


@cached_njit
def _spread(count: int, step: float) -> Array:
    """``count`` even numbers about 1/2: multiples of ``step`` modulo 1, their mean shifted to 1/2."""
    x = (np.arange(count) * step) % 1.0
    return np.asarray(x - np.mean(x) + 0.5)


@cached_njit(error_model="numpy")
def _colour(i0: float, j0: float, i1: float, j1: float, reach: float, modules: NDArray[np.uint8]) -> int:
    """Colour of all modules between two places, to within ``reach``; -1: off the plate, -2: several."""
    n = modules.shape[0]
    low_i, high_i = min(i0, i1) - reach, max(i0, i1) + reach
    low_j, high_j = min(j0, j1) - reach, max(j0, j1) + reach
    if high_i < 0.0 or low_i > n or high_j < 0.0 or low_j > n:
        return -1
    i_first, i_last = math.floor(low_i), math.floor(high_i)
    j_first, j_last = math.floor(low_j), math.floor(high_j)
    if i_first < 0 or j_first < 0 or i_last >= n or j_last >= n:
        return -2
    colour = int(modules[j_first, i_first])
    for j in range(j_first, j_last + 1):
        for i in range(i_first, i_last + 1):
            if modules[j, i] != colour:
                return -2
    return colour


@cached_njit(error_model="numpy")
def _beyond(i0: float, j0: float, i1: float, j1: float, n: int) -> float:
    """Distance of the nearer of two places from the plate along one of its axes, modules."""
    along = max(-max(i0, i1), min(i0, i1) - n)
    return max(along, max(-max(j0, j1), min(j0, j1) - n))


@cached_njit(error_model="numpy")
def _draw(
    out: NDArray[np.float32],
    rays: Array,
    plane: Array,
    rate: Array,
    row_s: Array,
    exposure_s: float,
    samples: int,
    reach: float,
    modules: NDArray[np.uint8],
) -> None:
    """Replace what the plate covers in ``out`` (h, w), pixel by pixel."""
    n = modules.shape[0]
    still = exposure_s == 0.0 and row_s[0] == 0.0 and row_s[-1] == 0.0
    h, first, last = np.empty((samples, 3, 3)), np.empty((3, 3)), np.empty((3, 3))
    along = (np.arange(samples) + 0.5) / samples
    across, when = _spread(samples, _SPREAD_1), _spread(samples, _SPREAD_2) - 0.5
    for v in range(out.shape[0]):
        if v == 0 or not still:
            _homography(plane, rate, row_s[v] - 0.5 * exposure_s, first)
            _homography(plane, rate, row_s[v] + 0.5 * exposure_s, last)
            for k in range(samples):
                _homography(plane, rate, row_s[v] + exposure_s * when[k], h[k])
        u = -1
        while u + 1 < out.shape[1]:
            u += 1
            x, y = rays[v, u, 0], rays[v, u, 1]
            x_u, y_u = rays[v, u + 1, 0] - x, rays[v, u + 1, 1] - y
            x_v, y_v = rays[v + 1, u, 0] - x, rays[v + 1, u, 1] - y
            x_mid, y_mid = x + 0.5 * (x_u + x_v), y + 0.5 * (y_u + y_v)
            i0, j0 = _module(first, x_mid, y_mid)
            i1, j1 = _module(last, x_mid, y_mid)
            colour = _colour(i0, j0, i1, j1, reach, modules)
            if (
                colour == -1
            ):  # no nearer pixel can be on the plate: a step is at most 4/3 reach, and some more off it
                u += max(0, int(0.5 * _beyond(i0, j0, i1, j1, n) / reach) - 2)
                continue
            if colour >= 0:
                out[v, u] = BLACK + (WHITE - BLACK) / 255.0 * colour
                continue
            total = 0.0
            for k in range(samples):
                s, t = along[k], across[k]
                i, j = _module(h[k], x + s * x_u + t * x_v, y + s * y_u + t * y_v)
                if 0.0 <= i < n and 0.0 <= j < n:
                    total += BLACK + (WHITE - BLACK) / 255.0 * modules[int(j), int(i)]
                else:
                    total += out[v, u]
            out[v, u] = total / samples
