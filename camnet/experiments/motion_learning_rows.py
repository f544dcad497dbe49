"""The estimators of the motion-learning experiment side by side on one recording, and their errors.

| row | what |
| --- | --- |
| `learned` | our learning estimator, defaults but for the settings in `LEARNED_SETTINGS` |
| `learned_published` | settings and data rate of parikh2018, no remedies |
| `learned_published_fixed_sign` | the same, quaternions kept at q0 >= 0 |
| `ideal` | true velocities in place of the learned ones |
| `ekf`, `ukf` | constant velocity |
| `learned_image`, `ideal_image`, `ekf_image` | `learned`, `ideal` and `ekf`, fed by images of a marker |
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from camnet.estimation.basis import RbfBasis
from camnet.estimation.ekf import ConstantVelocityEKF
from camnet.estimation.ideal import IdealPredictor
from camnet.estimation.learning_estimator import LearningEstimator
from camnet.estimation.placement import grid_centres
from camnet.estimation.protocol import TargetFilter
from camnet.estimation.settings import BasisSettings, EkfSettings, EstimatorSettings, StackSettings
from camnet.estimation.ukf import ConstantVelocityUKF
from camnet.experiments.motion_learning_published import PublishedEstimator, published_basis
from camnet.experiments.motion_learning_scene import Recording, SceneSettings
from camnet.geometry.rotations import angle_between
from camnet.types import Array, BoolArray, PoseMeasurement, Twist

__all__ = [
    "IMAGE_ROWS",
    "LEARNED_SETTINGS",
    "ROWS",
    "Trace",
    "build_rows",
    "follow",
    "given_to",
    "learned_basis",
    "score",
]

ROWS = (
    "learned",
    "learned_image",
    "learned_published",
    "learned_published_fixed_sign",
    "ideal",
    "ideal_image",
    "ekf",
    "ekf_image",
    "ukf",
)
#: rows whose measurements are read from images
IMAGE_ROWS = tuple(name for name in ROWS if name.endswith("_image"))
#: half a side of the square in which the field lives, and beyond which no prediction goes
HALF_SIDE_M = 1.2
TRACKING_MARGIN_M = 0.6
#: errors count from here on (parikh2018: after the initial collection of data)
SCORED_FROM_S = 200.0
LEARNED_SETTINGS = EstimatorSettings(
    basis=BasisSettings(placement="grid", spacing_m=0.3, width_m=0.45, margin_m=0.0),
    stack=StackSettings(size=600, window_s=0.4, average=4, rule="d_optimal"),
)


@dataclass(frozen=True, eq=False, slots=True)
class Trace:
    """Estimates of one row at every frame: position (K, 3), orientation (K, 4)."""

    p_world: Array
    q_world: Array


def learned_basis(settings: BasisSettings) -> RbfBasis:
    """Grid over the square: 9 x 9 at the default spacing."""
    corner = np.full(2, HALF_SIDE_M + settings.margin_m)
    return RbfBasis.create(grid_centres(-corner, corner, settings.spacing_m), settings.width_m**2)


def build_rows(
    recording: Recording, scene: SceneSettings, learned: EstimatorSettings = LEARNED_SETTINGS
) -> dict[str, TargetFilter]:
    """One fresh estimator for each of `ROWS`."""
    half = HALF_SIDE_M + TRACKING_MARGIN_M
    bounds = np.array([[-half, -half, -0.5], [half, half, 0.5]])
    rate = scene.rate_hz
    noise = EkfSettings(
        position_noise_m=max(scene.position_noise_m, 1e-3),
        orientation_noise_rad=max(scene.orientation_noise_rad, 1e-3),
    )
    truth, basis = _truth(recording, rate), learned_basis(learned.basis)
    return {
        "learned": LearningEstimator(learned, basis, 1, rate, bounds),
        "learned_image": LearningEstimator(learned, basis, 1, rate, bounds, "learned_image"),
        "learned_published": PublishedEstimator(published_basis(), rate, bounds),
        "learned_published_fixed_sign": PublishedEstimator(
            published_basis(), rate, bounds, fixed_sign=True, name="learned_published_fixed_sign"
        ),
        "ideal": IdealPredictor(truth, learned, rate),
        "ideal_image": IdealPredictor(truth, learned, rate, "ideal_image"),
        "ekf": ConstantVelocityEKF(noise, rate),
        "ekf_image": ConstantVelocityEKF(noise, rate, "ekf_image"),
        "ukf": ConstantVelocityUKF(noise, rate),
    }


def _truth(recording: Recording, rate_hz: float) -> Callable[[float], Twist]:
    def twist(t_s: float) -> Twist:
        k = min(max(round(t_s * rate_hz), 0), len(recording.t_s) - 1)
        return Twist(recording.v_world[k], recording.w_body[k])

    return twist


def follow(
    recording: Recording, rows: Mapping[str, TargetFilter], progress: Callable[[float], None] | None = None
) -> dict[str, Trace]:
    """Run every estimator over the recording."""
    count = len(recording.t_s)
    traces = {name: Trace(np.full((count, 3), np.nan), np.full((count, 4), np.nan)) for name in rows}
    for k in range(count):
        t = float(recording.t_s[k])
        for name, row in rows.items():
            measurement = given_to(recording, name)[k]
            if measurement is None:
                row.predict(t)
            else:
                row.correct(measurement, 0)
            now = row.estimate
            traces[name].p_world[k], traces[name].q_world[k] = now.p_world, now.q_world
        if progress is not None and k % 600 == 0:
            progress(k / count)
    return traces


def given_to(recording: Recording, name: str) -> tuple[PoseMeasurement | None, ...]:
    """Return the measurements that row ``name`` gets."""
    return recording.images if name in IMAGE_ROWS else recording.measurements


def score(recording: Recording, trace: Trace, from_s: float = SCORED_FROM_S) -> dict[str, float]:
    """Root mean square errors from ``from_s`` on, over on and off periods together, and over the off ones alone."""
    late: BoolArray = recording.t_s >= from_s
    unseen = np.array([m is None for m in recording.measurements]) & late
    away = np.sum((trace.p_world - recording.p_world) ** 2, axis=1)
    turned = np.degrees(angle_between(trace.q_world, recording.q_world)) ** 2
    return {
        "position_rmse_m": float(np.sqrt(away[late].mean())),
        "orientation_rmse_deg": float(np.sqrt(turned[late].mean())),
        "position_rmse_unseen_m": float(np.sqrt(away[unseen].mean())) if unseen.any() else 0.0,
        "orientation_rmse_unseen_deg": float(np.sqrt(turned[unseen].mean())) if unseen.any() else 0.0,
    }
