"""Vectors and quaternions as tuples of numbers, for loops in which an array would cost more than its arithmetic.

Names and meaning as in `camnet.geometry.rotations`, which is the test oracle; quaternions are w, x, y, z.
"""

from __future__ import annotations

import math

from camnet.batch.compiled import outer

__all__ = [
    "Quaternion",
    "Triple",
    "cosine_and_sine",
    "cross",
    "multiply",
    "rotate",
    "rotate_inverse",
    "rotation_vector",
    "size",
    "turn",
]

Triple = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
#: below this half angle, rad, the series to the eighth power is exact to the last bit
_SERIES = 0.1


@outer
def size(x: float, y: float, z: float) -> float:
    """Length of a vector."""
    return math.sqrt(x * x + y * y + z * z)


@outer
def cross(a: Triple, b: Triple) -> Triple:
    """Cross product."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@outer
def multiply(a: Quaternion, b: Quaternion) -> Quaternion:
    """Hamilton product ``a b``."""
    return (
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    )


@outer
def rotate(q: Quaternion, v: Triple) -> Triple:
    """``R(q) v``."""
    w, x, y, z = q
    tx, ty, tz = 2.0 * (y * v[2] - z * v[1]), 2.0 * (z * v[0] - x * v[2]), 2.0 * (x * v[1] - y * v[0])
    return v[0] + w * tx + y * tz - z * ty, v[1] + w * ty + z * tx - x * tz, v[2] + w * tz + x * ty - y * tx


@outer
def rotate_inverse(q: Quaternion, v: Triple) -> Triple:
    """``R(q)^T v``."""
    return rotate((q[0], -q[1], -q[2], -q[3]), v)


@outer
def cosine_and_sine(x: float) -> tuple[float, float]:
    """Cosine and sine; the series where it is exact."""
    if abs(x) > _SERIES:
        return math.cos(x), math.sin(x)
    s = x * x
    cosine = 1.0 - s / 2.0 * (1.0 - s / 12.0 * (1.0 - s / 30.0 * (1.0 - s / 56.0 * (1.0 - s / 90.0))))
    return cosine, x * (1.0 - s / 6.0 * (1.0 - s / 20.0 * (1.0 - s / 42.0 * (1.0 - s / 72.0))))


@outer
def turn(x: float, y: float, z: float) -> Quaternion:
    """Quaternion of a rotation vector, rad."""
    angle = math.sqrt(x * x + y * y + z * z)
    cosine, sine = cosine_and_sine(0.5 * angle)
    scale = sine / angle if angle > 1e-9 else 0.5
    return cosine, scale * x, scale * y, scale * z


@outer
def rotation_vector(q: Quaternion) -> Triple:
    """Rotation vector of the shorter turn, rad."""
    sign = -1.0 if q[0] < 0.0 else 1.0
    sine = math.sqrt(q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    cosine = sign * q[0]
    if sine < 1e-4:
        scale = 2.0 / (cosine if cosine != 0.0 else 1.0) * (1.0 - sine * sine / 3.0)
    else:
        scale = 2.0 * math.atan2(sine, cosine) / sine
    scale *= sign
    return scale * q[1], scale * q[2], scale * q[3]
