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
        planes, plane_ends, discs, polygons, polygon_ends, margin, limits, gaze_limits, dt_s, yaw = (
            references.packed
        )
        gains, code = controller.packed
        truth, command, error, reference = monitor.buffers
        #: its part of a `camnet.control.period_kernel.Cockpit`, by name
        self.packed: dict[str, Any] = {
            "rows": rows,
            "goals": self._goals,
            "looks": self._looks,
            "planes": planes,
            "plane_ends": plane_ends,
            "discs": discs,
            "polygons": polygons,
            "polygon_ends": polygon_ends,
            "margin": margin,
            "limits": limits,
            "gaze_limits": gaze_limits,
            "dt_s": dt_s,
            "yaw": yaw,
            "gains": gains,
            "code": code,
            "truth": truth,
            "command": command,
            "error": error,
            "reference": reference,
        }

    def ask(self, p_world: Array, gaze_rad: Array) -> None:
        """Take setpoints: positions (N,3), m, and gazes (N,2), rad."""
        self._goals[...] = self._references.aim(p_world)
        self._looks[...] = gaze_rad
