"""Time and measurement update of the constant-velocity filter, compiled, in place.

| symbol | name | shape |
| --- | --- | --- |
| p, q, v, w | ``p``, ``q``, ``v``, ``w`` | (3,), (4,), (3,), (3,) |
| P_p, P_q | ``cov_p``, ``cov_q`` | (2, 2), (6, 6) |

The same equations as ``ekf.predict_covariances``, ``ekf.update_position`` and ``ekf.update_orientation``, which stay
as the readable form and the oracle. The (6, 6) covariance is carried in 3 x 3 blocks A, B, C of (dtheta, dw):
``F = [R, dt I; 0, I]`` with R = exp(-dt w) gives A+ = R A R^T + dt (R B + (R B)^T) + dt^2 C, B+ = R B + dt C. The
update is Joseph's form (I - K H) P (I - K H)^T + r K K^T.
"""

from __future__ import annotations

import numpy as np

from camnet.compiled import cached_njit
from camnet.geometry.rotations_compiled import align_sign, conjugate, exp, log, multiply, normalise, to_matrix
from camnet.types import Array

__all__ = ["correct_state", "predict_state"]


@cached_njit
def predict_state(
    p: Array, q: Array, v: Array, w: Array, cov_p: Array, cov_q: Array, dt: float, rho_p: float, rho_q: float
) -> None:
    """Advance everything by ``dt``; densities of the unknown accelerations in m^2/s^3 and rad^2/s^3."""
    n0, n1 = dt**3 / 3.0, dt**2 / 2.0
    a, b, c = cov_p[0, 0], cov_p[0, 1], cov_p[1, 1]
    cov_p[0, 0] = a + 2.0 * dt * b + dt * dt * c + rho_p * n0
    cov_p[0, 1] = b + dt * c + rho_p * n1
    cov_p[1, 0] = cov_p[0, 1]
    cov_p[1, 1] = c + rho_p * dt
    turn = np.empty(3)
    for i in range(3):
        turn[i] = -dt * w[i]
    r = to_matrix(exp(turn))
    ra = np.zeros((3, 3))
    rb = np.zeros((3, 3))
    for i in range(3):
        for k in range(3):
            for j in range(3):
                ra[i, j] += r[i, k] * cov_q[k, j]
                rb[i, j] += r[i, k] * cov_q[k, 3 + j]
    for i in range(3):
        for j in range(3):
            rar = 0.0
            for k in range(3):
                rar += ra[i, k] * r[j, k]
            cov_q[i, j] = rar + dt * (rb[i, j] + rb[j, i]) + dt * dt * cov_q[3 + i, 3 + j]
    for i in range(3):
        for j in range(3):
            cov_q[i, 3 + j] = rb[i, j] + dt * cov_q[3 + i, 3 + j]
            cov_q[3 + j, i] = cov_q[i, 3 + j]
    for i in range(3):
        cov_q[i, i] += rho_q * n0
        cov_q[i, 3 + i] += rho_q * n1
        cov_q[3 + i, i] += rho_q * n1
        cov_q[3 + i, 3 + i] += rho_q * dt
        p[i] += dt * v[i]
        turn[i] = -turn[i]
    moved = normalise(multiply(q, exp(turn)))
    for i in range(4):
        q[i] = moved[i]


@cached_njit
def _inverse_3(m: Array) -> Array:
    """Inverse of a symmetric positive definite (3, 3) matrix by cofactors."""
    out = np.empty((3, 3))
    for i in range(3):
        i1, i2 = (i + 1) % 3, (i + 2) % 3
        for j in range(3):
            j1, j2 = (j + 1) % 3, (j + 2) % 3
            out[j, i] = m[i1, j1] * m[i2, j2] - m[i1, j2] * m[i2, j1]
    det = m[0, 0] * out[0, 0] + m[0, 1] * out[1, 0] + m[0, 2] * out[2, 0]
    for i in range(3):
        for j in range(3):
            out[i, j] /= det
    return out


@cached_njit
def correct_state(
    p: Array,
    q: Array,
    v: Array,
    w: Array,
    cov_p: Array,
    cov_q: Array,
    p_measured: Array,
    q_measured: Array,
    variance_p: float,
    variance_q: float,
) -> None:
    """Kalman update with a measured pose; variances of each axis in m^2 and rad^2."""
    s = cov_p[0, 0] + variance_p
    k0, k1 = cov_p[0, 0] / s, cov_p[1, 0] / s
    for i in range(3):
        e = p_measured[i] - p[i]
        p[i] += k0 * e
        v[i] += k1 * e
    cov_p[1, 1] -= k1 * cov_p[0, 1]
    cov_p[0, 0] *= 1.0 - k0
    cov_p[0, 1] *= 1.0 - k0
    cov_p[1, 0] = cov_p[0, 1]
    e_q = log(multiply(conjugate(q), align_sign(q_measured, q)))
    innovation = cov_q[0:3, 0:3].copy()
    for i in range(3):
        innovation[i, i] += variance_q
    inverse = _inverse_3(innovation)
    gain = np.zeros((6, 3))
    step = np.zeros(6)
    for i in range(6):
        for j in range(3):
            for k in range(3):
                gain[i, j] += cov_q[i, k] * inverse[k, j]
            step[i] += gain[i, j] * e_q[j]
    # (I - K H) P, then the same from the right, and r K K^T
    left = np.zeros((6, 6))
    for i in range(6):
        for j in range(6):
            left[i, j] = cov_q[i, j]
            for k in range(3):
                left[i, j] -= gain[i, k] * cov_q[k, j]
    for i in range(6):
        for j in range(i, 6):
            value = left[i, j]
            for k in range(3):
                value -= (left[i, k] - variance_q * gain[i, k]) * gain[j, k]
            cov_q[i, j] = value
            cov_q[j, i] = value
    turned = normalise(multiply(q, exp(step[0:3])))
    for i in range(4):
        q[i] = turned[i]
    for i in range(3):
        w[i] += step[3 + i]
