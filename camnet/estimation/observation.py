"""From one camera's measurement to a target's pose in the world, for every estimator alike."""

from __future__ import annotations

import math

from camnet.compiled import cached_njit
from camnet.errors import DataError
from camnet.geometry.rotations_compiled import multiply, normalise, rotate
from camnet.types import Array, PoseMeasurement

__all__ = ["LOST_PERIODS", "measured_world_pose"]

#: a target is unseen once no measurement came for this many sensing periods: up to two frames in a row may be missed.
#: Were every missed frame a loss, no window of some ten frames would be whole where one frame in ten is dropped
LOST_PERIODS = 3.5


def measured_world_pose(measurement: PoseMeasurement) -> tuple[Array, Array]:
    """World position (3,) and orientation (4,) that a measurement and its camera's pose amount to.

    Raises
    ------
    DataError
        If the measurement is not finite.
    """
    m = measurement.motion
    p, q, finite = _compose(m.p_world, m.q_world, measurement.p_cam, measurement.q_cam)
    if not finite:
        raise DataError(
            f"measurement at {measurement.t_s} s of target {measurement.target}: pose {p}, {q} is not finite"
        )
    return p, q


@cached_njit
def _compose(p_camera: Array, q_camera: Array, p_cam: Array, q_cam: Array) -> tuple[Array, Array, bool]:
    p = rotate(q_camera, p_cam)
    q = normalise(multiply(q_camera, q_cam))
    total = 0.0
    for i in range(3):
        p[i] += p_camera[i]
        total += p[i]
    for i in range(4):
        total += q[i]
    return p, q, math.isfinite(total)
