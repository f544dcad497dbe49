"""Scale of a target that never rests: what the images leave open, and what closes it.

| symbol | name | shape | unit | equation |
| --- | --- | --- | --- | --- |
| ``X_i`` | ``structure_up_to_scale`` | (N, 3) | - | features, target's first frame; mean distance at first sight 1 |
| ``p_c`` | ``p_camera`` | (K, 3) | m | camera in the scene |
| ``d`` | ``away`` | (K, 3) | - | camera to target in scene axes; the target is at ``p_c + s d`` |
| ``s`` | ``scale`` | | m | |
| ``n(a)`` | | (K, 3) | - | across the target's heading, which is the angle a in its first frame, and level |
| ``l`` | ``axle`` | | m | how far ahead of its axle the target's origin is |
| | | | | no lateral slip, over each window: ``int n^T (p_c' + s d') + l dpsi = 0`` |

Images of the target and the camera's own motion do not tell s: any s gives a target that moves somehow. A wheeled
target moves along its heading; the condition is linear in (s, l) for each a, so a is searched and the rest solved. With
a still camera ``p_c' = 0``, and every s fits as well as any other: s is unobservable, and ``None`` is returned. The
axle's place has a prior, since a steady turn does not tell it from the heading.

A known distance between two features, or a known height of one above the ground, gives s as well. The latter divides
by the height of the camera above the feature and so multiplies errors of the camera's attitude.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.signal import savgol_filter

from camnet.errors import DataError
from camnet.estimation.structure.bootstrap import bootstrap_poses
from camnet.estimation.structure.bundle import BundleState, Observations, adjust, build_problem
from camnet.estimation.structure.triangulate import start_points
from camnet.geometry.rotations import conjugate, log, multiply, rotate
from camnet.types import Array, IntArray

__all__ = ["ScaleEstimate", "scale_by_height", "scale_by_no_slip", "scale_by_size", "structure_up_to_scale"]

_SMOOTH_S, _WINDOW_S = 2.0, 1.0
_AXLE_SD_M = 0.1
#: standard deviation of the axle's windows against which its prior is weighed, m
_SLIP_SD_M = 0.02
#: largest mean square of the weighted residuals at which a structure explains the images
_FIT = 1.5
#: a scale less certain than this share of itself is no scale
_LEAST_CERTAIN = 0.1


@dataclass(frozen=True, slots=True)
class ScaleEstimate:
    """Scale ``s`` in m and its standard deviation."""

    scale: float
    sd: float


def structure_up_to_scale(xy: Array, noise: float) -> Array:
    """Features (N, 3) in the camera frame of the first image used, of mean distance 1; the target alone is looked at.

    Parameters
    ----------
    xy : (P, N, 2) normalised coordinates in P images in which the target has turned or come nearer; NaN where not seen
    noise : standard deviation of each coordinate

    Raises
    ------
    DataError
        If no start leads to a structure that explains the images within their noise.
    """
    count = len(xy)
    for part in (
        slice(None),
        slice(0, None, 2),
        slice(1, None, 2),
        slice(0, count // 2),
        slice(count // 2, None),
    ):
        found = _structure(xy[part], noise)
        if found is not None:
            return found
    raise DataError("no start leads to a structure that explains the images within their noise")


def _structure(xy: Array, noise: float) -> Array | None:
    """Structure from one set of images; None if it does not explain them (a wrong start, a false minimum)."""
    pose, point = np.nonzero(np.isfinite(xy[..., 0]))
    seen = Observations(pose, point, xy[pose, point], np.full(len(pose), noise))
    count = xy.shape[1]
    try:
        p, q = bootstrap_poses(seen, len(xy), count, noise)
    except DataError:
        return None
    anchor, start = start_points(seen, count, p, q)
    nearby = float(np.median(start[:, 2]))
    if not nearby > 0.0:
        return None
    # every size fits: a soft prior keeps the one of the start
    prior = np.column_stack([np.full(count, nearby), np.full(count, 0.3 * nearby)])
    problem = build_problem(seen, anchor, [None] * (len(xy) - 1), 1.0, 1.0, prior)
    after, cost, _ = adjust(problem, BundleState(p, q, start, np.zeros(4)), 100)
    freedom = 2 * len(pose) - 6 * (len(xy) - 1) - 3 * count
    if not 2.0 * cost < _FIT * freedom:
        return None
    ray = np.column_stack([after.points[:, :2], np.ones(count)]) / after.points[:, 2:]
    points = after.p[anchor] + rotate(after.q[anchor], ray)
    return np.asarray(points / np.linalg.norm(points, axis=1).mean())


class _Windows(NamedTuple):
    """Heading since the start, its rate, velocities of the camera and of ``d``, first instants of windows, step."""

    psi: Array
    rate: Array
    v_camera: Array
    v_away: Array
    cells: IntArray
    dt: float

    def solve(self, a: float) -> tuple[float, Array, Array]:
        """Residual (m^2), ``(s, l)`` and the rows of the equations for heading ``a``."""
        n = np.column_stack([-np.sin(self.psi + a), np.cos(self.psi + a)])
        rows = np.column_stack([np.sum(n * self.v_away[:, :2], axis=1), self.rate])
        right = -np.sum(n * self.v_camera[:, :2], axis=1)
        a_w, b_w = (np.add.reduceat(x, self.cells, axis=0) * self.dt for x in (rows, right))
        a_p = np.vstack([a_w, [0.0, _SLIP_SD_M / _AXLE_SD_M]])
        b_p = np.append(b_w, 0.0)
        x = np.linalg.lstsq(a_p, b_p, rcond=None)[0]
        return float(np.sum((a_p @ x - b_p) ** 2)), x, a_p

    def cost(self, a: float) -> float:
        """Residual as a share of the way that the target goes: one in m would favour small scales."""
        square, x, _ = self.solve(a)
        way = float(np.sum((self.v_camera[:, :2] + x[0] * self.v_away[:, :2]) ** 2))
        return square / max(way, 1e-12) if x[0] > 0.0 else np.inf


def scale_by_no_slip(t_s: Array, p_camera: Array, away: Array, q: Array) -> ScaleEstimate | None:
    """Scale of a target that does not slip sideways; None where it is unobservable (a still camera).

    Parameters
    ----------
    t_s : (K,) evenly spaced times, s, 4 s or more
    p_camera : (K, 3) camera in the scene (z up), m
    away : (K, 3) camera to target, scene axes, up to scale
    q : (K, 4) orientation of the target in the scene; any body axes

    Raises
    ------
    DataError
        If the times span less than 4 s.
    """
    dt = float(np.median(np.diff(t_s)))
    if t_s[-1] - t_s[0] < 2.0 * _SMOOTH_S:
        raise DataError(f"{t_s[-1] - t_s[0]:.3g} s of poses: give at least {2.0 * _SMOOTH_S:g} s")
    length = 2 * round(0.5 * _SMOOTH_S / dt) + 1

    def smooth(x: Array, order: int) -> Array:
        return np.asarray(savgol_filter(x, length, 2, deriv=order, delta=dt, axis=0))

    # the target turns about the vertical; its axes at the start are those of the scene, up to the unknown angle
    turns = log(multiply(q[1:], conjugate(q[:-1])))[:, 2]
    psi = smooth(np.concatenate([[0.0], np.cumsum(turns)]), 0)
    step = max(1, round(_WINDOW_S / dt))
    whole = len(t_s) // step * step
    windows = _Windows(
        psi[:whole],
        np.gradient(psi, dt)[:whole],
        smooth(p_camera, 1)[:whole],
        smooth(away, 1)[:whole],
        np.arange(0, whole, step),
        dt,
    )
    grid = np.radians(np.arange(0.0, 180.0, 2.0))
    costs = np.array([windows.cost(a) for a in grid])
    if not np.isfinite(costs).any():
        return None
    best = grid[int(np.argmin(costs))]
    found = minimize_scalar(
        windows.cost, bounds=(best - 0.05, best + 0.05), method="bounded", options={"xatol": 1e-5}
    )
    return _judged(windows, float(found.x))


def _judged(windows: _Windows, a: float) -> ScaleEstimate | None:
    """Scale with its standard deviation, the angle's uncertainty included; None if it is not known from the data."""
    square, x, rows = windows.solve(a)
    h = 1e-4
    (_, _, low), (_, _, high) = windows.solve(a - h), windows.solve(a + h)
    right = [np.add.reduceat(_across(windows, a + e), windows.cells) * windows.dt for e in (-h, h)]
    slope = np.append((right[1] - right[0]) / (2.0 * h), 0.0) + (high - low) @ x / (2.0 * h)
    full = np.column_stack([rows, slope])
    size = np.linalg.norm(full, axis=0)
    if not (size > 0.0).all() or not x[0] > 0.0:
        return None
    information = (full / size).T @ (full / size)
    if np.linalg.cond(information) > 1e12:
        return None
    sd = float(np.sqrt(square / max(len(rows) - 3, 1) * np.linalg.inv(information)[0, 0])) / size[0]
    # x is solved for given a camera that moved: without that motion nothing but noise fixes it
    return ScaleEstimate(float(x[0]), float(sd)) if sd < _LEAST_CERTAIN * x[0] else None


