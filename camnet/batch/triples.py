"""Circles and turns without a branch or a call: what loops over lanes need beside `camnet.geometry.triples`.

The test oracle is `camnet.geometry.rotations`; quaternions are w, x, y, z.
"""

from __future__ import annotations

import math

import numpy as np

from camnet.batch.compiled import inlined, outer
from camnet.geometry.triples import Quaternion, Triple

__all__ = [
    "AHEAD",
    "SMALL",
    "circle",
    "cosine_and_sine",
    "cross",
    "direction",
    "direction_ahead",
    "even_rotation_vector",
    "small_circle",
    "small_turn",
    "tanh",
    "turn",
]

#: up to this angle, rad, the series to the eighth power is exact to the last bit
SMALL = 0.1
#: up to this slope the series of a direction is
AHEAD = 0.2
#: 1 / n! with the series' signs
_1, _2, _3, _4, _5, _6, _7, _8 = ((-1.0) ** (n // 2) / math.factorial(n) for n in range(1, 9))
_9, _10, _11, _12, _13, _14, _15, _16 = ((-1.0) ** (n // 2) / math.factorial(n) for n in range(9, 17))
_17 = 1.0 / math.factorial(17)
#: 1 / n! and 1 / n
_E2, _E3, _E4, _E5, _E6, _E7, _E8 = (1.0 / math.factorial(n) for n in range(2, 9))
_E9, _E10, _E11, _E12, _E13 = (1.0 / math.factorial(n) for n in range(9, 14))
_T3, _T5, _T7, _T9, _T11, _T13 = (1.0 / n for n in range(3, 14, 2))
_T15, _T17, _T19, _T21, _T23, _T25, _T27 = (1.0 / n for n in range(15, 28, 2))
_T29, _T31, _T33, _T35, _T37, _T39, _T41 = (1.0 / n for n in range(29, 42, 2))
#: a quarter turn in two parts: whole multiples of the first are exact
_QUARTER = math.floor(math.ldexp(0.5 * math.pi, 32)) * 2.0**-32
_QUARTER_REST, _QUARTERS = (0.5 * math.pi - _QUARTER) + 6.123233995736766e-17, 2.0 / math.pi


@inlined
def cross(a: Triple, b: Triple) -> Triple:
    """Cross product."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@inlined
def small_circle(x: float) -> tuple[float, float]:
    """Cosine and sine of an angle of at most ``SMALL``."""
    s = x * x
    return 1.0 + s * (_2 + s * (_4 + s * (_6 + s * _8))), x * (1.0 + s * (_3 + s * (_5 + s * (_7 + s * _9))))


@inlined
def circle(x: float) -> tuple[float, float]:
    """Cosine and sine without a branch: of what is left of whole quarters, which are turned by exchange."""
    n = np.floor(x * _QUARTERS + 0.5)
    x = (x - n * _QUARTER) - n * _QUARTER_REST
    s = x * x
    c = 1.0 + s * (_2 + s * (_4 + s * (_6 + s * (_8 + s * (_10 + s * (_12 + s * (_14 + s * _16)))))))
    s = x + x * s * (_3 + s * (_5 + s * (_7 + s * (_9 + s * (_11 + s * (_13 + s * (_15 + s * _17)))))))
    quarter = n - 4.0 * np.floor(0.25 * n)
    odd = (quarter == 1.0) | (quarter == 3.0)
    along, across = s if odd else c, c if odd else s
    return (-along if (quarter == 1.0) | (quarter == 2.0) else along), (-across if quarter >= 2.0 else across)


@inlined
def tanh(x: float) -> float:
    """Hyperbolic tangent without a branch: e^y - 1 of a 128th of -2 |x|, doubled seven times."""
    y = min(abs(x), 20.0) * (-1.0 / 64.0)
    z = y * y
    u = z * z
    # in pairs and fours, which do not wait for each other
    low, middle = (1.0 + y * _E2) + z * (_E3 + y * _E4), (_E5 + y * _E6) + z * (_E7 + y * _E8)
    m = y * (low + u * (middle + u * ((_E9 + y * _E10) + z * (_E11 + y * _E12) + u * _E13)))
    for _ in range(7):
        m = m * (m + 2.0)
    t = -m / (2.0 + m)
    return -t if x < 0.0 else t


@inlined
def cosine_and_sine(x: float) -> tuple[float, float]:
    """Cosine and sine; the series where it is exact."""
    if abs(x) > SMALL:
        return math.cos(x), math.sin(x)
    return small_circle(x)


@inlined
def direction(y: float, x: float) -> float:
    """Angle of a vector, as atan2; the series where the vector lies about ahead."""
    if not abs(y) <= AHEAD * x:
        return math.atan2(y, x)
    return direction_ahead(y, x)


@inlined
def direction_ahead(y: float, x: float) -> float:
    """Angle of a vector of which abs(y) is at most ``AHEAD`` x."""
    t = y / x
    s = t * t
    z = s * s
    u = z * z
    first, second = (1.0 - s * _T3) + z * (_T5 - s * _T7), (_T9 - s * _T11) + z * (_T13 - s * _T15)
    return t * (first + u * (second + u * ((_T17 - s * _T19) + z * (_T21 - s * _T23))))


@inlined
def small_turn(x: float, y: float, z: float) -> Quaternion:
    """Quaternion of a rotation vector of at most twice ``SMALL``."""
    s = 0.25 * (x * x + y * y + z * z)
    scale = 0.5 * (1.0 + s * (_3 + s * (_5 + s * (_7 + s * _9))))
    return 1.0 + s * (_2 + s * (_4 + s * (_6 + s * _8))), scale * x, scale * y, scale * z


@outer
def turn(x: float, y: float, z: float) -> Quaternion:
    """Quaternion of a rotation vector, rad."""
    if x * x + y * y + z * z <= 4.0 * SMALL * SMALL:
        return small_turn(x, y, z)
    angle = math.sqrt(x * x + y * y + z * z)
    scale = math.sin(0.5 * angle) / angle
    return math.cos(0.5 * angle), scale * x, scale * y, scale * z


@inlined
def even_rotation_vector(q: Quaternion) -> Triple:
    """`camnet.geometry.triples.log` without a branch: tan(angle / 8) is at most 0.42, where the series holds."""
    a = math.sqrt(0.5 + 0.5 * abs(q[0]))  # cos(angle / 4)
    scale = 1.0 / (a + a * a)
    s = (q[1] * q[1] + q[2] * q[2] + q[3] * q[3]) * (0.25 * scale * scale)
    z = s * s
    u = z * z
    # in pairs and fours, which do not wait for each other
    first, second = (1.0 - s * _T3) + z * (_T5 - s * _T7), (_T9 - s * _T11) + z * (_T13 - s * _T15)
    third, fourth = (_T17 - s * _T19) + z * (_T21 - s * _T23), (_T25 - s * _T27) + z * (_T29 - s * _T31)
    fifth = (_T33 - s * _T35) + z * (_T37 - s * _T39) + u * _T41
    arc = first + u * (second + u * (third + u * (fourth + u * fifth)))
    scale *= -4.0 * arc if q[0] < 0.0 else 4.0 * arc
    return scale * q[1], scale * q[2], scale * q[3]
