"""Prediction across gaps that many targets cross: where, and by which camera, one will be seen again.

A target that leaves every camera's view (its *exit*) is seen again later (its *entry*). Each such crossing of anybody
is a lesson for the next: the predictor finds the lessons whose exits were like this one, lets each of them vote for a
place, and answers with the place that most of the votes are near. A single target's learned motion model knows only
roads that this target has walked; here everybody seen so far teaches everybody who comes.

Read next: ``settings`` (all options), ``sightings`` (the data), ``tracker`` (sightings to crossings and lessons),
``predictor`` (the learned predictor), ``neighbours`` and ``location`` (its two steps). Baselines are ``last_seen`` and
``constant_velocity``; ``flow_field`` is the concurrent-learning flow field with integral windows across the gaps.
``views`` decides which camera sees a point of the ground.
"""

from camnet.estimation.crossing.constant_velocity import FixFilter
from camnet.estimation.crossing.flow_field import FlowField
from camnet.estimation.crossing.last_seen import LastSeen
from camnet.estimation.crossing.predictor import CrossingPredictor
from camnet.estimation.crossing.settings import CrossingSettings, FixFilterSettings, FlowSettings
from camnet.estimation.crossing.sightings import (
    CrossingPrediction,
    EntryState,
    ExitState,
    GapPredictor,
    Lesson,
    Sighting,
)
from camnet.estimation.crossing.tracker import Crossing, CrossingTracker
from camnet.estimation.crossing.views import CameraViews

__all__ = [
    "CameraViews",
    "Crossing",
    "CrossingPrediction",
    "CrossingPredictor",
    "CrossingSettings",
    "CrossingTracker",
    "EntryState",
    "ExitState",
    "FixFilter",
    "FixFilterSettings",
    "FlowField",
    "FlowSettings",
    "GapPredictor",
    "LastSeen",
    "Lesson",
    "Sighting",
]
