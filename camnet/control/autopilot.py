"""References, sliding mode and monitor of all agents as arrays, for worlds that let them fly in compiled code.

A world that is given an `Autopilot` asks it for nothing in between: `camnet.control.period_kernel` reads and writes its
arrays. The same, one object at a time, is in `camnet.simulation.loop`.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from camnet.control.monitor import DisturbanceMonitor
from camnet.control.references import ReferenceGenerator, ReferenceState
from camnet.control.sliding_mode import SlidingModeController
from camnet.types import Array

__all__ = ["Autopilot"]


class Autopilot:
    """What flies N agents between decisions.

    Parameters
    ----------
    references : `plain` ones
    controller : the law (4-6)
    monitor : is told every period
    state : of the references; its rows move on in place
    """

    def __init__(
        self,
        references: ReferenceGenerator,
        controller: SlidingModeController,
        monitor: DisturbanceMonitor,
        state: ReferenceState,
    ) -> None:
        self.monitor, self._references = monitor, references
        rows = state.rows
        self._goals, self._looks = np.zeros((len(rows), 3)), np.zeros((len(rows), 2))
        #: what `begin_flight` takes between the monitor's period and the world's arrays
        self.packed: tuple[Any, ...] = (
            rows,
            self._goals,
            self._looks,
            *references.packed,
            *controller.packed,
            *monitor.buffers,
        )

    def ask(self, p_world: Array, gaze_rad: Array) -> None:
        """Take setpoints: positions (N,3), m, and gazes (N,2), rad."""
        self._goals[...] = self._references.aim(p_world)
        self._looks[...] = gaze_rad
