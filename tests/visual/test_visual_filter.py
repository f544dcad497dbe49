"""Boxes as observations in the camera frame, and what feeding the prediction back is good for."""

from __future__ import annotations

import numpy as np
import pytest

from camnet.errors import DataError
from camnet.estimation.visual_filter import (
    VisualFilterSettings,
    VisualTrajectoryFilter,
    follow,
    nominal_intrinsics,
)
from camnet.sensing.visual import Box, CorrelationTracker, TrackResult

CAMERA = nominal_intrinsics(320, 240)


def test_observation_projects_back_to_the_box() -> None:
    settings = VisualFilterSettings(target_width_m=0.5)
    trajectory = VisualTrajectoryFilter(CAMERA, settings)
    box = Box(200.0, 60.0, 30.0, 45.0)
    place, _ = trajectory.observe(TrackResult(box, 1.0, 50.0))
    assert place[2] == pytest.approx(320.0 * 0.5 / 30.0)
    half = np.array([0.25, 0.0, 0.0])  # an object 0.5 m wide there spans the box
    left, right = place - half, place + half
    edges = [320.0 * p[0] / p[2] + 160.0 for p in (left, right)]
    assert edges == pytest.approx([200.0, 230.0])
    np.testing.assert_allclose(
        trajectory.update(TrackResult(box, 1.0, 50.0)).as_array(), box.as_array(), atol=1e-9
    )


def test_covariance_by_sampling() -> None:
    trajectory = VisualTrajectoryFilter(CAMERA, VisualFilterSettings(place_noise=0.004, width_noise=0.006))
    box, peak = Box(220.0, 40.0, 30.0, 45.0), 0.5
    _, covariance = trajectory.observe(TrackResult(box, peak, 50.0))
    rng = np.random.default_rng(0)
    samples = []
    for _ in range(4000):
        centre = box.centre + rng.normal(size=2) * 30.0 * 0.004 / peak
        width = 30.0 + rng.normal() * 30.0 * 0.006 / peak
        samples.append(trajectory.observe(TrackResult(Box.about(centre, width, 45.0), 1.0, 50.0))[0])
    sampled = np.cov(np.array(samples).T)
    scale = np.sqrt(np.outer(np.diag(covariance), np.diag(covariance)))
    assert np.max(np.abs(sampled - covariance) / scale) < 0.08
    assert np.linalg.eigvalsh(covariance)[0] > 0.0


def test_prediction_of_a_steady_target() -> None:
    """Constant velocity in the camera frame, given exactly: the prediction is the next box."""
    trajectory = VisualTrajectoryFilter(CAMERA)

    def box(k: int) -> Box:
        p = np.array([-1.0 + 0.03 * k, 0.2, 6.0 + 0.05 * k])
        return Box.about(320.0 * p[:2] / p[2] + [160.0, 120.0], 320.0 / p[2], 480.0 / p[2])

    for k in range(60):
        trajectory.update(TrackResult(box(k), 0.9, 50.0))
    expected = trajectory.predict()
    assert expected is not None
    np.testing.assert_allclose(expected.as_array(), box(60).as_array(), atol=0.5)
    smoothed = trajectory.smoothed()
    assert len(smoothed) == 60
    np.testing.assert_allclose(smoothed[40].as_array(), box(40).as_array(), atol=0.3)


@pytest.mark.parametrize("fed_back", [False, True])
def test_covered_target_is_found_again_only_with_the_prediction(scene, fed_back: bool) -> None:
    world = scene(velocity=(3.0, 0.0), start=(50.0, 120.0), occluder=(150, 210), size=(360, 240))
    camera = nominal_intrinsics(360, 240)
    tracker, trajectory = CorrelationTracker(), VisualTrajectoryFilter(camera)
    causal, lost = [], 0
    for k in range(75):
        image = world.image(k)
        if k == 0:
            result = tracker.start(image, Box.about(world.centre(0), 40.0, 60.0))
            box = trajectory.update(result)
        elif fed_back:
            result, box = follow(tracker, trajectory, image)
        else:
            result = tracker.update(image)
            box = trajectory.update(result)
        lost += result.psr < 15.0
        causal.append(np.linalg.norm(box.centre - world.centre(k)))
    assert lost > 5
    assert max(causal[:30]) < 3.0
    assert bool(result.psr > 15.0 and causal[-1] < 3.0) is fed_back


def test_start_needs_an_observation() -> None:
    with pytest.raises(DataError, match=r"psr 3\.0"):
        VisualTrajectoryFilter(CAMERA).update(TrackResult(Box(1, 1, 5, 5), 0.5, 3.0))
