"""Vectors and quaternions as tuples of numbers, for kernels in which an array would cost more than its arithmetic.

Names and meaning as in `camnet.geometry.rotations_compiled`, the test oracle. What is decorated with `borrowing` makes
no array and returns none: it is compiled without the counting of references, which would be most of its code. What is
`inlined` becomes part of whatever calls it as well, so that loops over it become vector instructions.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, TypeVar

from camnet.compiled import cached_njit
from camnet.types import Array

__all__ = [
    "Matrix",
    "Quaternion",
    "Triple",
    "borrowing",
    "conjugate",
    "exp",
    "inlined",
    "into",
    "log",
    "matrix",
    "multiply",
    "norm",
    "out_of",
    "quaternion",
    "rotate",
    "rotate_inverse",
    "size",
    "triple",
]

Triple = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
#: rows
Matrix = tuple[Triple, Triple, Triple]

#: a division by zero gives what IEEE 754 says
_OPTIONS: dict[str, Any] = {"error_model": "numpy", "_nrt": False}
_SMALL = 1e-4

#: what is decorated keeps its type
_cached: Any = cached_njit
_Kernel = TypeVar("_Kernel", bound=Callable[..., object])


def borrowing(function: _Kernel) -> _Kernel:
    """Compile a function that makes no array and returns none."""
    compiled: _Kernel = _cached(**_OPTIONS)(function)
    return compiled


def inlined(function: _Kernel) -> _Kernel:
    """Compile the same as part of whatever calls it."""
    compiled: _Kernel = _cached(**_OPTIONS, forceinline=True)(function)
    return compiled


@borrowing
def triple(a: Array, n: int, k: int) -> Triple:
    """Three numbers from column ``k`` on of row ``n``."""
    return a[n, k], a[n, k + 1], a[n, k + 2]


@borrowing
def quaternion(a: Array, n: int, k: int) -> Quaternion:
    """Four numbers from column ``k`` on of row ``n``."""
    return a[n, k], a[n, k + 1], a[n, k + 2], a[n, k + 3]


@inlined
def size(x: float, y: float, z: float) -> float:
    """Length of a vector of three numbers."""
    return math.sqrt(x * x + y * y + z * z)


@inlined
def norm(v: Triple) -> float:
    """Length of a vector."""
    return size(v[0], v[1], v[2])


@inlined
def multiply(a: Quaternion, b: Quaternion) -> Quaternion:
    """Hamilton product ``a b``."""
    return (
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    )


@inlined
def conjugate(q: Quaternion) -> Quaternion:
    """Inverse of a unit quaternion."""
    return q[0], -q[1], -q[2], -q[3]


@inlined
def rotate(q: Quaternion, v: Triple) -> Triple:
    """``R(q) v``."""
    w, x, y, z = q
    tx, ty, tz = 2.0 * (y * v[2] - z * v[1]), 2.0 * (z * v[0] - x * v[2]), 2.0 * (x * v[1] - y * v[0])
    return v[0] + w * tx + y * tz - z * ty, v[1] + w * ty + z * tx - x * tz, v[2] + w * tz + x * ty - y * tx


@inlined
def rotate_inverse(q: Quaternion, v: Triple) -> Triple:
    """``R(q)^T v``."""
    return rotate(conjugate(q), v)


@borrowing
def log(q: Quaternion) -> Triple:
    """Rotation vector of the shorter turn, rad."""
    sign = -1.0 if q[0] < 0.0 else 1.0
    cosine = sign * q[0]
    sine = norm((q[1], q[2], q[3]))
    if sine < _SMALL:
        scale = 2.0 / (cosine if cosine != 0.0 else 1.0) * (1.0 - sine * sine / 3.0)
    else:
        scale = 2.0 * math.atan2(sine, cosine) / sine
    return sign * scale * q[1], sign * scale * q[2], sign * scale * q[3]


@borrowing
def exp(v: Triple) -> Quaternion:
    """Quaternion of a rotation vector, rad."""
    angle = norm(v)
    scale = 0.5 - angle * angle / 48.0 if angle < _SMALL else math.sin(0.5 * angle) / angle
    return math.cos(0.5 * angle), scale * v[0], scale * v[1], scale * v[2]


@inlined
def matrix(q: Quaternion) -> Matrix:
    """Rotation matrix."""
    w, x, y, z = q
    return (
        (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)),
        (2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)),
        (2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)),
    )


@inlined
def out_of(r: Matrix, v: Triple) -> Triple:
    """``r v``."""
    return (
        r[0][0] * v[0] + r[0][1] * v[1] + r[0][2] * v[2],
        r[1][0] * v[0] + r[1][1] * v[1] + r[1][2] * v[2],
        r[2][0] * v[0] + r[2][1] * v[1] + r[2][2] * v[2],
    )


@inlined
def into(r: Matrix, v: Triple) -> Triple:
    """``r^T v``."""
    return (
        r[0][0] * v[0] + r[1][0] * v[1] + r[2][0] * v[2],
        r[0][1] * v[0] + r[1][1] * v[1] + r[2][1] * v[2],
        r[0][2] * v[0] + r[1][2] * v[1] + r[2][2] * v[2],
    )
