"""What a camera's uncertain pose adds to the world-frame position of a target that it measures."""

from __future__ import annotations

import math

import numpy as np

from camnet.geometry.rotations import rotate
from camnet.types import PoseMeasurement

__all__ = ["own_spread"]


def own_spread(z: PoseMeasurement) -> float:
    """Return what the camera's own pose adds to a target's position: SD of the worst direction, m; 0: none.

    ``p_m = p_c + R(th) r``: position and heading (through the lever r on the ground) together.
    """
    cov = z.motion.cov
    if cov is None:
        return 0.0
    lever = rotate(z.motion.q_world, z.p_cam)
    jacobian = np.array([[1.0, 0.0, -lever[1]], [0.0, 1.0, lever[0]]])
    return math.sqrt(max(float(np.linalg.eigvalsh(jacobian @ cov @ jacobian.T)[-1]), 0.0))
