"""What a sensing instant brings, where looking, measuring and estimating are one compiled call."""

from __future__ import annotations

from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np

from camnet.sensing.pose_sensor import PoseSensor
from camnet.sensing.survey import Lookout, Survey
from camnet.types import BoolArray, Snapshot

__all__ = ["Perceived", "Perceiver"]


class Perceived(NamedTuple):
    """What was found at one instant, target by target.

    Attributes
    ----------
    survey : who is where, and who sees whom
    camera : that measured the target (-1: none)
    miss_m : distance from the truth to what was predicted of it before the measurement, m (0 without one)
    errors : of the estimate after it, position, m, and orientation, rad; None: the target was never seen
    """

    survey: Survey
    camera: list[int]
    miss_m: list[float]
    errors: list[tuple[float, float] | None]


@runtime_checkable
class Perceiver(Protocol):
    """Estimators of all targets that can look and measure for themselves.

    They take over from lookout and sensor, with the same results, where nothing has to be asked in between: no sight
    lines, and no measurement that comes later.
    """

    def connect(self, lookout: Lookout, sensor: PoseSensor) -> None:
        """Take over looking and measuring."""
        ...

    def perceive(
        self, now: Snapshot, exceptions: BoolArray, working: BoolArray, rng: np.random.Generator
    ) -> Perceived:
        """Look at the truth, measure, and advance all estimators to now.

        Parameters
        ----------
        now, exceptions, working : see `camnet.sensing.survey.Lookout.look`
        rng : source of noise and drop-outs
        """
        ...
