"""Geometry of a target that moves before a moving camera (bell2019, sections 5.1 and 5.2), corrected.

| symbol | name | shape | unit | equation |
| --- | --- | --- | --- | --- |
| ``p_{mi/c}``, ``p_{mi/k1}`` | ``p_mic``, ``p_mik`` | (..., 3) | m | feature i, camera frame now and at first sight |
| ``R_{m/c}``, ``q_{m/c}`` | ``r_mc``, ``q_mc`` | (..., 3, 3), (..., 4) | - | target's first frame to camera frame |
| ``v_m``, ``w_m`` | ``v_m``, ``w_m`` | (..., 3) | m/s, rad/s | of feature m1 and of the body, camera axes |
| ``p_{m/m}`` | ``lever_position`` | (..., 3) | m | ``p_{m1/c} - R_{m/c} p_{m1/k1}`` |
| ``w_m`` | ``angular_velocity`` | (..., 3) | rad/s | 5.2, ``2 R_{m/c} B^T(q_{m/c}) q'_{m/c} + w_c`` |
| ``v_m`` | ``target_velocity`` | (..., 3) | m/s | 5.2, ``chi^+ phi d_{m1/k1} + v_c`` |
| ``p'_{mi/c}`` | ``feature_rate`` | (..., 3) | m/s | ``v_m - v_c - w_c^x p + w_m^x R (p_{mi/k1} - p_{m1/k1})`` |
| ``d_{mi/k1}`` | ``remaining_distance`` | (...,) | m | ``(psi_1)_2 / (psi_i)_2 d_{m1/k1}``: both are ``d_{m/m}`` |
| | ``window_rates`` | (..., 2), (..., 2) | 1/s | integrands of the windows of section 5.2 |

``p_{m/m}`` is where the origin of the first camera frame would be if it moved with the target: the pair (target, its
first frame) is one rigid body, and psi of chapter 2 holds with ``u_{m/m}`` in place of ``u_{k/c}``.

Departure from print. The paper writes ``(w_m - w_c)^x R_{m/c} u`` in the rates of ``p_{mi}``, ``p_{m/m}``, in phi and
in the windows. Their left sides already hold ``-w_c^x p``; w_c is then counted twice, and ``w_m`` alone is right.
``as_printed`` in ``velocity_by_directions`` shows what that costs. Not stated in print: ``d_{m/m}`` must be above zero.
"""

from __future__ import annotations

import numpy as np

from camnet.estimation.structure.geometry import tangent, velocity_vector
from camnet.geometry.rotations import kinematic_matrix, to_matrix
from camnet.types import Array

__all__ = [
    "angular_velocity",
    "feature_rate",
    "lever_position",
    "remaining_distance",
    "target_velocity",
    "velocity_by_directions",
    "window_rates",
]


def _turn(r: Array, p: Array) -> Array:
    return np.asarray(np.squeeze(r @ np.asarray(p)[..., None], -1))


def lever_position(p_m1c: Array, r_mc: Array, p_m1k: Array) -> Array:
    """``p_{m/m} = p_{m1/c} - R_{m/c} p_{m1/k1}`` (..., 3), m, camera frame."""
    return np.asarray(p_m1c - _turn(r_mc, p_m1k))


def angular_velocity(q_mc: Array, q_rate: Array, w_cam: Array) -> Array:
    """``w_m = 2 R_{m/c} B^T(q_{m/c}) q'_{m/c} + w_c`` (..., 3), rad/s, camera axes.

    Parameters
    ----------
    q_mc, q_rate : (..., 4) unit quaternion, target's first frame to camera frame, and its rate, 1/s
    w_cam : (..., 3) angular velocity of the camera, camera frame, rad/s
    """
    body = 2.0 * _turn(np.swapaxes(kinematic_matrix(q_mc), -1, -2), q_rate)
    return _turn(to_matrix(q_mc), body) + w_cam


