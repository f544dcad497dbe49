"""Frame terms against numerical differentiation of simulated motion; the relative form against the world form."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from camnet.errors import ConfigError, DataError
from camnet.estimation.basis import RbfBasis
from camnet.estimation.feedback import relative_feedback, world_feedback
from camnet.estimation.frames import (
    known_part_camera_axes,
    known_part_world_axes,
    printed_known_part_world_axes,
)
from camnet.estimation.learning_estimator import LearningEstimator
from camnet.estimation.observation import measured_world_pose
from camnet.estimation.settings import EstimatorSettings
from camnet.geometry import rotations
from camnet.types import CameraMotion, PoseMeasurement

H = 1e-5
BOUNDS = np.array([[-20.0, -20.0, -5.0], [20.0, 20.0, 5.0]])


def _camera(t: float) -> tuple[np.ndarray, np.ndarray]:
    p = np.array([math.sin(0.8 * t), 0.5 * t, 2.0 + 0.3 * math.cos(t)])
    return p, rotations.exp(np.array([0.6 * t, 0.4 * math.sin(t), 0.3 * t]))


def _target(t: float) -> tuple[np.ndarray, np.ndarray]:
    p = np.array([2.0 * math.cos(0.5 * t), 2.0 * math.sin(0.4 * t), 0.1 * t])
    return p, rotations.exp(np.array([0.1 * t, 0.5 * math.cos(0.7 * t), 0.9 * t]))


def _motion(pose: Callable[[float], tuple[np.ndarray, np.ndarray]], t: float) -> tuple[np.ndarray, ...]:
    """Pose, world velocity and body rate by central differences."""
    (p0, q0), (p1, q1) = pose(t - H), pose(t + H)
    w = rotations.log(rotations.multiply(rotations.conjugate(q0), q1)) / (2 * H)
    return *pose(t), (p1 - p0) / (2 * H), w


def _relative(t: float, camera_axes: bool) -> np.ndarray:
    (pc, qc), (pm, qm) = _camera(t), _target(t)
    p = rotations.rotate(rotations.conjugate(qc), pm - pc) if camera_axes else pm - pc
    return np.concatenate((p, rotations.multiply(rotations.conjugate(qc), qm)))


@pytest.mark.parametrize("camera_axes", [True, False])
@pytest.mark.parametrize("t", [0.0, 0.7, 2.3])
def test_known_part_matches_numerical_differentiation(camera_axes: bool, t: float) -> None:
    _, qc, vc, wc = _motion(_camera, t)
    _, _, vm, wm = _motion(_target, t)
    eta = _relative(t, camera_axes)
    rate = (_relative(t + H, camera_axes) - _relative(t - H, camera_axes)) / (2 * H)
    own_turn = 0.5 * rotations.kinematic_matrix(eta[3:]) @ wm
    back = rotations.conjugate(qc)
    if camera_axes:
        f = known_part_camera_axes(eta[:3], eta[3:], rotations.rotate(back, vc), wc)
        own = np.concatenate((rotations.rotate(back, vm), own_turn))
    else:
        f = known_part_world_axes(eta[3:], vc, wc)
        own = np.concatenate((vm, own_turn))
    np.testing.assert_allclose(own + f, rate, atol=1e-8)


def test_the_printed_term_is_wrong_for_a_position_held_in_world_axes() -> None:
    t = 0.7
    _, qc, vc, wc = _motion(_camera, t)
    _, _, vm, _ = _motion(_target, t)
    eta = _relative(t, False)
    rate = (_relative(t + H, False) - _relative(t - H, False)) / (2 * H)
    wc_world = rotations.rotate(qc, wc)
    printed = printed_known_part_world_axes(eta[:3], eta[3:], vc, wc_world, wc)
    miss = rate[:3] - (vm + printed[:3])
    np.testing.assert_allclose(miss, np.cross(wc_world, eta[:3]), atol=1e-8)
    assert np.linalg.norm(miss) > 0.5


def test_relative_windows_minus_the_known_part_are_world_windows() -> None:
    """Deta - F over a window is the target's own displacement, whatever the camera did."""
    t = np.linspace(0.3, 0.9, 2001)
    f = np.array([known_part_world_axes(_relative(s, False)[3:], *_motion(_camera, s)[2:]) for s in t])
    known = np.sum(0.5 * (f[1:] + f[:-1]) * np.diff(t)[:, None], axis=0)
    increment = _relative(0.9, False) - _relative(0.3, False)
    np.testing.assert_allclose((increment - known)[:3], _target(0.9)[0] - _target(0.3)[0], atol=1e-6)


