r"""What a camera sees wherever its installer puts it: a frustum inside those of all poses within a tolerance.

| symbol | name | unit | meaning |
| --- | --- | --- | --- |
| delta | ``position_m`` | m | the optical centre is at most this far from its place |
| theta | ``angle_deg`` | degrees | the camera is turned by at most this, about any axis |
| n | ``sides`` | | outward unit normal of a side of the planned view |
| g(u) | ``room`` | | n . u + |u| tan(theta) |

Let u be a point seen from the planned centre. A side turned by at most theta has a normal within theta of n, and the
point is inside it for all of these, and for every shift of at most delta, where g(u) <= -delta / cos(theta). g is
convex and homogeneous, so that g <= 0 on a whole pyramid when it is at its four edges; and g(a + v) <= g(a) + g(v), so
that the pyramid may begin at any apex a with g(a) <= -delta / cos(theta): a point on the optical axis is taken.
Along the axis a point at depth z is at most T z off the axis, so that its depth in a turned and shifted camera is
between z (cos(theta) - T sin(theta)) - delta and z (cos(theta) + T sin(theta)) + delta, which moves near and far.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from camnet.errors import ConfigError
from camnet.geometry.frustum import Frustum
from camnet.types import Array

__all__ = ["MountTolerance", "held_frustum"]


@dataclass(frozen=True, slots=True)
class MountTolerance:
    """Largest installation error: of the optical centre, m, and of the orientation about any axis, degrees."""

    position_m: float
    angle_deg: float


def held_frustum(frustum: Frustum, position_m: float, angle_deg: float) -> Frustum | None:
    """Return what one camera sees at every pose within the tolerance, in the planned camera's frame; None: nothing.

    Its corners are those of a frustum that holds it.

    Parameters
    ----------
    frustum : of the planned pose, in the camera frame
    position_m, angle_deg : largest error of the optical centre, m, and of the orientation, degrees

    Raises
    ------
    ConfigError
        A tolerance is negative, or the angle is not below 45 degrees.
    """
    if not (position_m >= 0.0 and 0.0 <= angle_deg < 45.0):
        raise ConfigError(
            f"a mount's tolerance is {position_m:g} m, {angle_deg:g} degrees; at least 0 m, and 0 to below 45 degrees, "
            "were expected"
        )
    theta = math.radians(angle_deg)
    inner = _turned_inwards(frustum.tangents, theta)
    near, far = _range(frustum, position_m, theta)
    if not (inner[0] < inner[1] and inner[2] < inner[3] and near < far):
        return None
    rays = np.array([[x, y, 1.0] for x in inner[:2] for y in inner[2:]])
    sides = frustum.A[2:]
    room = rays @ sides.T + np.linalg.norm(rays, axis=1)[:, None] * math.tan(theta)
    least = float((-sides[:, 2]).min()) - math.tan(theta)
    if room.max() > 1e-12 or least <= 0.0:
        return None
    held = Frustum.from_tangents(inner, near, far)
    apex_m = position_m / (math.cos(theta) * least)
    return replace(held, b=held.b + np.r_[0.0, 0.0, apex_m * held.A[2:, 2]])


def _turned_inwards(tangents: Array, theta: float) -> Array:
    """Return the tangents of left, right, top, bottom turned inwards so far that the corners between them hold."""
    across = np.abs(tangents).reshape(2, 2).max(axis=1)[::-1].repeat(2)
    turn = np.arcsin(np.minimum(1.0, math.tan(theta) * np.sqrt(1.0 + across**2)))
    return np.asarray(np.tan(np.arctan(tangents) - np.array([-1.0, 1.0, -1.0, 1.0]) * turn))


def _range(frustum: Frustum, position_m: float, theta: float) -> tuple[float, float]:
    """Return near and far range of what is held."""
    t = np.abs(frustum.tangents)
    off_axis = math.hypot(float(t[:2].max()), float(t[2:].max()))
    nearer = math.cos(theta) - off_axis * math.sin(theta)
    if nearer <= 0.0:
        return math.inf, -math.inf
    worst = min(theta, math.atan(off_axis))
    further = math.cos(worst) + off_axis * math.sin(worst)
    near, far = frustum.range_m.tolist()
    return (near + position_m) / nearer, (far - position_m) / further
