"""Two smooth planar fields: a desired direction and speed at every point of the ground.

A field is asked for its `Guide` at a point: the direction, its gradient (which lets the robot's heading controller
follow without lag) and the speed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple, Protocol

from camnet.compiled import cached_njit
from camnet.motion.curve import ClosedCurve, frame_at, nearest_parameter
from camnet.types import Array

__all__ = [
    "LEAST_STRETCH",
    "SPEED_WAVES",
    "Guide",
    "LoopField",
    "PlanarField",
    "WaveField",
    "loop_guide",
    "loop_guide_at",
    "wave_guide",
]

#: how often the speed rises and falls once around a loop
SPEED_WAVES = 2
#: least value of 1 - kappa d: nearer to the centre of curvature the gradient is held
LEAST_STRETCH = 0.2
#: the wave's limit cycle lies about this fraction of its scale from the centre, and is this much three-cornered
_WAVE_RADIUS = 0.6
_WAVE_CORNERS = 0.5


class Guide(NamedTuple):
    """What a field wants at a point: direction (rad), its gradient (rad/m) and speed (m/s)."""

    direction: float
    gradient_x: float
    gradient_y: float
    speed: float


class PlanarField(Protocol):
    """A smooth field in the ground plane."""

    def guide(self, x: float, y: float) -> Guide:
        """Return what the field wants at (x, y), m."""


@dataclass(frozen=True, eq=False, slots=True)
class LoopField:
    """Circulates along a closed curve: the tangent, turned towards the curve by ``atan(attraction d)``.

    Attributes
    ----------
    curve : the closed curve
    speed_mps : mean speed
    attraction_per_m : how hard the field turns to the curve, per metre of offset
    modulation : the speed varies by this fraction, smoothly with the place along the curve
    """

    curve: ClosedCurve
    speed_mps: float
    attraction_per_m: float
    modulation: float

    def guide(self, x: float, y: float) -> Guide:
        """Return what the field wants at (x, y), m."""
        c = self.curve
        shape = (self.attraction_per_m, self.speed_mps, self.modulation)
        return Guide(*loop_guide(x, y, c.knots, c.coefficients, c.samples, c.sample_u, shape))


@dataclass(frozen=True, slots=True)
class WaveField:
    """A polynomial field with an unstable focus at the centre and a three-cornered limit cycle about it.

    With ``z`` the offset from the centre over ``scale_m``, as a complex number,
    ``F = (1 - |z|^2 / r^2) z + i z + e conj(z)^2``. Its only zero in ``|z| <= 1`` is the centre, since
    ``|(1 - |z|^2/r^2) z + i z| >= |z| > e |z|^2`` for e < 1; and it points inward on ``|z| = 1``, since
    ``1 - 1/r^2 + e < 0``. So every path but the centre's goes to a cycle (Poincare-Bendixson), inside; a robot
    that starts along the field follows such a path exactly.
    """

    center_m: tuple[float, float]
    scale_m: float
    speed_mps: float
    modulation: float

    def guide(self, x: float, y: float) -> Guide:
        """Return what the field wants at (x, y), m."""
        cx, cy = self.center_m
        return Guide(
            *wave_guide(
                (x - cx) / self.scale_m,
                (y - cy) / self.scale_m,
                self.scale_m,
                self.speed_mps,
                self.modulation,
            )
        )


@cached_njit
def loop_guide(
    x: float,
    y: float,
    knots: Array,
    coefficients: Array,
    samples: Array,
    sample_u: Array,
    shape: tuple[float, float, float],
) -> tuple[float, float, float, float]:
    """Guide of a loop at (x, y); shape: attraction, speed, modulation."""
    u = nearest_parameter(x, y, knots, coefficients, samples, sample_u)
    return loop_guide_at(u, x, y, knots, coefficients, shape)


@cached_njit
def loop_guide_at(
    u: float, x: float, y: float, knots: Array, coefficients: Array, shape: tuple[float, float, float]
) -> tuple[float, float, float, float]:
    """Guide of a loop at (x, y), whose nearest point on the curve is at ``u``; shape: attraction, speed, modulation.

    Returns
    -------
    tuple of float
        Direction, its gradient (2) and speed, as in `Guide`.
    """
    g, speed, modulation = shape
    cx, cy, phi, kappa = frame_at(u, knots, coefficients)
    tx, ty = math.cos(phi), math.sin(phi)
    d = tx * (y - cy) - ty * (x - cx)
    direction = phi - math.atan(g * d)
    # moving by ds along and dn across: d phi = kappa ds / (1 - kappa d), d d = dn
    along = kappa / max(1.0 - kappa * d, LEAST_STRETCH)
    across = -g / (1.0 + (g * d) ** 2)
    wave = 1.0 + modulation * math.sin(2.0 * math.pi * SPEED_WAVES * u / knots[-1])
    return direction, along * tx - across * ty, along * ty + across * tx, speed * wave


@cached_njit
def wave_guide(
    a: float, b: float, scale: float, speed: float, modulation: float
) -> tuple[float, float, float, float]:
    """Guide of a wave at the offset (a, b) from its centre over ``scale``: direction, gradient (2), speed."""
    r2 = _WAVE_RADIUS * _WAVE_RADIUS
    radial = 1.0 - (a * a + b * b) / r2
    f = radial * a - b + _WAVE_CORNERS * (a * a - b * b)
    g = radial * b + a - 2.0 * _WAVE_CORNERS * a * b
    f_a = radial - 2.0 * a * a / r2 + 2.0 * _WAVE_CORNERS * a
    f_b = -2.0 * a * b / r2 - 1.0 - 2.0 * _WAVE_CORNERS * b
    g_a = -2.0 * a * b / r2 + 1.0 - 2.0 * _WAVE_CORNERS * b
    g_b = radial - 2.0 * b * b / r2 - 2.0 * _WAVE_CORNERS * a
    square = max(f * f + g * g, 1e-12)
    wave = 1.0 + modulation * a
    return (
        math.atan2(g, f),
        (f * g_a - g * f_a) / square / scale,
        (f * g_b - g * f_b) / square / scale,
        speed * wave,
    )
