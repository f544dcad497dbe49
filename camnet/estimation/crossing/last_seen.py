"""Baseline: a target stays where it was last seen, and the same camera sees it next."""

from __future__ import annotations

from camnet.estimation.crossing.sightings import (
    CrossingPrediction,
    ExitState,
    Lesson,
    Sighting,
    only_camera,
)

__all__ = ["LastSeen"]


class LastSeen:
    """Learns nothing.

    Parameters
    ----------
    cameras : number of cameras
    """

    def __init__(self, cameras: int) -> None:
        self._cameras = cameras

    def predict(self, exit: ExitState, t_s: float) -> CrossingPrediction:
        """Return the exit, whatever the time."""
        return CrossingPrediction(
            exit.p_world, float("inf"), only_camera(self._cameras, exit.camera), support=0.0
        )

    def observe(self, before: Sighting, after: Sighting) -> None:
        """Nothing to learn."""

    def learn(self, lesson: Lesson) -> None:
        """Nothing to learn."""