def target_velocity(u_m1: Array, u_mm: Array, phi: Array, d_m1k: Array | float, v_cam: Array) -> Array:
    """``v_m = chi^+ phi d_{m1/k1} + v_c`` (..., 3), m/s; not finite where the two directions are parallel.

    Parameters
    ----------
    u_m1, u_mm : (..., 3) unit vectors to the first feature and to ``p_{m/m}``, camera frame
    phi : (..., 6) ``velocity_vector``, 1/s
    d_m1k : (...,) distance of the first feature at first sight, m
    v_cam : (..., 3) velocity of the camera, camera frame, m/s

    Notes
    -----
    bell2019, section 5.2. ``chi^T chi = Lam_1 + Lam_m``, whose inverse is taken; Lam are projections, so ``chi^T phi``
    is ``Lam_1 phi_1 + Lam_m phi_m``.
    """
    lam_1, lam_m = tangent(u_m1), tangent(u_mm)
    right = _turn(lam_1, phi[..., :3]) + _turn(lam_m, phi[..., 3:])
    normal = lam_1 + lam_m
    parallel = np.abs(np.sum(u_m1 * u_mm, axis=-1)) >= 1.0
    safe = np.where(parallel[..., None, None], np.eye(3), normal)
    v = np.squeeze(np.linalg.solve(safe, right[..., None]), -1)
    return np.asarray(np.where(parallel[..., None], np.nan, v) * np.asarray(d_m1k)[..., None] + v_cam)


def velocity_by_directions(
    directions: tuple[Array, Array],
    flows: tuple[Array, Array],
    psi: Array,
    turns: tuple[Array, Array, Array],
    u_m1k: Array,
    d_m1k: Array | float,
    v_cam: Array,
    as_printed: bool = False,
) -> Array:
    """``v_m`` (..., 3), m/s, camera axes, from directions, their flows and the distance learned at rest.

    Parameters
    ----------
    directions : u_m1, u_mm, (..., 3) each
    flows : xi_m1, xi_mm, (..., 3) each, 1/s: ``u' + w_c^x u``
    psi : (..., 2) ``psi_{m1}``
    turns : w_m (..., 3), w_c (..., 3), rad/s, and R_{m/c} (..., 3, 3)
    u_m1k : (..., 3) direction of the first feature at first sight
    d_m1k, v_cam : see ``target_velocity``
    as_printed : with ``(w_m - w_c)`` in phi, for comparison; it is wrong
    """
    w_m, w_cam, r_mc = turns
    spin = w_m - w_cam if as_printed else w_m
    phi = velocity_vector(*flows, psi, directions[1], spin, r_mc, u_m1k)
    return target_velocity(*directions, phi, d_m1k, v_cam)


def feature_rate(p_mic: Array, motion: tuple[Array, Array], camera: tuple[Array, Array], arm: Array) -> Array:
    """``p'_{mi/c} = v_m - v_c - w_c^x p_{mi/c} + w_m^x arm`` (..., 3), m/s.

    Parameters
    ----------
    p_mic : (..., 3) the point on the target, camera frame, m
    motion : v_m, w_m (..., 3) in camera axes
    camera : v_c, w_c (..., 3) in camera axes
    arm : (..., 3) from feature m1 to the point, camera axes: ``R (p_{mi/k1} - p_{m1/k1})``; for ``p_{m/m}`` it is
        ``-R p_{m1/k1}``
    """
    (v_m, w_m), (v_cam, w_cam) = motion, camera
    return np.asarray(v_m - v_cam - np.cross(w_cam, p_mic) + np.cross(w_m, arm))


def remaining_distance(psi_1: Array, psi_i: Array, d_m1k: Array | float) -> Array:
    """``d_{mi/k1} = (psi_1)_2 / (psi_i)_2 d_{m1/k1}`` (...,), m: one frame teaches it, no window is needed."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(psi_1[..., 1] / psi_i[..., 1] * d_m1k)


def window_rates(
    directions: tuple[Array, Array], v_over_d: Array, w_m: Array, r_mc: Array, u_ik: tuple[Array, Array]
) -> tuple[Array, Array]:
    """Integrands a, b (..., 2), 1/s, of ``([psi_i] - int a) d_{mi/k1} = d_{m1/k1} int b`` over any window.

    Parameters
    ----------
    directions : u_mi, u_mm (..., 3)
    v_over_d : (..., 3) ``chi^+ phi``, 1/s
    w_m, r_mc : (..., 3) rad/s, (..., 3, 3)
    u_ik : u_{mi/k1}, u_{m1/k1} (..., 3)
    """
    u_mi, u_mm = directions
    with_i, with_1 = (np.cross(w_m, _turn(r_mc, u)) for u in u_ik)
    b = [np.sum(u * (v_over_d - with_1), axis=-1) for u in (u_mi, u_mm)]
    a = np.sum(u_mi * with_i, axis=-1)
    pair = np.broadcast_arrays(*b)
    return np.stack([a, np.zeros_like(a)], axis=-1), np.stack(pair, axis=-1)
