"""Unhurried approaches arrive in time and cost less; a target in view keeps its height for later."""

from __future__ import annotations

import numpy as np
import pytest

from camnet.control.references import ReferenceGenerator
from camnet.control.setpoints import Setpoint, at_ease, track
from camnet.control.settings import ControllerSettings
from camnet.geometry.settings import CameraModel, Intrinsics
from camnet.types import TargetEstimate

SETTINGS = ControllerSettings()
CAMERA = CameraModel(
    name="c",
    intrinsics=Intrinsics(width_px=640, height_px=480, fx_px=420, fy_px=420, cx_px=320, cy_px=240),
    near_m=0.3,
    far_m=8.0,
)


def fly(goal: np.ndarray, entry_s: float | None) -> tuple[np.ndarray, float]:
    """Fly the references from the origin towards a goal for ``entry_s``; end position and integral of v^2."""
    dt = 1.0 / SETTINGS.rate_hz
    generator = ReferenceGenerator(SETTINGS, [None], np.zeros(1), dt)
    state, effort = generator.start(np.zeros((1, 3))), 0.0
    length = 12.0 if entry_s is None else entry_s
    for k in range(round(length / dt)):
        if k % 6 == 0:
            wanted = Setpoint(goal, np.zeros(2))
            now = state.p_world[0].copy()
            target = wanted if entry_s is None else at_ease(wanted, now, SETTINGS, entry_s - k * dt)
        state = generator.step(state, target.p_world[None], target.gaze[None])
        reference = generator.reference(state)
        effort += dt * float((reference.v_world**2).sum())
    return state.p_world[0], effort


@pytest.mark.parametrize("entry_s", [3.0, 6.0, 12.0, 30.0])
def test_it_arrives_before_the_target_and_costs_less_than_haste(entry_s: float) -> None:
    goal = np.array([2.0, 1.0, 0.5])
    _, hasty = fly(goal, None)
    end, effort = fly(goal, entry_s)
    assert np.linalg.norm(end - goal) < 0.12
    share = {3.0: 1.05, 6.0: 0.8, 12.0: 0.4, 30.0: 0.2}[entry_s]  # the time left is the lever
    assert effort < share * hasty


def test_without_time_it_goes_straight() -> None:
    goal = Setpoint(np.array([2.0, 0.0, 0.0]), np.zeros(2))
    assert at_ease(goal, np.zeros(3), SETTINGS, 0.0) is goal


def test_a_target_in_view_is_tracked_without_diving() -> None:
    def estimate(seen: bool) -> TargetEstimate:
        zero = np.zeros(3)
        return TargetEstimate(
            t_s=0.0,
            p_world=zero,
            q_world=np.array([1.0, 0, 0, 0]),
            v_world=zero,
            w_body=zero,
            seen=seen,
            last_seen_s=0.0,
            region=0,
            radius_m=0.05,
        )

    camera_p = np.array([0.0, 0.0, 4.0])
    slow = track(estimate(True), None, CAMERA, SETTINGS, camera_p)
    fast = track(estimate(False), None, CAMERA, SETTINGS, camera_p)
    assert 0.0 < camera_p[2] - slow.p_world[2] < 0.2 < camera_p[2] - fast.p_world[2]