def _across(windows: _Windows, a: float) -> Array:
    """``n^T p_c'`` (K,), m/s."""
    n = np.column_stack([-np.sin(windows.psi + a), np.cos(windows.psi + a)])
    return np.asarray(np.sum(n * windows.v_camera[:, :2], axis=1))


def scale_by_size(structure: Array, pair: tuple[int, int], length_m: float, sd_m: float) -> ScaleEstimate:
    """Scale from a known distance between two features.

    Raises
    ------
    DataError
        If the length is not positive.
    """
    if not length_m > 0.0:
        raise DataError(f"length_m {length_m!r}: give a length above zero")
    s = length_m / float(np.linalg.norm(structure[pair[0]] - structure[pair[1]]))
    return ScaleEstimate(s, s * sd_m / length_m)


def scale_by_height(
    below: Array, camera_height_m: float, height_m: float, sd_m: float
) -> ScaleEstimate | None:
    """Scale from a known height of a feature above the ground, and of the camera.

    Parameters
    ----------
    below : (K,) how far the feature is below the camera, along the vertical, up to scale
    camera_height_m, height_m : heights of camera and feature above the ground
    sd_m : standard deviation of their difference

    Returns
    -------
    ScaleEstimate or None
        None where camera and feature are about level: then their heights say nothing of the scale.
    """
    drop, mean = camera_height_m - height_m, float(np.mean(below))
    if abs(drop) < sd_m / _LEAST_CERTAIN or mean * drop <= 0.0:
        return None
    return ScaleEstimate(drop / mean, abs(sd_m / mean))
