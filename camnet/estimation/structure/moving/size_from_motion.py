"""The size of a target that is followed, from the agent's own motion: sighting after sighting, while it goes on.

A target whose shape is known but not its size is read from an image as a pose up to scale: a structure g times as large
explains the same image from g times as far. `scale_by_no_slip` finds what makes it a wheeled target that does not slip
sideways; it needs a camera that moves otherwise than the target. Estimates of sightings are independent and joined by
their variances; the present sighting is looked at again every `EVERY_S` over all that was seen of it.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import replace

import numpy as np

from camnet.errors import DataError
from camnet.estimation.structure.moving.never_at_rest import ScaleEstimate, scale_by_no_slip
from camnet.geometry.rotations import multiply, rotate
from camnet.types import Array, PoseMeasurement

__all__ = ["SizeFromMotion"]

#: samples are taken, and the scale looked at again, so often, s; longest sighting that is looked at, s
SAMPLE_S, EVERY_S, LONGEST_S = 0.1, 2.0, 60.0
#: shortest sighting with a result, s
_SHORTEST_S = 8.0
_SAME_S = 1e-6
#: the least-squares' own standard deviation is not trusted below this share
_LEAST_SHARE = 0.002


class SizeFromMotion:
    """Scale of one target.

    Parameters
    ----------
    assumed : what measured poses are multiplied by until more is known
    """

    def __init__(self, assumed: float) -> None:
        self.assumed = assumed
        self._samples: deque[tuple[float, Array, Array, Array]] = deque(maxlen=round(LONGEST_S / SAMPLE_S))
        self._next_s = -math.inf
        self._information = self._sum = 0.0
        self._present: ScaleEstimate | None = None
        self._camera = -1
        #: sightings that gave a scale
        self.sightings = 0

    @property
    def estimate(self) -> ScaleEstimate | None:
        """Scale by all sightings, relative to what is assumed; None before the first result."""
        information, total = self._information, self._sum
        if self._present is not None:
            weight = 1.0 / max(self._present.sd, _LEAST_SHARE * self._present.scale) ** 2
            information, total = information + weight, total + weight * self._present.scale
        return ScaleEstimate(total / information, information**-0.5) if information > 0.0 else None

    @property
    def scale(self) -> float:
        """What the positions of measured poses are multiplied by."""
        found = self.estimate
        return self.assumed if found is None else self.assumed * found.scale

    @property
    def sd(self) -> float:
        """Standard deviation of the scale, as a share of it; inf before the first result."""
        found = self.estimate
        return math.inf if found is None else found.sd / found.scale

    def take(self, z: PoseMeasurement) -> PoseMeasurement:
        """Take a pose that was read as if the size were one; return it in the size that is known by now."""
        if z.camera != self._camera or (self._samples and z.t_s > self._samples[-1][0] + 2.0 * SAMPLE_S):
            self._close()
        self._camera = z.camera
        if not self._samples or z.t_s >= self._samples[-1][0] + SAMPLE_S - _SAME_S:
            away = rotate(z.motion.q_world, self.assumed * z.p_cam)
            q_world = multiply(z.motion.q_world, z.q_cam)
            self._samples.append((z.t_s, z.motion.p_world, away, q_world))
            self._look(z.t_s)
        return replace(z, p_cam=self.scale * z.p_cam)

    def _look(self, t_s: float) -> None:
        """Estimate the scale from the present sighting, if it is time."""
        if t_s - self._samples[0][0] < _SHORTEST_S or t_s < self._next_s:
            return
        self._next_s = t_s + EVERY_S
        t, p, away, q = (np.array(part) for part in zip(*self._samples, strict=True))
        try:
            self._present = scale_by_no_slip(t, p, away, q)
        except DataError:
            self._present = None

    def _close(self) -> None:
        """End a sighting: keep what it said."""
        if self._present is not None:
            weight = 1.0 / max(self._present.sd, _LEAST_SHARE * self._present.scale) ** 2
            self._information += weight
            self._sum += weight * self._present.scale
            self.sightings += 1
        self._present, self._next_s = None, -math.inf
        self._samples.clear()
