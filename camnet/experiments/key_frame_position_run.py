"""One run of the key-frame experiment: key frames once, then every pose estimator on the same measurements.

| row | what |
| --- | --- |
| ``dead_reckoning`` | predictor with resets at the landmark |
| ``printed`` | observer and predictor of bell2019, section 4.4 |
| ``augmented`` | our filter: odometry's errors learned at landmarks and from the visual rotation of key frames |
| ``augmented_reuse`` | the same, with key frames kept and used again when their points are recognised on later loops |
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from camnet.estimation.structure.key_frames.augmented_filter import FilterEvents, FilterRun, run_filter
from camnet.estimation.structure.key_frames.pose_observer import (
    KeyFrameFeedback,
    Landmarks,
    observe_pose,
    predict_pose,
)
from camnet.experiments.key_frame_revisits import Recognise, find_revisits
from camnet.experiments.key_frame_setup import CorridorScene, SetUp
from camnet.experiments.key_frame_tracks import KeyFrameTracks
from camnet.experiments.key_frame_use import UsedKeyFrame, use_key_frames
from camnet.geometry.pinhole import Pinhole
from camnet.geometry.rotations import exp, from_matrix, multiply, to_matrix
from camnet.types import Array, BoolArray

__all__ = ["ROWS", "KeyFrameSummary", "PositionRun", "run_scene"]

ROWS = ("dead_reckoning", "printed", "augmented", "augmented_reuse")


@dataclass(frozen=True, slots=True)
class KeyFrameSummary:
    """One key frame: distance errors are 100 sum |error| / sum distance, RMS over its images, %.

    Attributes
    ----------
    usable : whether it passed its dwell time
    whole_pct, before_pct, after_pct : over its life, before and after it passed; NaN of what is not there
    turn_error, turn_sd : error of the visual rotation at its last image, and as stated, rad
    off_view : features that left the view and were predicted to its last image
    off_view_broken : how many of them are off by more than the sound bound of their growth
    off_view_share : largest share of that bound that one of them reached; NaN if there is none
    """

    usable: bool
    whole_pct: float
    before_pct: float
    after_pct: float
    turn_error: float
    turn_sd: float
    off_view: int
    off_view_broken: int
    off_view_share: float


@dataclass(frozen=True, eq=False, slots=True)
class PositionRun:
    """One run.

    Attributes
    ----------
    t_s, loop : (K,) times and loops
    truth_m : (K, 2) the true path
    path_m : by row (K, 2) estimated paths
    error_m : by row (K,) position errors
    landmark, usable : (K,) landmark in view, printed observer active
    key_frames : one summary each
    filters : the filters' runs, by row
    """

    t_s: Array
    loop: Array
    truth_m: Array
    path_m: Mapping[str, Array]
    error_m: Mapping[str, Array]
    landmark: BoolArray
    usable: BoolArray
    key_frames: tuple[KeyFrameSummary, ...]
    filters: Mapping[str, FilterRun]

    def rms(self, row: str) -> float:
        """Root mean square of a row's error over the run, m."""
        return float(np.sqrt(np.mean(self.error_m[row] ** 2)))

    def rms_after_first_loop(self, row: str) -> float:
        """Return the same from the second loop on; NaN of a run of one loop."""
        later = self.error_m[row][self.loop >= 1]
        return float(np.sqrt(np.mean(later**2))) if len(later) else float("nan")

    def maximum(self, row: str) -> float:
        """Mean over the loops of the largest error, m (bell2019's "average of the maximums")."""
        whole = [k for k in np.unique(self.loop) if not np.all(self.landmark[self.loop == k])]
        return float(np.mean([np.max(self.error_m[row][self.loop == k]) for k in whole]))


