"""Where the target is when it comes back into view: predictions across every gap of one run.

| predictor | what |
| --- | --- |
| ``hold`` | it stays where it was last seen |
| ``constant_velocity``, ``coordinated_turn`` | the filter's last velocity, or its last body twist, goes on |
| ``acceleration`` | the paper's predictor (corrected) on filtered poses: acceleration model by ICL |
| ``velocity_field`` | velocity as a function of place by ICL: the project's learning estimator on filtered poses |
| ``replay`` | the nearest smoothed earlier passages |

All see the same filtered states and know nothing of what comes after. The error is that of the position relative to the
camera, whose own pose is known then (from the background).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from camnet.estimation.basis import RbfBasis
from camnet.estimation.learning_estimator import LearningEstimator
from camnet.estimation.placement import grid_centres
from camnet.estimation.settings import EstimatorSettings, GapSettings
from camnet.estimation.structure.moving.acceleration import AccelerationModel, AccelerationSettings
from camnet.estimation.structure.moving.observer import CameraState, MotionObserver, ObserverGains
from camnet.estimation.structure.moving.replay import Replay, ReplaySettings
from camnet.estimation.structure.moving.twist_filter import TwistState, coast
from camnet.experiments.moving_target_run import SceneTracks, scene_truth
from camnet.experiments.moving_target_scene import MovingScene
from camnet.geometry.rotations import IDENTITY
from camnet.geometry.rotations_compiled import conjugate, multiply, rotate
from camnet.types import Array, CameraMotion, PoseMeasurement

__all__ = ["PREDICTORS", "Gap", "predict_gaps"]

PREDICTORS = ("replay", "velocity_field", "acceleration", "constant_velocity", "coordinated_turn", "hold")
#: where the target may be, scene frame, m: what the camera can see of it at its ranges
_BOX = np.array([[1.5, -3.5, -3.0], [8.5, 3.5, 3.0]])
_SPACING_M, _WIDTH_M, _KERNELS_M = 0.5, 0.5, 0.8
#: ways of a fork nearer than this are still one, m
_ONE_WAY_M = 0.1
_STILL = CameraMotion(np.zeros(3), IDENTITY.copy(), np.zeros(3), np.zeros(3))


@dataclass(frozen=True, eq=False, slots=True)
class Gap:
    """One gap.

    Attributes
    ----------
    start_s, span_s : when it began and how long it lasted, s
    lap : laps completed before it began
    error_m : by predictor, m
    nearest_m : error of the nearest of replay's futures, m
    futures : how many replay stated
    across_fork : the ways were one when the target went out of view and more than ``apart_m`` apart when it came back
    truth, predicted : (2,) true and replayed position in the ground plane, scene frame, m
    """

    start_s: float
    span_s: float
    lap: int
    error_m: Mapping[str, float]
    nearest_m: float
    futures: int
    across_fork: bool
    truth: Array
    predicted: Array


class FieldPredictor:
    """The project's learning estimator, fed with filtered poses."""

    def __init__(self, rate_hz: float) -> None:
        settings = EstimatorSettings(gap=GapSettings(prior="constant_turn"))
        basis = RbfBasis.create(grid_centres(_BOX[0], _BOX[1], _SPACING_M), _WIDTH_M**2)
        self._inner = LearningEstimator(settings, basis, 1, rate_hz, _BOX)
        self._dt = 1.0 / rate_hz

    def add(self, states: list[TwistState]) -> None:
        """Take in a stretch."""
        for s in states:
            self._inner.correct(PoseMeasurement(s.t_s, 0, 0, s.p, s.q, _STILL), 0)

    def after(self, t_s: float) -> Array:
        """Position (3,), m, predicted for a later time."""
        t = self._inner.estimate.t_s
        while t < t_s - 1e-9:
            t = min(t + self._dt, t_s)
            self._inner.predict(t)
        return self._inner.estimate.p_world


