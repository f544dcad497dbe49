r"""Where an unseen target can be: reachable sets of the planar target classes, each inside a disc at every time.

| class | set at tau | assumptions |
| --- | --- | --- |
| ``FreeReach`` | disc of radius e0 + v_max tau | speed at most v_max |
| ``HeadingReach`` | cone about n, n^T dp >= v_lo tau cos(theta), norm(dp) <= v_max tau | heading within theta |
| ``TubeReach`` | disc of radius e(tau) about the predicted path | the growth law of ``growth`` |

Road-bound targets have sets on the road graph, see ``road_gaps``. A set inside a view means that the target is seen
then, whatever it does; a set that misses a view means that it cannot be seen there (docs/theory.md, section 9).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from camnet.certification.coverage import Views
from camnet.certification.growth import Tube
from camnet.errors import CertificateError
from camnet.types import Array, BoolArray

__all__ = ["FreeReach", "HeadingReach", "PlanarView", "Reach", "TubeReach", "planar_view"]


class Reach(Protocol):
    """A target class after the target was lost at one place."""

    @property
    def name(self) -> str:
        """Name of the class, for reports."""
        ...

    def disc(self, tau_s: float) -> tuple[Array, float]:
        """Centre (2,) and radius of a disc that holds the target at ``tau_s``, m."""
        ...

    def contains(self, points: ArrayLike, tau_s: float) -> BoolArray:
        """Whether the target can be at points (..., 2) at ``tau_s``."""
        ...


@dataclass(frozen=True, eq=False)
class FreeReach:
    """Any motion with speed at most ``v_max_mps`` from within ``e0_m`` of ``position`` (2,)."""

    position: Array
    v_max_mps: float
    e0_m: float = 0.0
    name: str = "free"

    def disc(self, tau_s: float) -> tuple[Array, float]:
        """Return the reachable disc itself."""
        return self.position, self.e0_m + self.v_max_mps * tau_s

    def contains(self, points: ArrayLike, tau_s: float) -> BoolArray:
        """Whether the target can be at points (..., 2)."""
        away = np.linalg.norm(np.asarray(points, dtype=float) - self.position, axis=-1)
        return np.asarray(away <= self.e0_m + self.v_max_mps * tau_s)


@dataclass(frozen=True, eq=False)
class HeadingReach:
    """Motion whose heading stays within ``half_angle_rad`` of ``direction`` (2,) and whose speed in [v_lo, v_max].

    Raises
    ------
    CertificateError
        if the angle is not in [0, pi/2) or the speeds are out of order.
    """

    position: Array
    direction: Array
    half_angle_rad: float
    v_lo_mps: float
    v_max_mps: float
    e0_m: float = 0.0
    name: str = "heading-limited"

    def __post_init__(self) -> None:
        if not 0.0 <= self.half_angle_rad < 0.5 * math.pi:
            raise CertificateError(
                f"half_angle_rad = {self.half_angle_rad!r}: an angle in [0, pi/2) is needed"
            )
        if not 0.0 <= self.v_lo_mps <= self.v_max_mps:
            raise CertificateError(
                f"v_lo_mps = {self.v_lo_mps!r}, v_max_mps = {self.v_max_mps!r}: 0 <= v_lo <= v_max is needed"
            )

    @property
    def _axis(self) -> Array:
        return np.asarray(self.direction / np.linalg.norm(self.direction))

    def disc(self, tau_s: float) -> tuple[Array, float]:
        """Return a disc on the axis through the corners of the sector; they are its farthest points."""
        c, s = math.cos(self.half_angle_rad), math.sin(self.half_angle_rad)
        near, far = self.v_lo_mps * tau_s, self.v_max_mps * tau_s
        along = min(0.5 * (near + far) / c, far * c)
        radius = max(math.hypot(near * c - along, near * s), math.hypot(far * c - along, far * s))
        return self.position + along * self._axis, max(radius, far - along) + self.e0_m

    def contains(self, points: ArrayLike, tau_s: float) -> BoolArray:
        """Whether the target can be at points (..., 2); ``e0_m`` is taken as 0 here."""
        delta = np.asarray(points, dtype=float) - self.position
        along = delta @ self._axis
        length = np.linalg.norm(delta, axis=-1)
        c = math.cos(self.half_angle_rad)
        forward = (along >= self.v_lo_mps * tau_s * c - 1e-12) & (along >= length * c - 1e-12)
        return np.asarray(forward & (length <= self.v_max_mps * tau_s + 1e-12))


@dataclass(frozen=True, eq=False)
class TubeReach:
    """A learned field's prediction with its error bound; evaluated at the tube's own times."""

    tube: Tube
    name: str = "vector field"

    def disc(self, tau_s: float) -> tuple[Array, float]:
        """Return the disc at the nearest of the tube's times; beyond its end nothing is known."""
        t = self.tube.t_s
        k = int(np.argmin(np.abs(t - tau_s)))
        if abs(t[k] - tau_s) > 1e-9:
            raise CertificateError(
                f"tau_s = {tau_s!r} is not one of the tube's times; the nearest is {t[k]!r}"
            )
        return self.tube.centre_m[k], float(self.tube.radius_m[k])

    def contains(self, points: ArrayLike, tau_s: float) -> BoolArray:
        """Whether the target can be at points (..., 2)."""
        centre, radius = self.disc(tau_s)
        return np.asarray(np.linalg.norm(np.asarray(points, dtype=float) - centre, axis=-1) <= radius)


@dataclass(frozen=True, eq=False)
class PlanarView:
    """A view's cut with the target's plane, shrunk by the target's extent: half-planes ``normals p <= offsets``.

    ``normals`` (F, 2) are unit vectors. Level faces must leave room for the target: ``possible`` is False otherwise.
    """

    normals: Array
    offsets: Array
    possible: bool

    def depth(self, points: ArrayLike) -> Array:
        """Radius (...,) of the largest disc about points (..., 2) inside the view, m; negative outside."""
        if not self.possible:
            return np.full(np.shape(points)[:-1], -np.inf)
        return np.asarray((self.offsets - np.asarray(points, dtype=float) @ self.normals.T).min(axis=-1))


def planar_view(views: Views, camera: int, height_m: float, extent_m: float) -> PlanarView:
    """Cut one camera's view with the plane of the target's reference point."""
    normals = views.normals[camera]
    spare = views.offsets[camera] - extent_m - normals[:, 2] * height_m
    share = np.linalg.norm(normals[:, :2], axis=1)
    level = share < 1e-9
    possible = bool((spare[level] >= 0.0).all())
    return PlanarView(normals[~level, :2] / share[~level, None], spare[~level] / share[~level], possible)