def run_scene(
    setup: SetUp, scene: CorridorScene, tracks: KeyFrameTracks, rng: np.random.Generator,
    recognise: Recognise | None = None,
    progress: Callable[[float], None] | None = None,
) -> dict[float, PositionRun]:  # fmt: skip
    """Run every estimator on one scene, at every gate of the set-up.

    Parameters
    ----------
    setup : gains and weights
    scene : truth and odometry
    tracks : its key frames
    rng : noise of the landmark's poses, and which points are recognised
    recognise : numbers (V,) and pixels (V, 2) of the points seen in an image, for revisits; None: no map reuse
    progress : told the share done

    Returns
    -------
    runs : one by the standard deviation of the printed gates, pixels
    """
    truth, v, w = scene.truth, scene.odometry.v_cam, scene.odometry.w_cam
    landmarks = _landmarks(setup, scene, rng)
    first = landmarks._replace(seen=np.arange(len(truth.t_s)) == 0)
    expected = predict_pose(truth.t_s, v, w, first)
    reckoned = predict_pose(truth.t_s, v, w, landmarks)
    by_gate = use_key_frames(setup, scene, tracks, expected, progress)
    seeds = rng.spawn(1)[0].bit_generator.state
    runs = {}
    for gate_px, used in by_gate.items():
        again = np.random.default_rng()
        again.bit_generator.state = seeds
        runs[gate_px] = _run(setup, scene, used, landmarks, reckoned, expected[1], recognise, again)
    return runs


def _run(
    setup: SetUp, scene: CorridorScene, used: list[UsedKeyFrame], landmarks: Landmarks, reckoned: tuple[Array, Array],
    q_expected: Array, recognise: Recognise | None, rng: np.random.Generator,
) -> PositionRun:  # fmt: skip
    """Every pose estimator on the same key frames."""
    truth, v, w = scene.truth, scene.odometry.v_cam, scene.odometry.w_cam
    feedback = _feedback(used, len(truth.t_s))
    printed = observe_pose(truth.t_s, v, w, landmarks, feedback, setup.k_p, setup.k_q)
    paths = {"dead_reckoning": reckoned[0][:, :2], "printed": printed[0][:, :2]}
    events = _events(used, q_expected, landmarks)
    filters = {"augmented": _filter(setup, scene, events)}
    if recognise is not None:
        again = find_revisits(setup, used, events, recognise, rng)
        filters["augmented_reuse"] = _filter(setup, scene, again)
    paths.update({name: run.pose[:, :2] for name, run in filters.items()})
    at = truth.p_world[:, :2]
    return PositionRun(
        truth.t_s, scene.loop, at, paths, {n: np.linalg.norm(x - at, axis=1) for n, x in paths.items()},
        scene.landmark, feedback.usable, tuple(_summary(setup, k, scene, q_expected) for k in used), filters,
    )  # fmt: skip


def _landmarks(setup: SetUp, scene: CorridorScene, rng: np.random.Generator) -> Landmarks:
    """Poses by the landmark: the true ones with noise on position and heading."""
    count = len(scene.truth.t_s)
    p = scene.truth.p_world.copy()
    p[:, :2] += setup.landmark_m * rng.standard_normal((count, 2))
    turn = np.zeros((count, 3))
    turn[:, 2] = setup.landmark_rad * rng.standard_normal(count)
    return Landmarks(scene.landmark, p, multiply(exp(turn), scene.truth.q_world))


def _feedback(used: list[UsedKeyFrame], count: int) -> KeyFrameFeedback:
    """Return what the printed observer reads."""
    number, usable = np.zeros(count, dtype=np.int64), np.zeros(count, dtype=bool)
    p_ck, q_ck = np.zeros((count, 3)), np.zeros((count, 4))
    for k, key in enumerate(used):
        r = key.record
        r_ck = np.swapaxes(r.r_kc, 1, 2)
        number[key.images], usable[key.images] = k, r.usable
        p_ck[key.images] = -np.einsum("tij,tj->ti", r_ck, r.u_kc) * r.d_kc[:, None]
        q_ck[key.images] = from_matrix(r_ck)
    return KeyFrameFeedback(number, usable, p_ck, q_ck)


def _events(used: list[UsedKeyFrame], q_expected: Array, landmarks: Landmarks) -> FilterEvents:
    """Landmarks and visual rotations; no revisits."""
    count = len(landmarks.seen)
    heading = _heading(landmarks.q_world)
    taken, turn, turn_sd = np.zeros(count, dtype=bool), np.full(count, np.nan), np.full(count, np.nan)
    for key in used:
        taken[key.images.start] = True
        last = key.images.stop - 1
        if last > key.images.start:
            by_gyro = _turned(q_expected[key.images])
            turn[last] = by_gyro + key.record.poses.turn[-1, 1]
            turn_sd[last] = key.record.poses.turn_sd[-1]
    return FilterEvents(
        landmarks.seen, np.column_stack([landmarks.p_world[:, :2], heading]), taken, turn, turn_sd,
        np.zeros(count, dtype=bool), np.full(count, -1), np.zeros((count, 3)), np.zeros((count, 3, 3)),
    )  # fmt: skip


