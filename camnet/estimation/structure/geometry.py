"""Distances and directions of points on something stationary, seen by a moving camera (bell2019, chapter 2).

| symbol | name | shape | unit | equation |
| --- | --- | --- | --- | --- |
| ``u_{i/c}``, ``u_{i/k}`` | ``u_ic``, ``u_ik`` | (..., 3) | - | direction of feature i, current and key frame |
| ``d_{i/c}``, ``d_{i/k}`` | ``d_ic``, ``d_ik`` | (...,) | m | its distance from the camera and from the key frame |
| ``u_{k/c}``, ``d_{k/c}`` | ``u_kc``, ``d_kc`` | (..., 3), (...,) | -, m | the same of the key frame's origin |
| ``R_{k/c}`` | ``r_kc`` | (..., 3, 3) | - | key frame to camera frame |
| ``M_i = [u_{i/c}, -u_{k/c}]`` | ``direction_matrix`` | (..., 3, 2) | - | 2.1, ``M [d_{i/c}; d_{k/c}] = R u d_{i/k}`` |
| ``lmin(M_i^T M_i)`` | ``excitation`` | (...,) | - | 2.1, ``1 - |u_{k/c}^T u_{i/c}|`` |
| ``psi_i`` | ``distance_ratios`` | (..., 2) | - | 2.1, ``(M^T M)^-1 M^T R_{k/c} u_{i/k}`` |
| ``ups_i`` | ``range_row`` | (..., 2) | - | 2.2, ``d_{i/c} = ups [d_{k/c}; d_{i/k}]``, for any motion |
| ``Lam = I - u u^T`` | ``tangent`` | (..., 3, 3) | - | projection on the plane across u |
| ``chi = [Lam_1; Lam_m]`` | ``velocity_matrix`` | (..., 6, 3) | - | 5.2, ``chi (v_m - v_c) = phi d_{m1/k1}`` |
| ``lmin(chi^T chi)`` | ``velocity_excitation`` | (...,) | - | ``1 - |u_{m1}^T u_{mm}|`` |
| ``phi`` | ``velocity_vector`` | (..., 6) | 1/s | 5.2, corrected: see below |

All vectors are in the current camera frame except ``u_{i/k}`` (key frame). ``M^T M = [[1, -c], [-c, 1]]`` with
``c = u_{i/c}^T u_{k/c}``: its eigenvalues are ``1 - |c|`` and ``1 + |c|`` and its inverse is written out, so psi costs
a few products and broadcasts. psi, and phi with it, is infinite where the camera moves along the line of sight.

``velocity_vector`` departs from print. The printed phi multiplies by ``(w_m - w_c)^x``; with
``p' = v_m - v_c - w_c^x p + ...`` that counts w_c twice, and ``w_m^x`` alone belongs there.
"""

from __future__ import annotations

import numpy as np

from camnet.types import Array

__all__ = [
    "direction_matrix",
    "distance_ratios",
    "excitation",
    "range_row",
    "tangent",
    "unit",
    "velocity_excitation",
    "velocity_matrix",
    "velocity_vector",
]


def _dot(a: Array, b: Array) -> Array:
    return np.asarray(np.sum(a * b, axis=-1))


def unit(p: Array) -> tuple[Array, Array]:
    """Return unit vectors (..., 3) and lengths (...,) of vectors (..., 3); NaN where there is no length."""
    d = np.linalg.norm(p, axis=-1)
    return p / np.where(d > 0.0, d, np.nan)[..., None], np.asarray(d)


def direction_matrix(u_ic: Array, u_kc: Array) -> Array:
    """``M_i = [u_{i/c}, -u_{k/c}]`` (..., 3, 2) of unit vectors (..., 3)."""
    return np.stack(np.broadcast_arrays(u_ic, -np.asarray(u_kc)), axis=-1)


def excitation(u_ic: Array, u_kc: Array) -> Array:
    """``lmin(M_i^T M_i) = 1 - |u_{k/c}^T u_{i/c}|`` (...,); the motion is informative where it exceeds lambda_a."""
    return np.asarray(1.0 - np.abs(_dot(u_ic, u_kc)))


def distance_ratios(u_ic: Array, u_kc: Array, r_kc: Array, u_ik: Array) -> Array:
    """``psi_i`` (..., 2) with ``[d_{i/c}; d_{k/c}] = psi_i d_{i/k}``; not finite without informative motion.

    Parameters
    ----------
    u_ic, u_kc : (..., 3) unit vectors to the feature and to the key frame's origin, camera frame
    r_kc : (..., 3, 3) rotation, key frame to camera frame
    u_ik : (..., 3) unit vector to the feature, key frame

    Notes
    -----
    bell2019, section 2.1.
    """
    seen = np.squeeze(r_kc @ u_ik[..., None], -1)
    c, a, b = _dot(u_ic, u_kc), _dot(u_ic, seen), _dot(u_kc, seen)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.stack([a - c * b, c * a - b], axis=-1) / (1.0 - c * c)[..., None])


def range_row(u_ic: Array, u_kc: Array, r_kc: Array, u_ik: Array) -> Array:
    """``ups_i = [u_{i/c}^T u_{k/c}, u_{i/c}^T R_{k/c} u_{i/k}]`` (..., 2): ``d_{i/c} = ups [d_{k/c}; d_{i/k}]``."""
    seen = np.squeeze(r_kc @ u_ik[..., None], -1)
    return np.stack(np.broadcast_arrays(_dot(u_ic, u_kc), _dot(u_ic, seen)), axis=-1)


def tangent(u: Array) -> Array:
    """``Lam = I - u u^T`` (..., 3, 3) of unit vectors (..., 3)."""
    return np.asarray(np.eye(3) - u[..., :, None] * u[..., None, :])


def velocity_matrix(u_m1: Array, u_mm: Array) -> Array:
    """``chi = [Lam_{m1}; Lam_{mm}]`` (..., 6, 3) of the directions (..., 3) of the first feature and of ``p_{m/m}``."""
    return np.concatenate([tangent(u_m1), tangent(u_mm)], axis=-2)


def velocity_excitation(u_m1: Array, u_mm: Array) -> Array:
    """``lmin(chi^T chi) = 1 - |u_{m1}^T u_{mm}|`` (...,): the velocity is observable where it is above zero."""
    return excitation(u_m1, u_mm)


def velocity_vector(
    xi_m1: Array, xi_mm: Array, psi: Array, u_mm: Array, w_m: Array, r_mc: Array, u_m1k: Array
) -> Array:
    """``phi`` (..., 6) in 1/s with ``chi (v_m - v_c) = phi d_{m1/k1}``, corrected.

    Parameters
    ----------
    xi_m1, xi_mm : (..., 3) optical flows ``u' + w_c^x u`` of the first feature and of ``p_{m/m}``, 1/s
    psi : (..., 2) ``psi_{m1}``
    u_mm : (..., 3) direction of ``p_{m/m}``, camera frame
    w_m : (..., 3) angular velocity of the target, camera frame, rad/s
    r_mc : (..., 3, 3) rotation, target's first frame to camera frame
    u_m1k : (..., 3) direction of the first feature in the first key frame
    """
    lever = np.cross(w_m, np.squeeze(r_mc @ u_m1k[..., None], -1))
    across = lever - u_mm * _dot(u_mm, lever)[..., None]
    return np.concatenate([xi_m1 * psi[..., :1], xi_mm * psi[..., 1:] + across], axis=-1)
