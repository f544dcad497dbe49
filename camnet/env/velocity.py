"""Velocity commands of policies: limited in size, slope and direction, then straight to the world.

| symbol | meaning |
| --- | --- |
| v, w | commanded velocity and angular velocity (3,) of a camera, world axes, m/s and rad/s |
| v_max, a_max, w_max | the controller's limits for its references |
| tau | v_max / a_max, the time of a stop from top speed, s |
| P(x) | nearest point to x of the region shrunk by the margin |

Guard of the region: ``v = (P(p + tau v) - p) / tau``. For a half-space ``n.x <= b`` that holds the shrunk region, P
puts ``n.(p + tau v) <= b``, hence ``n.v <= (b - n.p) / tau``: the speed towards a face decays with the distance from
it at the rate 1/tau, which asks for at most v_max / tau = a_max, and a camera outside is led back. In a region that is
not convex the way to that point may leave it; the speed is then cut so that the point where it leaves is not reached
within tau.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from camnet.control.settings import ControllerSettings
from camnet.geometry.regions import BoxRegion, CylinderRegion, PolytopeRegion, Region
from camnet.geometry.rotations import conjugate, rotate
from camnet.types import Array, Snapshot
from camnet.world.protocol import CameraCommand

__all__ = ["VelocityPilot", "guarded", "limited"]

_CONVEX = (BoxRegion, CylinderRegion, PolytopeRegion)
_SAMPLES = np.linspace(0.0, 1.0, 17)[1:, None]


def limited(vectors: Array, largest: float) -> Array:
    """Shorten vectors (N,3) that are longer than ``largest``."""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.asarray(vectors * (largest / np.maximum(length, largest)))


def guarded(p_world: Array, v_world: Array, region: Region, margin_m: float, tau_s: float) -> Array:
    """Velocity (3,) nearest to ``v_world`` that keeps a camera at ``p_world`` (3,) in its region; see the module."""
    step = region.project(p_world + tau_s * v_world, margin_m) - p_world
    if not isinstance(region, _CONVEX):
        way = p_world + _SAMPLES * step
        outside = np.flatnonzero(region.signed_distance(way) > -0.5 * margin_m)
        if outside.size and region.signed_distance(p_world) < -0.5 * margin_m:
            step = step * (outside[0] / len(_SAMPLES))
    return np.asarray(step / tau_s)


class VelocityPilot:
    """Turns what policies ask for into the commands of every control period.

    Parameters
    ----------
    settings : limits of speed, acceleration and rotation, margin of the regions
    regions : of the N agents
    dt_s : control period
    guard : whether the regions are guarded
    """

    def __init__(
        self, settings: ControllerSettings, regions: Sequence[Region], dt_s: float, guard: bool
    ) -> None:
        self._settings, self._regions, self._dt_s, self._guard = settings, tuple(regions), dt_s, guard
        self._tau_s = settings.reference_v_max_mps / settings.reference_a_max_mps2
        self.reset()

    def reset(self) -> None:
        """Start at rest."""
        n = len(self._regions)
        self._asked_v, self._asked_w = np.zeros((n, 3)), np.zeros((n, 3))
        self._v, self._w = np.zeros((n, 3)), np.zeros((n, 3))

    def ask(self, shares: Array) -> None:
        """Take what policies want: shares (N,6) in [-1, 1] of the top speed and top angular velocity, world axes."""
        s = self._settings
        self._asked_v = limited(shares[:, :3] * s.reference_v_max_mps, s.reference_v_max_mps)
        self._asked_w = limited(shares[:, 3:] * s.reference_w_max_radps, s.reference_w_max_radps)

    def __call__(self, snapshot: Snapshot) -> CameraCommand:
        """Return the command of one control period."""
        s, dt, n = self._settings, self._dt_s, len(self._regions)
        before = self._v
        v = before + limited(self._asked_v - before, dt * s.reference_a_max_mps2)
        if self._guard:
            p = snapshot.camera_p_world
            v = np.array(
                [
                    guarded(p[j], v[j], region, s.region_margin_m, self._tau_s)
                    for j, region in enumerate(self._regions)
                ]
            )
        self._v = v
        self._w = self._w + limited(self._asked_w - self._w, dt * s.reference_w_acceleration_radps2)
        w_cam = rotate(conjugate(snapshot.camera_q_world[:n]), self._w)
        return CameraCommand(v, w_cam, limited((v - before) / dt, s.reference_a_max_mps2))
