"""Further predictors for the table of gaps: the remedies of the gap problem alone and combined, and variants.

| row | what it is |
| --- | --- |
| ``flow_printed`` | learned flow field as published: no prior mean, no learning across gaps |
| ``prior`` | remedy 1 alone: exit velocity that fades |
| ``flow_gaps`` | remedy 2 alone: integral windows across the gaps |
| ``flow_prior_gaps`` | remedies 1 and 2 |
| ``nearest_five`` | remedy 4 at its simplest: geometric median of the five nearest exits' entries |
| ``lessons_only`` | remedy 4 without the prior |
| ``lessons_flow`` | remedies 1, 2 and 4: the flow field is the prior of the lessons |
| ``lessons_mean``, ``lessons_median`` | the learned row, but mean or geometric median of the votes |
| ``one_way`` | the learned row without reversed crossings |
| ``now`` | the learned row told of what others taught until the re-sighting |

Remedy 3 (coordinates along roads) needs a road graph, which a site with recorded fixes alone does not have.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from camnet.estimation.crossing import (
    CrossingPredictor,
    CrossingSettings,
    ExitState,
    FlowField,
    GapPredictor,
    Lesson,
    Sighting,
)
from camnet.estimation.crossing.sightings import CrossingPrediction, only_camera
from camnet.types import Array

__all__ = ["remedy_rows"]

_SIMPLEST: dict[str, Any] = {
    "neighbours": 5,
    "bandwidth_floor": 1e9,
    "carry": 0.0,
    "same_target_bonus": 0.0,
    "recency_bonus": 0.0,
    "learn_reversed": False,
    "learn_extended": False,
    "prior_distance": None,
    "location": "geometric_median",
}


class _Untaught(CrossingPredictor):
    """The prior alone."""

    def learn(self, lesson: Lesson) -> None:
        """Learn nothing."""


class _FlowPrior:
    """Lessons whose prior is a flow field; another row teaches the field."""

    def __init__(self, settings: CrossingSettings, cameras: int, flow: FlowField) -> None:
        self._lessons = CrossingPredictor(settings, cameras, prior=flow.position)

    def predict(self, exit: ExitState, t_s: float) -> CrossingPrediction:
        """Predict from the lessons, with one vote of the flow field."""
        return self._lessons.predict(exit, t_s)

    def observe(self, before: Sighting, after: Sighting) -> None:
        """Nothing to learn here."""

    def learn(self, lesson: Lesson) -> None:
        """Learn the crossing."""
        self._lessons.learn(lesson)


class _WithoutPrior:
    """A flow field that another row teaches, predicting without its prior."""

    def __init__(self, flow: FlowField, cameras: int) -> None:
        self._flow = flow
        self._cameras = cameras

    def predict(self, exit: ExitState, t_s: float) -> CrossingPrediction:
        """Predict from the flow alone."""
        place = self._flow.position(exit, t_s, with_prior=False)
        return CrossingPrediction(place, float("inf"), only_camera(self._cameras, exit.camera), support=1.0)

    def observe(self, before: Sighting, after: Sighting) -> None:
        """Nothing to learn here."""

    def learn(self, lesson: Lesson) -> None:
        """Nothing to learn here."""


def remedy_rows(settings: CrossingSettings, cameras: int, bounds: Array) -> Mapping[str, GapPredictor]:
    """Predictors by row name; ``bounds`` (2, 2) are the corners of the ground in view, m."""

    def lessons(**changes: Any) -> CrossingPredictor:  # noqa: ANN401 - fields of the settings
        return CrossingPredictor(settings.model_copy(update=changes), cameras)

    printed = settings.flow.model_copy(update={"learn_across": False, "prior": False})
    flow = FlowField(settings.flow, cameras, bounds)
    return {
        "flow_printed": FlowField(printed, cameras, bounds),
        "prior": _Untaught(settings, cameras),
        "flow_gaps": _WithoutPrior(flow, cameras),
        "flow_prior_gaps": flow,
        "nearest_five": lessons(**_SIMPLEST),
        "lessons_only": lessons(prior_distance=None),
        "lessons_flow": _FlowPrior(settings, cameras, flow),
        "lessons_mean": lessons(location="mean"),
        "lessons_median": lessons(location="geometric_median"),
        "one_way": lessons(learn_reversed=False),
        "now": lessons(information="now"),
    }
