"""Identities of bell2019, chapter 5, along smooth motions without noise, against numerical differentiation.

Camera and target turn about all axes. Directions and the quaternion are differentiated by fourth-order central
differences; the truth are the exact derivatives of the splines.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from camnet.estimation.structure.camera_path import CameraPath, forward_camera
from camnet.estimation.structure.geometry import distance_ratios, unit
from camnet.estimation.structure.moving import relations as rel
from camnet.estimation.structure.rates import optical_flow
from camnet.geometry import rotations as rot
from camnet.types import Array

__all__ = ["identity_errors"]

_T = np.linspace(0.0, 6.0, 13)
_STEP_S = 3e-4
_ARMS = np.array([[0.2, 0.1, 0.0], [-0.2, 0.15, 0.3], [0.1, -0.2, 0.2], [0.3, 0.0, -0.1]])


def _motions() -> tuple[CameraPath, CameraPath]:
    camera = CameraPath(
        _T,
        np.column_stack([0.2 * _T, np.sin(0.6 * _T), 0.2 * np.cos(0.9 * _T)]),
        rot.multiply(
            forward_camera(0.2 * np.sin(_T)), rot.exp(np.column_stack([0.2 * np.sin(_T), 0.1 * _T, 0.1 * _T]))
        ),
    )
    target = CameraPath(
        _T,
        np.column_stack([5.0 + np.sin(0.5 * _T), 0.3 * _T, 0.1 * np.sin(_T)]),
        rot.exp(np.column_stack([0.2 * np.sin(_T), 0.1 * _T, 0.3 * _T])),
    )
    return camera, target


def identity_errors() -> tuple[float, float]:
    """Largest error of the identities (relative to 1 m, 1 m/s, 1 rad/s), and the printed velocity's RMS error, m/s."""
    camera, target = _motions()

    def poses(t: float) -> tuple[Array, Array]:
        """Features (4, 3) in the camera frame and q_{m/c}."""
        c, b = camera.states(t), target.states(t)
        world = b.p_world[0] + rot.rotate(b.q_world[0], _ARMS)
        back = rot.conjugate(c.q_world[0])
        return rot.rotate(back, world - c.p_world[0]), rot.multiply(back, b.q_world[0])

    p_k, q_k = poses(0.0)
    u_k, d_k = unit(p_k)

    def measured(t: float) -> Array:
        """u_m1, u_mm, q_{m/c}: what is differentiated, (10,)."""
        p, q = poses(t)
        q_mc = rot.align_sign(rot.multiply(q, rot.conjugate(q_k)), np.array([1.0, 0.0, 0.0, 0.0]))
        u_mm = unit(rel.lever_position(p[0], rot.to_matrix(q_mc), p_k[0]))[0]
        return np.concatenate([unit(p[0])[0], u_mm, q_mc])

    worst, printed = 0.0, []
    for t in np.arange(0.75, 5.5, 0.5).tolist():
        p, _ = poses(t)
        now, rate = measured(t), _central(measured, t)
        u_1, u_mm, q_mc = now[:3], now[3:6], now[6:]
        r_mc = rot.to_matrix(q_mc)
        c, b = camera.states(t), target.states(t)
        v_c, w_c = c.v_cam[0], c.w_cam[0]
        back = rot.multiply(rot.conjugate(c.q_world[0]), b.q_world[0])
        w_true = rot.rotate(back, b.w_cam[0])
        v_true = rot.rotate(back, b.v_cam[0] + np.cross(b.w_cam[0], _ARMS[0]))
        w_m = rel.angular_velocity(q_mc, rate[6:], w_c)
        psi = distance_ratios(unit(p)[0], u_mm, r_mc, u_k)
        flows = (optical_flow(rate[:3], u_1, w_c), optical_flow(rate[3:6], u_mm, w_c))
        v, wrong = (
            rel.velocity_by_directions(
                (u_1, u_mm), flows, psi[0], (w_m, w_c, r_mc), u_k[0], float(d_k[0]), v_c, as_printed=x
            )
            for x in (False, True)
        )
        d_mm = np.linalg.norm(rel.lever_position(p[0], r_mc, p_k[0]))
        parts = [
            psi[:, 0] * d_k - np.linalg.norm(p, axis=1),
            psi[:, 1] * d_k - d_mm,
            rel.remaining_distance(psi[0], psi, float(d_k[0])) - d_k,
            w_m - w_true,
            v - v_true,
        ]
        worst = max(worst, *(float(np.abs(x).max()) for x in parts))
        printed.append(float(np.sum((wrong - v_true) ** 2)))
    return worst, float(np.sqrt(np.mean(printed)))


def _central(f: Callable[[float], Array], t: float) -> Array:
    h = _STEP_S
    return (8.0 * (f(t + h) - f(t - h)) - (f(t + 2 * h) - f(t - 2 * h))) / (12.0 * h)
