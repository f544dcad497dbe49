"""Rotations as unit quaternions: Hamilton product, scalar first, vectorised over leading dimensions.

| symbol | name here | shape | meaning |
| --- | --- | --- | --- |
| ``q = [q0, qv]`` | ``q`` | (..., 4) | ``R(q)`` maps vectors of the named frame into the reference frame |
| ``R(q)`` | ``to_matrix`` | (..., 3, 3) | rotation matrix |
| ``a^x`` | ``skew`` | (..., 3, 3) | ``a^x b = a x b`` |
| ``B(q)`` | ``kinematic_matrix`` | (..., 4, 3) | ``dq/dt = 1/2 B(q) w``, w in the body frame; ``B^T B = I`` |

Every function is plain NumPy and broadcasts; ``rotations_compiled`` has scalar-loop versions of the hot ones
under the same names, for single quaternions and for use inside other kernels.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from camnet.types import Array

__all__ = [
    "IDENTITY",
    "STRAIGHT_DOWN",
    "align_sign",
    "angle_between",
    "conjugate",
    "exp",
    "from_matrix",
    "from_yaw",
    "gaze_angles",
    "kinematic_matrix",
    "log",
    "look_at",
    "multiply",
    "nadir_gaze",
    "normalise",
    "rotate",
    "skew",
    "slerp",
    "to_matrix",
    "yaw_of",
]

#: the rotation that does nothing
IDENTITY: Array = np.array([1.0, 0.0, 0.0, 0.0])
#: camera to world of a camera that looks straight down: x_cam = x, y_cam = -y, z_cam = -z
STRAIGHT_DOWN: Array = np.array([0.0, 1.0, 0.0, 0.0])
IDENTITY.setflags(write=False)
STRAIGHT_DOWN.setflags(write=False)

#: below this angle (rad) the series of sinc and its inverse are exact to the last bit
_SMALL = 1e-4


def _float(a: ArrayLike) -> Array:
    return np.asarray(a, dtype=np.float64)


def multiply(a: ArrayLike, b: ArrayLike) -> Array:
    """Hamilton product ``a b`` (..., 4): first the rotation b, then a."""
    a, b = _float(a), _float(b)
    a0, a1, a2, a3 = a[..., 0], a[..., 1], a[..., 2], a[..., 3]
    b0, b1, b2, b3 = b[..., 0], b[..., 1], b[..., 2], b[..., 3]
    return np.stack(
        [
            a0 * b0 - a1 * b1 - a2 * b2 - a3 * b3,
            a0 * b1 + a1 * b0 + a2 * b3 - a3 * b2,
            a0 * b2 - a1 * b3 + a2 * b0 + a3 * b1,
            a0 * b3 + a1 * b2 - a2 * b1 + a3 * b0,
        ],
        axis=-1,
    )


def conjugate(q: ArrayLike) -> Array:
    """Inverse of a unit quaternion (..., 4)."""
    return np.asarray(_float(q) * np.array([1.0, -1.0, -1.0, -1.0]))


def normalise(q: ArrayLike) -> Array:
    """``q`` (..., 4) scaled to unit length; the sign is kept. A zero quaternion gives NaN."""
    q = _float(q)
    with np.errstate(invalid="ignore"):
        return np.asarray(q / np.linalg.norm(q, axis=-1, keepdims=True))


def skew(a: ArrayLike) -> Array:
    """Skew matrix ``a^x`` (..., 3, 3) of ``a`` (..., 3)."""
    a = _float(a)
    out = np.zeros((*a.shape[:-1], 3, 3))
    out[..., 0, 1], out[..., 0, 2] = -a[..., 2], a[..., 1]
    out[..., 1, 0], out[..., 1, 2] = a[..., 2], -a[..., 0]
    out[..., 2, 0], out[..., 2, 1] = -a[..., 1], a[..., 0]
    return out


def kinematic_matrix(q: ArrayLike) -> Array:
    """``B(q) = [-qv^T ; q0 I + qv^x]`` (..., 4, 3), so that ``dq/dt = 1/2 B(q) w_body`` (harris2020, ch. 2)."""
    q = _float(q)
    out = np.empty((*q.shape[:-1], 4, 3))
    out[..., 0, :] = -q[..., 1:]
    out[..., 1:, :] = q[..., 0, None, None] * np.eye(3) + skew(q[..., 1:])
    return out


def to_matrix(q: ArrayLike) -> Array:
    """Rotation matrix (..., 3, 3) of unit quaternions (..., 4)."""
    q = _float(q)
    w, x, y, z = q[..., 0], q[..., 1], q[..., 2], q[..., 3]
    out = np.empty((*q.shape[:-1], 3, 3))
    out[..., 0, 0] = 1.0 - 2.0 * (y * y + z * z)
    out[..., 0, 1] = 2.0 * (x * y - w * z)
    out[..., 0, 2] = 2.0 * (x * z + w * y)
    out[..., 1, 0] = 2.0 * (x * y + w * z)
    out[..., 1, 1] = 1.0 - 2.0 * (x * x + z * z)
    out[..., 1, 2] = 2.0 * (y * z - w * x)
    out[..., 2, 0] = 2.0 * (x * z - w * y)
    out[..., 2, 1] = 2.0 * (y * z + w * x)
    out[..., 2, 2] = 1.0 - 2.0 * (x * x + y * y)
    return out


def from_matrix(matrix: ArrayLike) -> Array:
    """Quaternions (..., 4), q0 >= 0, of rotation matrices (..., 3, 3).

    The four products ``4 q_i q`` are formed and the one with the largest ``q_i`` is kept, so there is no
    orientation at which digits are lost.
    """
    m = _float(matrix)
    trace = m[..., 0, 0] + m[..., 1, 1] + m[..., 2, 2]
    # rows of 4 q q^T
    k = np.empty((*m.shape[:-2], 4, 4))
    k[..., 0, 0] = 1.0 + trace
    for i in range(3):
        k[..., i + 1, i + 1] = 1.0 - trace + 2.0 * m[..., i, i]
    k[..., 0, 1] = k[..., 1, 0] = m[..., 2, 1] - m[..., 1, 2]
    k[..., 0, 2] = k[..., 2, 0] = m[..., 0, 2] - m[..., 2, 0]
    k[..., 0, 3] = k[..., 3, 0] = m[..., 1, 0] - m[..., 0, 1]
    k[..., 1, 2] = k[..., 2, 1] = m[..., 1, 0] + m[..., 0, 1]
    k[..., 1, 3] = k[..., 3, 1] = m[..., 2, 0] + m[..., 0, 2]
    k[..., 2, 3] = k[..., 3, 2] = m[..., 2, 1] + m[..., 1, 2]
    best = np.argmax(np.diagonal(k, axis1=-2, axis2=-1), axis=-1)
    q = normalise(np.take_along_axis(k, best[..., None, None], axis=-2)[..., 0, :])
    return np.where(q[..., :1] < 0.0, -q, q)


def rotate(q: ArrayLike, v: ArrayLike) -> Array:
    """``R(q) v`` (..., 3)."""
    q, v = _float(q), _float(v)
    t = 2.0 * np.cross(q[..., 1:], v)
    return np.asarray(v + q[..., :1] * t + np.cross(q[..., 1:], t))


def exp(rotvec: ArrayLike) -> Array:
    """Quaternion (..., 4) of rotation vectors (..., 3), rad."""
    r = _float(rotvec)
    angle = np.linalg.norm(r, axis=-1, keepdims=True)
    safe = np.where(angle < _SMALL, 1.0, angle)
    half_sinc = np.where(angle < _SMALL, 0.5 - angle * angle / 48.0, np.sin(0.5 * safe) / safe)
    return np.concatenate([np.cos(0.5 * angle), half_sinc * r], axis=-1)


def log(q: ArrayLike) -> Array:
    """Rotation vector (..., 3) of the shorter turn, length in [0, pi] rad; q and -q give the same."""
    q = _float(q)
    q = np.where(q[..., :1] < 0.0, -q, q)
    sine = np.linalg.norm(q[..., 1:], axis=-1, keepdims=True)
    cosine = q[..., :1]
    safe = np.where(sine < _SMALL, 1.0, sine)
    scale = np.where(
        sine < _SMALL,
        2.0 / np.where(cosine == 0.0, 1.0, cosine) * (1.0 - sine * sine / 3.0),
        2.0 * np.arctan2(sine, cosine) / safe,
    )
    return np.asarray(scale * q[..., 1:])


def align_sign(q: ArrayLike, reference: ArrayLike) -> Array:
    """``q`` or ``-q`` (..., 4), whichever is closer to ``reference``: to be done before any difference is formed."""
    q, reference = _float(q), _float(reference)
    return np.where(np.sum(q * reference, axis=-1, keepdims=True) < 0.0, -q, q)


def angle_between(a: ArrayLike, b: ArrayLike) -> Array:
    """Angle (...,) in [0, pi] rad of the turn from orientation a to b; signs of the quaternions do not matter."""
    d = multiply(conjugate(a), b)
    return np.asarray(2.0 * np.arctan2(np.linalg.norm(d[..., 1:], axis=-1), np.abs(d[..., 0])))


def from_yaw(psi: ArrayLike) -> Array:
    """Quaternion (..., 4) of a turn by ``psi`` rad about z."""
    half = 0.5 * _float(psi)
    zero = np.zeros_like(half)
    return np.stack([np.cos(half), zero, zero, np.sin(half)], axis=-1)


def yaw_of(q: ArrayLike) -> Array:
    """Heading (...,) in rad of the body x axis, seen from above."""
    q = _float(q)
    w, x, y, z = q[..., 0], q[..., 1], q[..., 2], q[..., 3]
    return np.asarray(np.arctan2(2.0 * (x * y + w * z), 1.0 - 2.0 * (y * y + z * z)))


def slerp(a: ArrayLike, b: ArrayLike, fraction: ArrayLike) -> Array:
    """Orientation (..., 4) at ``fraction`` (...,) of the shorter turn from a (fraction 0) to b (fraction 1)."""
    turn = log(multiply(conjugate(a), b))
    return multiply(a, exp(_float(fraction)[..., None] * turn))


def look_at(p_world: ArrayLike, point_world: ArrayLike) -> Array:
    """Camera-to-world quaternion (..., 4) of a camera at ``p_world`` that looks at ``point_world`` (..., 3).

    The camera's x axis is level and its y axis points down. Straight up and straight down, where that leaves
    the turn about the optical axis open, x_cam is the world's x axis.
    """
    z = _float(point_world) - _float(p_world)
    z = z / np.linalg.norm(z, axis=-1, keepdims=True)
    x = np.stack([z[..., 1], -z[..., 0], np.zeros_like(z[..., 0])], axis=-1)  # z_cam x z_world
    level = np.linalg.norm(x, axis=-1, keepdims=True)
    vertical = level < 1e-9
    x = np.where(vertical, np.array([1.0, 0.0, 0.0]), x / np.where(vertical, 1.0, level))
    y = np.cross(z, x)
    return from_matrix(np.stack([x, y, z], axis=-1))


def nadir_gaze(pan_rad: ArrayLike, tilt_rad: ArrayLike, yaw_rad: ArrayLike = 0.0) -> Array:
    """Camera-to-world quaternion (..., 4) of a camera that looks down, off the vertical by pan and tilt.

    The optical axis points along ``Rz(yaw) (tan pan, tan tilt, -1)``. The orientation is the smallest rotation
    that takes the straight-down camera (``STRAIGHT_DOWN``) there, then the turn by yaw: smooth everywhere below
    the horizon, at the nadir too.

    Parameters
    ----------
    pan_rad, tilt_rad : (...,) angles in (-pi/2, pi/2), towards world x and world y (before yaw)
    yaw_rad : (...,) turn about world z
    """
    d = np.stack(np.broadcast_arrays(np.tan(pan_rad), np.tan(tilt_rad), -1.0), axis=-1)
    d = d / np.linalg.norm(d, axis=-1, keepdims=True)
    # from a = (0, 0, -1) to d: [1 + a.d, a x d], normalised
    swing = np.stack([1.0 - d[..., 2], d[..., 1], -d[..., 0], np.zeros_like(d[..., 0])], axis=-1)
    return multiply(from_yaw(yaw_rad), multiply(normalise(swing), STRAIGHT_DOWN))


def gaze_angles(direction_world: ArrayLike, yaw_rad: ArrayLike = 0.0) -> tuple[Array, Array]:
    """Pan and tilt (...,) that make ``nadir_gaze`` look along ``direction_world`` (..., 3), of any length.

    Directions at or above the horizon have no such angles and give those of the horizon below them
    (+-pi/2, or 0 for a component that is zero).
    """
    yaw = _float(yaw_rad)
    d = _float(direction_world)
    c, s = np.cos(yaw), np.sin(yaw)
    x, y = c * d[..., 0] + s * d[..., 1], c * d[..., 1] - s * d[..., 0]
    down = np.maximum(-d[..., 2], 0.0)
    return np.arctan2(x, down), np.arctan2(y, down)
