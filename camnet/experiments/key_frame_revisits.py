"""Revisits of the key-frame experiment: which old key frame is seen again in an image, and the pose in its frame.

A key frame whose points are learned is kept where the map has none. In the first image of every later key frame its
points may be recognised, each with a stated probability; the key frame with most of them gives the pose.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from camnet.estimation.structure.key_frames.augmented_filter import FilterEvents
from camnet.estimation.structure.key_frames.map_pose import LevelPose, level_pose
from camnet.experiments.key_frame_setup import SetUp
from camnet.experiments.key_frame_use import UsedKeyFrame
from camnet.geometry.pinhole import Pinhole
from camnet.types import Array, IntArray

__all__ = ["Recognise", "find_revisits"]

#: numbers (V,) and pixels (V, 2) of the points seen in an image
Recognise = Callable[[int], tuple[IntArray, Array]]


def find_revisits(
    setup: SetUp, used: list[UsedKeyFrame], events: FilterEvents,
    recognise: Recognise, rng: np.random.Generator,
) -> FilterEvents:  # fmt: skip
    """Events with poses in the frames of old key frames; key frames of places not in the map are kept."""
    camera = Pinhole.from_settings(setup.world.camera)
    keep, revisit = events.keep.copy(), events.revisit.copy()
    pose, cov = events.revisit_pose.copy(), events.revisit_cov.copy()
    kept: dict[int, tuple[IntArray, Array]] = {}
    for k, key in enumerate(used):
        image = key.images.start
        ids, pixels = recognise(image)
        known = rng.random(len(ids)) < setup.recognised_share
        found = _best(setup, camera, kept, ids[known], pixels[known])
        if found is not None:
            revisit[image], pose[image], cov[image] = found[0], found[1].pose, found[1].cov
            continue
        learned = key.record.learned[-1]
        there = np.isfinite(learned)
        if np.sum(there) >= setup.least_recognised:
            points = camera.unproject(key.tracked.pixels[0, there]) * learned[there, None]
            kept[k] = (key.tracked.ids[there], points)
            keep[key.images.stop - 1] = True
    return events._replace(keep=keep, revisit=revisit, revisit_pose=pose, revisit_cov=cov)


def _best(
    setup: SetUp, camera: Pinhole, kept: dict[int, tuple[IntArray, Array]], ids: IntArray, pixels: Array
) -> tuple[int, LevelPose] | None:
    """Key frame with most points in common, and the pose in its frame."""
    best, most = -1, setup.least_recognised - 1
    for k, (numbers, _) in kept.items():
        common = int(np.sum(np.isin(numbers, ids)))
        if common > most:
            best, most = k, common
    if best < 0:
        return None
    numbers, points = kept[best]
    _, a, b = np.intersect1d(numbers, ids, return_indices=True)
    focal = float(np.mean(camera.focal))
    found = level_pose(
        points[a], camera.normalise(pixels[b]), setup.recognised_px / focal, setup.structure_sd,
        setup.structure_common_sd,
    )  # fmt: skip
    if found is None or found.inliers < setup.least_recognised // 2:
        return None
    return best, found
