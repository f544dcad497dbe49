"""Pose of a key frame from tracked directions, about the pose that odometry expects; with covariance.

| symbol | name | shape | unit | equation |
| --- | --- | --- | --- | --- |
| ``R_0``, ``u_0`` | ``r_expected``, ``u_expected`` | (T, 3, 3), (T, 3) | | pose of the key frame by odometry |
| ``phi``, ``a`` | ``turn``, ``shift`` | (T, 3), (T, 2) | rad | ``R = Exp(phi) R_0``, ``u = Exp(phi/2) u_0 + B a`` |
| ``e_i`` | | (T, N) | - | ``u_{i/c}^T (u x s_i)``, ``s_i = R u_{i/k}``: zero for a stationary point |
| ``var e_i`` | | (T, N) | - | ``sigma^2 (|u x s_i|^2 + |u x u_{i/c}|^2)`` |

Least squares over ``e_i`` and the prior ``phi ~ (0, diag(tilt, turn, tilt)^2)``, ``a ~ (0, direction^2)``, by three
Gauss-Newton steps with Huber weights. The direction turns with half of the correction of the rotation, as it does for a
gyro whose error is steady over the life of the key frame: what is left to ``a`` is small. sigma is the larger of the
stated noise and that of the residuals.

This stands for bell2019's several decompositions (section 4.6), of which those near the expected pose are averaged.
A decomposition from scratch is poor on walls, which are nearly planar; here the expected pose removes the ambiguity.
The prior on the turn about the vertical is wide, so that the result says what the images say and not the gyro.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from camnet.estimation.structure.key_frames.settings import RelativePoseSettings
from camnet.geometry.rotations import exp, to_matrix
from camnet.types import Array, BoolArray

__all__ = ["RelativePoses", "relative_poses"]

_STEPS, _HUBER = 3, 2.0


@dataclass(frozen=True, eq=False, slots=True)
class RelativePoses:
    """T relative poses.

    Attributes
    ----------
    turn : (T, 3) correction ``phi`` of the expected rotation, rad
    shift : (T, 3) ``u - Exp(phi/2) u_0``
    turn_sd : (T,) standard deviation of ``phi`` about the camera's y axis, rad
    noise : (T,) standard deviation of a direction by the residuals, rad
    """

    turn: Array
    shift: Array
    turn_sd: Array
    noise: Array


def relative_poses(
    u_ik: Array,
    u_ic: Array,
    seen: BoolArray,
    r_expected: Array,
    u_expected: Array,
    focal_px: float,
    settings: RelativePoseSettings,
) -> RelativePoses:
    """Poses of one key frame at T images.

    Parameters
    ----------
    u_ik, u_ic : (N, 3), (T, N, 3) directions in the key frame and in the images
    seen : (T, N) which of them are seen
    r_expected, u_expected : (T, 3, 3), (T, 3) expected rotation, key frame to camera, and direction of its origin
    focal_px : pixels a radian
    settings : noise and prior
    """
    s = settings
    count = len(u_ic)
    least = s.noise_px / focal_px
    u_ic = np.where(seen[..., None], u_ic, 0.0)
    basis = _basis(u_expected)
    prior = (
        np.array([s.tilt_sd_rad, s.turn_sd_rad, s.tilt_sd_rad, s.direction_sd_rad, s.direction_sd_rad]) ** -2
    )
    x, noise = np.zeros((count, 5)), np.full(count, least)
    normal = np.tile(np.diag(prior), (count, 1, 1))
    for _ in range(_STEPS):
        r, u = _pose(x, r_expected, u_expected, basis)
        e, rows, spread = _rows(u_ik, u_ic, r, u, basis)
        e, rows = e / spread, rows / spread[..., None]
        weight = seen * np.minimum(1.0, _HUBER * noise[:, None] / np.maximum(np.abs(e), 1e-12))
        share = np.sum(weight * e * e, axis=1) / np.maximum(np.sum(seen, axis=1) - 3.0, 1.0)
        noise = np.maximum(np.sqrt(share), least)
        scaled = weight / noise[:, None] ** 2
        normal = np.einsum("tn,tni,tnj->tij", scaled, rows, rows) + np.diag(prior)
        right = -np.einsum("tn,tn,tni->ti", scaled, e, rows) - prior * x
        x = x + np.linalg.solve(normal, right[..., None])[..., 0]
    shift = np.einsum("tij,tj->ti", basis, x[:, 3:])
    turn_sd = np.sqrt(np.linalg.inv(normal)[:, 1, 1])
    return RelativePoses(x[:, :3], shift, turn_sd, noise)


def _basis(u: Array) -> Array:
    """Two directions (T, 3, 2) across each unit vector (T, 3)."""
    away = np.eye(3)[np.argmin(np.abs(u), axis=1)]
    b = np.cross(u, away)
    b /= np.linalg.norm(b, axis=1, keepdims=True)
    return np.stack([b, np.cross(u, b)], axis=-1)


def _pose(x: Array, r_expected: Array, u_expected: Array, basis: Array) -> tuple[Array, Array]:
    half = to_matrix(exp(0.5 * x[:, :3]))
    u = np.einsum("tij,tj->ti", half, u_expected) + np.einsum("tij,tj->ti", basis, x[:, 3:])
    return to_matrix(exp(x[:, :3])) @ r_expected, u / np.linalg.norm(u, axis=1, keepdims=True)


def _rows(u_ik: Array, u_ic: Array, r: Array, u: Array, basis: Array) -> tuple[Array, Array, Array]:
    """``e`` (T, N), its derivatives (T, N, 5) in phi and a, and its standard deviation for sigma = 1 (T, N)."""
    s = np.einsum("tij,nj->tni", r, u_ik)
    u = np.broadcast_to(u[:, None], s.shape)
    across_s, across_c = np.cross(u, s), np.cross(u, u_ic)
    e = np.sum(u_ic * across_s, axis=-1)
    lever = np.cross(s, u_ic)
    by_turn = -np.cross(s, across_c) + 0.5 * np.cross(u, lever)
    by_shift = np.einsum("tni,tij->tnj", lever, basis)
    spread = np.sqrt(np.sum(across_s**2, axis=-1) + np.sum(across_c**2, axis=-1))
    return e, np.concatenate([by_turn, by_shift], axis=-1), np.maximum(spread, 1e-6)
