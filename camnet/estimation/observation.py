"""From one camera's measurement to a target's pose in the world, for every estimator alike."""

from __future__ import annotations

import numpy as np

from camnet.errors import DataError
from camnet.geometry.rotations_compiled import multiply, normalise, rotate
from camnet.types import Array, PoseMeasurement

__all__ = ["LOST_PERIODS", "measured_world_pose"]

#: a target is unseen once no measurement came for this many sensing periods
LOST_PERIODS = 1.5


def measured_world_pose(measurement: PoseMeasurement) -> tuple[Array, Array]:
    """World position (3,) and orientation (4,) that a measurement and its camera's pose amount to.

    Raises
    ------
    DataError
        If the measurement is not finite.
    """
    m = measurement.motion
    p = m.p_world + rotate(m.q_world, measurement.p_cam)
    q = normalise(multiply(m.q_world, measurement.q_cam))
    if not (np.isfinite(p).all() and np.isfinite(q).all()):
        raise DataError(
            f"measurement at {measurement.t_s} s of target {measurement.target}: pose {p}, {q} is not finite"
        )
    return p, q
