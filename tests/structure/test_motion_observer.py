"""Acceleration model by ICL, and the corrected observer and predictor of chapter 5."""

import numpy as np
import pytest

from camnet.estimation.structure.camera_path import planar_path
from camnet.estimation.structure.moving.acceleration import AccelerationModel, AccelerationSettings
from camnet.estimation.structure.moving.observer import CameraState, MotionObserver, ObserverGains
from camnet.estimation.structure.moving.relations import feature_rate
from camnet.geometry import rotations as rot

DT = 0.05
CENTRES = np.array([[x, y] for x in (-2.0, 0.0, 2.0) for y in (-2.0, 0.0, 2.0)])
T = np.arange(0.0, 80.0, DT)
W = 0.15


def truth(t):
    """Circle of 2 m about the scene's origin: position, orientation, velocities (scene axes)."""
    p = np.stack([2.0 * np.sin(W * t), -2.0 * np.cos(W * t), 0.0 * t], axis=-1)
    v = 2.0 * W * np.stack([np.cos(W * t), np.sin(W * t), 0.0 * t], axis=-1)
    w = np.broadcast_to([0.0, 0.0, W], v.shape)
    return p, rot.from_yaw(W * t), np.concatenate([v, w], axis=-1)


def camera():
    t = np.linspace(-1.0, 90.0, 92)
    return planar_path(
        t, np.column_stack([-5.0 + 0.3 * np.sin(t), np.cos(0.3 * t)]), 0.2 * np.sin(0.4 * t), 1.0
    )


def camera_state(states, k):
    return CameraState(states.p_world[k], states.q_world[k], states.v_cam[k], states.w_cam[k])


def relative(c, p, q):
    back = rot.conjugate(c.q_scene)
    return rot.rotate(back, p - c.p_scene), rot.multiply(back, q)


def test_the_weights_settle_at_the_regularised_least_squares_solution():
    settings = AccelerationSettings()
    model = AccelerationModel(settings, CENTRES)
    p, _, nu = truth(T)
    model.learn_stretch(T, p, nu)
    assert model.windows == 2 * 80 - 2
    for _ in range(5):
        model.step(1e5)
    size = len(model.gram)
    ridge = settings.ridge * np.trace(model.gram) / size
    expected = np.linalg.solve(model.gram + ridge * np.eye(size), model.moment)
    np.testing.assert_allclose(model.weights, expected, atol=1e-6)
    # v' = w^x v of a steady turn
    accel = np.stack([-W * nu[::200, 1], W * nu[::200, 0], 0.0 * nu[::200, 0]], axis=-1)
    learned = np.array([model.rate(a, b) for a, b in zip(p[::200], nu[::200], strict=True)])
    np.testing.assert_allclose(learned[:, :3], accel, atol=4e-3)


def test_far_from_every_kernel_the_model_is_finite():
    model = AccelerationModel(AccelerationSettings(), CENTRES)
    sigma = model.sigma(np.array([1e3, 0.0, 0.0]), np.ones(6))
    np.testing.assert_array_equal(sigma, np.r_[np.ones(7), np.zeros(9)])


def test_the_pose_moves_as_the_relations_say():
    """Second route: the corrected rate of a feature, and the turn of q_{m/c}."""
    states = camera().states(T)
    h = 1e-4
    p, q, nu = (x[300] for x in truth(T))
    c = camera_state(states, 300)
    p_c, q_c = relative(c, p, q)
    observer = MotionObserver(
        ObserverGains(), AccelerationModel(AccelerationSettings(), CENTRES), p_c, q_c, nu
    )
    observer.predict(h, c)
    into = rot.conjugate(c.q_scene)
    v_m, w_m = rot.rotate(into, nu[:3]), rot.rotate(into, nu[3:])
    rate = feature_rate(p_c, (v_m, w_m), (c.v_cam, c.w_cam), np.zeros(3))
    np.testing.assert_allclose((observer.p - p_c) / h, rate, atol=1e-4)
    turned = rot.log(rot.multiply(observer.q, rot.conjugate(q_c))) / h
    np.testing.assert_allclose(turned, w_m - c.w_cam, atol=1e-4)


@pytest.mark.parametrize("learns", [True, False])
def test_after_learning_an_unseen_turn_is_predicted_and_before_it_is_a_straight_line(learns):
    states = camera().states(T)
    p, q, nu = truth(T)
    model = AccelerationModel(AccelerationSettings(), CENTRES)
    start = camera_state(states, 0)
    # a wrong start in everything
    observer = MotionObserver(ObserverGains(), model, relative(start, p[0] + 0.5, q[0])[0], q[0], np.zeros(6))
    on, off = int(60.0 / DT), int(72.0 / DT)
    for k in range(1, on):
        c = camera_state(states, k)
        observer.observe(DT, c, *relative(c, p[k], q[k]), nu[k])
        if learns and k == on // 2:
            model.learn_stretch(T[:k], p[:k], nu[:k])
        if not learns:
            model.weights[:] = 0.0
    last = camera_state(states, on - 1)
    np.testing.assert_allclose(observer.p_scene(last), p[on - 1], atol=1e-2)
    assert rot.angle_between(observer.q, relative(last, p[on - 1], q[on - 1])[1]) < 1e-2
    for k in range(on, off):
        observer.predict(DT, camera_state(states, k - 1))
    error = np.linalg.norm(observer.p_scene(camera_state(states, off - 1)) - p[off - 1])
    straight = p[on - 1] + (T[off - 1] - T[on - 1]) * nu[on - 1, :3]
    if learns:
        assert error < 0.15
    else:
        np.testing.assert_allclose(observer.p_scene(camera_state(states, off - 1)), straight, atol=0.1)


def test_velocities_stay_within_their_bounds():
    model = AccelerationModel(AccelerationSettings(), CENTRES)
    model.weights[0] = 10.0  # an absurd acceleration
    c = CameraState(np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3), np.zeros(3))
    gains = ObserverGains(speed_max_mps=0.5, rate_max_radps=0.4)
    observer = MotionObserver(gains, model, np.ones(3), np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(6))
    for _ in range(20):
        observer.predict(0.1, c)
    assert np.linalg.norm(observer.nu[:3]) <= 0.5 + 1e-12
    assert np.linalg.norm(observer.nu[3:]) <= 0.4 + 1e-12


def test_in_the_camera_frame_the_acceleration_is_no_function_of_pose_and_velocity():
    """The printed form: nu in camera axes holds ``-w_c^x v``, which the regressors do not know."""
    p, _, nu = truth(T)
    states = camera().states(T)
    into = rot.conjugate(states.q_world)
    in_camera = np.concatenate([rot.rotate(into, nu[:, :3]), rot.rotate(into, nu[:, 3:])], axis=1)
    misses = []
    for values in (nu, in_camera):
        model = AccelerationModel(AccelerationSettings(), CENTRES)
        model.learn_stretch(T, p, values)
        for _ in range(5):
            model.step(1e5)
        accel = np.gradient(values[:, :3], T, axis=0)[1:-1]
        said = (model.sigma(p, values) @ model.weights)[1:-1, :3]
        misses.append(np.sqrt(np.mean(np.sum((said - accel) ** 2, axis=1))))
    assert misses[0] < 5e-3
    assert misses[1] > 5.0 * misses[0]
