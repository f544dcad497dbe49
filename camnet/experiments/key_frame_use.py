"""Key frames of one run, worked on at every gate."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from camnet.certification.bell_dwell import landmark_on_min_first
from camnet.errors import ConfigError
from camnet.estimation.structure.key_frames.key_frame import (
    KeyFrameMotion,
    KeyFrameRecord,
    measure_key_frame,
    observe_key_frame,
)
from camnet.experiments.key_frame_setup import CorridorScene, SetUp
from camnet.experiments.key_frame_tracks import KeyFrameTracks, TrackedKeyFrame
from camnet.geometry.pinhole import Pinhole
from camnet.types import Array

__all__ = ["UsedKeyFrame", "use_key_frames"]


@dataclass(frozen=True, eq=False, slots=True)
class UsedKeyFrame:
    """One key frame with its images' numbers and what was made of it."""

    images: slice
    tracked: TrackedKeyFrame
    record: KeyFrameRecord


def use_key_frames(
    setup: SetUp, scene: CorridorScene, tracks: KeyFrameTracks, expected: tuple[Array, Array],
    progress: Callable[[float], None] | None,
) -> dict[float, list[UsedKeyFrame]]:  # fmt: skip
    """Work on all key frames, at every gate."""
    s, camera = setup.key_frames, Pinhole.from_settings(setup.world.camera)
    focal = float(np.mean(camera.focal))
    first = landmark_on_min_first(s.lambda_a, s.k_x, s.distance_m[1], s.settled_m)
    if first.seconds is None:
        raise ConfigError(f"key_frames: no first dwell time: {first.reason}")
    settings = {gate: s.model_copy(update={"gate_px": gate}) for gate in setup.gates_px}
    used: dict[float, list[UsedKeyFrame]] = {gate: [] for gate in settings}
    for tracked in tracks:
        images = slice(tracked.first, tracked.first + len(tracked.seen))
        motion = KeyFrameMotion(
            scene.truth.t_s[images], expected[0][images], expected[1][images], scene.odometry.v_cam[images]
        )
        u_ic = camera.unproject(np.nan_to_num(tracked.pixels))
        track, poses = measure_key_frame(s, focal, motion, u_ic, tracked.seen)
        for gate, one in settings.items():
            record = observe_key_frame(one, first.seconds, focal, track, poses)
            used[gate].append(UsedKeyFrame(images, tracked, record))
        if progress is not None:
            progress(images.stop / len(scene.truth.t_s))
    return used