class AccelerationPredictor:
    """The paper's observer and predictor, fed with filtered poses and velocities."""

    def __init__(self, scene: MovingScene, tracks: SceneTracks) -> None:
        centres = grid_centres(_BOX[0], _BOX[1], _KERNELS_M)
        self._model = AccelerationModel(AccelerationSettings(), centres)
        self._scene, self._tracks = scene, tracks
        self._v, self._w = scene.odometry.at(scene.t_s)
        self._dt = float(scene.t_s[1] - scene.t_s[0])
        self._observer: MotionObserver | None = None

    def _camera(self, k: int) -> CameraState:
        return CameraState(self._tracks.p_camera[k], self._tracks.q_camera[k], self._v[k], self._w[k])

    def add(self, filtered: list[TwistState], smoothed: list[TwistState]) -> None:
        """Take in a stretch: the observer runs on filtered states, windows are formed of smoothed ones."""
        for s in filtered:
            k = int(np.searchsorted(self._scene.t_s, s.t_s - 1e-9))
            camera = self._camera(k)
            back = conjugate(camera.q_scene)
            p, q = rotate(back, s.p - camera.p_scene), multiply(back, s.q)
            if self._observer is None or s is filtered[0]:
                self._observer = MotionObserver(ObserverGains(), self._model, p, q, _velocities(s))
            else:
                self._observer.observe(self._dt, camera, p, q, _velocities(s))
        self._model.learn_stretch(
            np.array([s.t_s for s in smoothed]),
            np.array([s.p for s in smoothed]),
            np.array([_velocities(s) for s in smoothed]),
        )

    def after(self, start_s: float, end_s: float) -> Array:
        """Position (3,), m, scene frame, at the image at ``end_s``, unseen since ``start_s``."""
        assert self._observer is not None  # a stretch came before
        first, last = (int(np.searchsorted(self._scene.t_s, t - 1e-9)) for t in (start_s, end_s))
        for k in range(first, last):
            self._observer.predict(self._dt, self._camera(k))
        return self._observer.p_scene(self._camera(last))


def _velocities(s: TwistState) -> Array:
    """``[v; w]`` (6,), scene axes."""
    return np.concatenate([s.v_scene, rotate(s.q, s.w_body)])


def predict_gaps(
    scene: MovingScene,
    tracks: SceneTracks,
    parts: list[tuple[list[TwistState], list[TwistState]]],
    settings: ReplaySettings,
    rate_hz: float,
) -> list[Gap]:
    """Predict across the gap after every stretch but the last, in the order of time.

    Parameters
    ----------
    scene, tracks : truth, and the camera's measured poses
    parts : filtered and smoothed states of every seen stretch
    settings : of the replay
    rate_hz : of the images
    """
    relative, apart = scene_truth(scene)[0], scene.target.apart_m
    replay, field = Replay(settings), FieldPredictor(rate_hz)
    acceleration = AccelerationPredictor(scene, tracks)
    out = []
    for (filtered, smoothed), (after, _) in pairwise(parts):
        replay.add(smoothed)
        field.add(filtered)
        acceleration.add(filtered, smoothed)
        last, t_on = filtered[-1], after[0].t_s
        span = t_on - last.t_s
        k, off = (int(np.searchsorted(scene.t_s, t - 1e-9)) for t in (t_on, last.t_s))
        truth = relative[k] + tracks.p_camera[k]
        futures = replay.futures(span)
        predicted = {
            "replay": futures[0].p,
            "velocity_field": field.after(t_on),
            "acceleration": acceleration.after(last.t_s, t_on),
            "constant_velocity": last.p + span * last.v_scene,
            "coordinated_turn": coast(last, span)[0],
            "hold": last.p,
        }
        out.append(
            Gap(
                last.t_s,
                span,
                int(scene.target.lap[off]),
                {name: float(np.linalg.norm(p - truth)) for name, p in predicted.items()},
                min(float(np.linalg.norm(f.p - truth)) for f in futures),
                len(futures),
                bool(apart[off] < _ONE_WAY_M and apart[k] > settings.apart_m),
                truth[:2],
                futures[0].p[:2],
            )
        )
    return out
