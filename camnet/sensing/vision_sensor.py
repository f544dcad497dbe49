"""Sensing at the levels of features and of images: the pose sensor's clock, drop-outs and latency around a reader.

For each frame, camera and target one seed is drawn whatever is visible; the reader of that view gets a generator of its
own from it, so two runs with one seed stay comparable when their views differ.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from camnet.geometry.settings import CameraModel
from camnet.sensing.pose_sensor import PoseSensor
from camnet.sensing.settings import SensingSettings
from camnet.types import BoolArray, CameraMotion, PoseMeasurement, Snapshot

if TYPE_CHECKING:
    from camnet.sensing.readers import Reader, Render

__all__ = ["VisionSensor", "build_sensor"]


class VisionSensor(PoseSensor):
    """Turns truth and visibility into poses read from images; the contract is the pose sensor's.

    Parameters
    ----------
    settings : rate, latency, drop-outs
    reader : what reads a pose from a view
    n_targets, n_cameras : M and C
    """

    def __init__(self, settings: SensingSettings, reader: Reader, n_targets: int, n_cameras: int) -> None:
        super().__init__(settings, n_targets, n_cameras)
        self._reader = reader

    def _take(self, snapshot: Snapshot, visible: BoolArray, rng: np.random.Generator) -> None:
        seeds = rng.integers(2**63, size=self._shape)
        kept = visible & (rng.random(self._shape) >= self._settings.dropout_probability)
        for c in np.flatnonzero(kept.any(axis=1)).tolist():
            motion = CameraMotion(
                snapshot.camera_p_world[c].copy(),
                snapshot.camera_q_world[c].copy(),
                snapshot.camera_v_world[c].copy(),
                snapshot.camera_w_cam[c].copy(),
            )
            for m in np.flatnonzero(kept[c]).tolist():
                pose = self._reader.read(snapshot, c, m, np.random.default_rng(seeds[c, m]))
                if pose is not None:
                    self._pending.append(PoseMeasurement(snapshot.t_s, c, m, pose.p, pose.q, motion))


def build_sensor(
    settings: SensingSettings,
    cameras: Sequence[CameraModel],
    features: Sequence[ArrayLike],
    render: Render | None = None,
) -> PoseSensor:
    """Sensor of the chosen level for C cameras and M targets with feature points (K, 3) each.

    ``render`` draws whole scenes; ``image`` with ``renderer: pybullet`` and ``image_tracker`` ask for it.

    Raises
    ------
    ConfigError
        The level cannot be had with these targets or settings.
    """
    size = (len(features), len(cameras))
    if settings.level == "pose":
        return PoseSensor(settings, *size)
    from camnet.sensing.readers import FeatureReader, ImageReader  # OpenCV, for these levels only

    if settings.level == "features":
        return VisionSensor(settings, FeatureReader(settings.features, cameras, features), *size)
    if settings.level == "image_tracker":
        from camnet.sensing.tracker_reader import TrackerReader

        return VisionSensor(settings, TrackerReader(settings.tracker, cameras, features, render), *size)
    return VisionSensor(settings, ImageReader(settings.image, cameras, features, render), *size)