def _camera_motion(t: float) -> CameraMotion:
    return CameraMotion(*_motion(_camera, t))


def test_both_forms_take_the_same_step() -> None:
    """In the limit of small steps the relative form is the world form seen from the camera."""
    s = EstimatorSettings(k2=0.0)
    dt, t = 1e-3, 0.5
    p, q = _target(t)
    p_hat, q_hat = p + 0.1, rotations.multiply(q, rotations.exp([0.05, -0.02, 0.1]))
    twist = np.array([0.3, 0.1, -0.2, 0.2, 0.5, -0.4])
    now_p, now_q = _target(t + dt)
    arguments = (p_hat, q_hat, twist, dt, now_p, now_q, _camera_motion(t), _camera_motion(t + dt), s)
    world, relative = world_feedback(*arguments), relative_feedback(*arguments)
    np.testing.assert_allclose(relative.p, world.p, atol=1e-6)
    np.testing.assert_allclose(rotations.align_sign(relative.q, world.q), world.q, atol=1e-6)
    np.testing.assert_allclose(relative.error, world.error, atol=1e-6)
    assert np.linalg.norm(world.p - p_hat) > 1e-4


def _track(frame: str, moving: bool) -> np.ndarray:
    """World positions estimated from exact measurements with a moving or a still camera."""
    basis = RbfBasis.create(np.array([[0.0, 0.0], [1.0, 1.0]]), 0.5)
    estimator = LearningEstimator(EstimatorSettings(frame=frame), basis, 1, 30.0, BOUNDS)
    out = []
    for k in range(150):
        t = k / 30
        (pm, qm), camera = _target(t), _camera_motion(t if moving else 0.0)
        if not moving:
            camera = CameraMotion(camera.p_world, camera.q_world, np.zeros(3), np.zeros(3))
        back = rotations.conjugate(camera.q_world)
        p_cam = rotations.rotate(back, pm - camera.p_world)
        q_cam = (-1) ** k * rotations.multiply(back, qm)
        estimator.correct(PoseMeasurement(t, 0, 0, p_cam, q_cam, camera), 0)
        out.append(estimator.estimate.p_world)
    return np.array(out)


@pytest.mark.parametrize("frame", ["world", "relative"])
def test_a_moving_camera_leaves_no_trace_in_the_estimate(frame: str) -> None:
    still, moving = _track(frame, False), _track(frame, True)
    truth = np.array([_target(k / 30)[0] for k in range(150)])
    assert np.linalg.norm(still - truth, axis=1)[30:].max() < 0.05
    # exact in the world form; the relative one integrates the camera's velocity by the trapezoid rule
    np.testing.assert_allclose(moving, still, atol=1e-9 if frame == "world" else 2e-4)


def test_relative_and_stacked_do_not_go_together() -> None:
    basis = RbfBasis.create(np.zeros((1, 2)), 0.5)
    with pytest.raises(ConfigError, match="twist"):
        LearningEstimator(EstimatorSettings(frame="relative", form="stacked"), basis, 1, 30.0, BOUNDS)


def test_world_pose_of_a_measurement_and_bad_numbers() -> None:
    eta = _relative(0.4, True)
    p, q = measured_world_pose(PoseMeasurement(0.4, 0, 0, eta[:3], eta[3:], _camera_motion(0.4)))
    np.testing.assert_allclose(p, _target(0.4)[0], atol=1e-12)
    assert abs(q @ _target(0.4)[1]) == pytest.approx(1.0)
    with pytest.raises(DataError, match="finite"):
        measured_world_pose(PoseMeasurement(0.4, 0, 0, np.full(3, np.nan), eta[3:], _camera_motion(0.4)))