def _heading(q_world: Array) -> Array:
    """Heading (K,) of the optical axis, rad, without jumps."""
    axis = to_matrix(q_world)[:, :2, 2]
    return np.unwrap(np.arctan2(axis[:, 1], axis[:, 0]))


def _turned(q_world: Array) -> float:
    """Turn of the optical axis over some images, rad."""
    heading = _heading(q_world)
    return float(heading[-1] - heading[0])


def _filter(setup: SetUp, scene: CorridorScene, events: FilterEvents) -> FilterRun:
    v, w = scene.odometry.v_cam, scene.odometry.w_cam
    return run_filter(
        scene.truth.t_s, np.ascontiguousarray(np.column_stack([v[:, 2], -v[:, 0]])), np.ascontiguousarray(-w[:, 1]),
        events, setup.filter_noise(),
    )  # fmt: skip


def _summary(setup: SetUp, key: UsedKeyFrame, scene: CorridorScene, q_expected: Array) -> KeyFrameSummary:
    images, r = key.images, key.record
    d = np.linalg.norm(key.tracked.points_world - scene.truth.p_world[images, None], axis=2)
    share = 100.0 * np.sum(np.abs(r.th[..., 0] - d) * r.alive, axis=1)
    share /= np.maximum(np.sum(d * r.alive, axis=1), 1e-9)
    since = int(np.argmax(r.usable)) if r.usable.any() else len(share)
    turn = _turned(q_expected[images]) - _turned(scene.truth.q_world[images]) + r.poses.turn[-1, 1]
    return KeyFrameSummary(
        bool(r.usable.any()), _rms(share), _rms(share[:since]), _rms(share[since:]), float(turn),
        float(r.poses.turn_sd[-1]), *_off_view(setup, key, scene),
    )  # fmt: skip


def _off_view(setup: SetUp, key: UsedKeyFrame, scene: CorridorScene) -> tuple[int, int, float]:
    """Hold features out of view against ``|e_d(t)| <= |p~(0)| + int (dv + dw d)``, with the odometry's true errors.

    It is the growth that `camnet.certification.bell_dwell.landmark_off_max_sound` bounds, for a single distance.
    """
    r, truth, odometry = key.record, scene.truth, scene.odometry
    lost = np.flatnonzero(r.alive[0] & ~r.alive[-1])
    if not len(lost):
        return 0, 0, math.nan
    last = np.sum(r.alive[:, lost], axis=0) - 1  # a lost feature does not come back
    first, end = key.images.start, key.images.stop
    to_camera = np.swapaxes(to_matrix(truth.q_world[first:end]), 1, 2)
    away = key.tracked.points_world[None, lost] - truth.p_world[first:end, None]
    point = np.einsum("tij,tnj->tni", to_camera, away)
    d = np.linalg.norm(point, axis=2)
    dv, dw = (
        np.linalg.norm(a[first:end] - b[first:end], axis=1)
        for a, b in ((odometry.v_cam, truth.v_cam), (odometry.w_cam, truth.w_cam))
    )
    growth = dv[:, None] + dw[:, None] * d
    dt = np.diff(truth.t_s[first:end], prepend=truth.t_s[first])
    # a period's velocities may differ from those at its ends: the larger of both ends
    step = dt[:, None] * np.maximum(growth, np.concatenate([growth[:1], growth[:-1]]))
    grown = np.cumsum(step, axis=0)
    number = np.arange(len(lost))
    u = Pinhole.from_settings(setup.world.camera).unproject(key.tracked.pixels[last, lost])
    start = np.linalg.norm(r.th[last, lost, 0][:, None] * u - point[last, number], axis=1)
    bound = start + grown[-1] - grown[last, number]
    error = np.abs(r.th[-1, lost, 0] - d[-1])
    share = error / bound
    return len(lost), int(np.sum(share > 1.0)), float(share.max())


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else float("nan")
