"""Rotations against SciPy, against numerical differentiation, and compiled against plain."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rounding import assert_rounded_alike
from scipy.spatial.transform import Rotation, Slerp

from camnet.geometry import rotations as rot
from camnet.geometry import rotations_compiled as fast

RNG = np.random.default_rng(3)
Q = Rotation.random(200, random_state=1).as_quat(scalar_first=True)
P = Rotation.random(200, random_state=2).as_quat(scalar_first=True)
V = RNG.normal(size=(200, 3))


def scipy_of(q):
    return Rotation.from_quat(q, scalar_first=True)


def same_orientation(a, b, tol=1e-12):
    return np.all(np.abs(np.abs(np.sum(a * b, axis=-1)) - 1.0) < tol)


def test_products_matrices_and_vectors_agree_with_scipy():
    assert same_orientation(rot.multiply(Q, P), (scipy_of(Q) * scipy_of(P)).as_quat(scalar_first=True))
    np.testing.assert_allclose(rot.to_matrix(Q), scipy_of(Q).as_matrix(), atol=1e-14)
    np.testing.assert_allclose(rot.rotate(Q, V), scipy_of(Q).apply(V), atol=1e-13)
    assert same_orientation(rot.from_matrix(scipy_of(Q).as_matrix()), Q)
    np.testing.assert_allclose(rot.conjugate(Q), scipy_of(Q).inv().as_quat(scalar_first=True), atol=1e-14)


def test_matrices_of_half_turns_lose_no_digits():
    half_turns = np.concatenate([np.zeros((50, 1)), RNG.normal(size=(50, 3))], axis=1)
    half_turns = rot.normalise(half_turns)
    assert same_orientation(rot.from_matrix(rot.to_matrix(half_turns)), half_turns, 1e-15 * 8)


@settings(max_examples=200, deadline=None)
@given(st.lists(st.floats(-3.0, 3.0), min_size=3, max_size=3), st.floats(-12, 0))
def test_exp_and_log_are_inverse_and_agree_with_scipy(direction, exponent):
    direction = np.array(direction)
    norm = np.linalg.norm(direction)
    if norm < 1e-3:
        return
    rotvec = direction / norm * 0.999 * np.pi * 10.0**exponent  # half turns have two logs
    q = rot.exp(rotvec)
    np.testing.assert_allclose(q, Rotation.from_rotvec(rotvec).as_quat(scalar_first=True), atol=2e-16 * 4)
    back = rot.log(q)
    np.testing.assert_allclose(back, rotvec, rtol=1e-9, atol=1e-300)
    np.testing.assert_array_equal(rot.log(-q), back)


def test_log_of_the_identity_is_zero():
    np.testing.assert_array_equal(rot.log(rot.IDENTITY), np.zeros(3))
    np.testing.assert_array_equal(rot.log(-rot.IDENTITY), np.zeros(3))


def test_quaternion_kinematics_by_numerical_differentiation():
    w_body = RNG.normal(size=(200, 3))
    h = 1e-5
    forward = rot.multiply(Q, rot.exp(h * w_body))
    backward = rot.multiply(Q, rot.exp(-h * w_body))
    derivative = 0.5 * np.einsum("nij,nj->ni", rot.kinematic_matrix(Q), w_body)
    np.testing.assert_allclose((forward - backward) / (2 * h), derivative, atol=1e-9)
    # and the same angular velocity is the matrix one: R' = R w^x
    matrix_rate = (rot.to_matrix(forward) - rot.to_matrix(backward)) / (2 * h)
    np.testing.assert_allclose(matrix_rate, rot.to_matrix(Q) @ rot.skew(w_body), atol=1e-8)
    b = rot.kinematic_matrix(Q)
    np.testing.assert_allclose(
        np.swapaxes(b, -1, -2) @ b, np.broadcast_to(np.eye(3), (200, 3, 3)), atol=1e-14
    )


def test_skew_is_the_cross_product():
    np.testing.assert_allclose(
        np.einsum("nij,nj->ni", rot.skew(V), V[::-1]), np.cross(V, V[::-1]), atol=1e-14
    )


def test_sign_angle_and_slerp():
    aligned = rot.align_sign(-Q, Q)
    np.testing.assert_array_equal(aligned, Q)
    np.testing.assert_allclose(
        rot.angle_between(-Q, P), (scipy_of(Q).inv() * scipy_of(P)).magnitude(), atol=1e-12
    )
    for f in (0.0, 0.3, 1.0):
        peer = [
            Slerp([0, 1], scipy_of(np.stack([a, b])))(f).as_quat(scalar_first=True)
            for a, b in zip(Q, P, strict=True)
        ]
        assert same_orientation(rot.slerp(Q, P, f), np.array(peer))


def test_yaw():
    psi = np.linspace(-3.1, 3.1, 23)
    np.testing.assert_allclose(rot.yaw_of(rot.from_yaw(psi)), psi, atol=1e-14)
    heading = rot.to_matrix(Q)[:, :, 0]
    np.testing.assert_allclose(rot.yaw_of(Q), np.arctan2(heading[:, 1], heading[:, 0]), atol=1e-12)


def test_look_at_is_level_upright_and_centred():
    p, target = RNG.normal(size=(100, 3)), RNG.normal(size=(100, 3))
    r = rot.to_matrix(rot.look_at(p, target))
    towards = (target - p) / np.linalg.norm(target - p, axis=1, keepdims=True)
    np.testing.assert_allclose(r[:, :, 2], towards, atol=1e-12)
    np.testing.assert_allclose(r[:, 2, 0], 0.0, atol=1e-12)  # x axis level
    assert np.all(r[:, 2, 1] < 0.0)  # y axis down
    np.testing.assert_allclose(np.linalg.det(r), 1.0)
    # looking north: right is east
    np.testing.assert_allclose(rot.to_matrix(rot.look_at([0, 0, 1], [0, 5, 1]))[:, 0], [1, 0, 0], atol=1e-15)


@pytest.mark.parametrize("end", [[0.0, 0.0, 0.0], [0.0, 0.0, 9.0]])
def test_look_at_straight_down_and_up(end):
    r = rot.to_matrix(rot.look_at([0.0, 0.0, 4.0], end))
    np.testing.assert_allclose(r[:, 0], [1, 0, 0], atol=1e-15)
    np.testing.assert_allclose(r[:, 2], [0, 0, np.sign(end[2] - 4.0)], atol=1e-15)


def test_looking_down_is_the_same_by_both_ways():
    assert same_orientation(rot.look_at([1, 2, 3], [1, 2, 0]), rot.STRAIGHT_DOWN)
    assert same_orientation(rot.nadir_gaze(0.0, 0.0), rot.STRAIGHT_DOWN)


def test_nadir_gaze_points_where_it_says_by_the_smallest_rotation():
    pan, tilt, yaw = RNG.uniform(-1.4, 1.4, 100), RNG.uniform(-1.4, 1.4, 100), RNG.uniform(-3, 3, 100)
    q = rot.nadir_gaze(pan, tilt, yaw)
    d = np.stack([np.tan(pan), np.tan(tilt), -np.ones(100)], axis=1)
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    axis = rot.rotate(q, [0, 0, 1])
    np.testing.assert_allclose(axis, Rotation.from_euler("z", yaw[:, None]).apply(d), atol=1e-12)
    no_yaw = rot.nadir_gaze(pan, tilt)
    np.testing.assert_allclose(rot.angle_between(no_yaw, rot.STRAIGHT_DOWN), np.arccos(-d[:, 2]), atol=1e-9)
    back = rot.gaze_angles(3.7 * axis, yaw)
    np.testing.assert_allclose(back[0], pan, atol=1e-9)
    np.testing.assert_allclose(back[1], tilt, atol=1e-9)


def test_nadir_gaze_is_smooth_at_the_nadir():
    h = 1e-6
    steps = rot.nadir_gaze(np.array([h, -h, 0, 0]), np.array([0, 0, h, -h]))
    assert np.all(rot.angle_between(steps, rot.STRAIGHT_DOWN) < 1.01 * h)


def test_gaze_above_the_horizon_saturates():
    pan, tilt = rot.gaze_angles([1.0, 0.0, 0.5])
    assert pan == pytest.approx(np.pi / 2)
    assert tilt == 0.0


def test_compiled_agree_with_plain():
    small = np.array([1e-6, -2e-6, 3e-7])
    for q, p, v in zip(Q[:40], P[:40], V[:40], strict=True):
        assert_rounded_alike(fast.multiply(q, p), rot.multiply(q, p), scale=1.0)
        assert_rounded_alike(fast.conjugate(q), rot.conjugate(q))
        assert_rounded_alike(fast.normalise(3 * q), q, scale=1.0)
        assert_rounded_alike(fast.to_matrix(q), rot.to_matrix(q), scale=1.0)
        assert_rounded_alike(fast.kinematic_matrix(q), rot.kinematic_matrix(q))
        np.testing.assert_allclose(fast.rotate(q, v), rot.rotate(q, v), atol=1e-14)
        np.testing.assert_allclose(fast.rotate_inverse(q, v), rot.rotate(rot.conjugate(q), v), atol=1e-14)
        assert_rounded_alike(fast.exp(v), rot.exp(v), scale=1.0)
        assert_rounded_alike(fast.exp(small), rot.exp(small))
        assert_rounded_alike(fast.log(q), rot.log(q), scale=2 * np.pi)
        np.testing.assert_allclose(fast.log(rot.exp(small)), rot.log(rot.exp(small)), rtol=1e-14)
        assert_rounded_alike(fast.align_sign(q, p), rot.align_sign(q, p))
        assert fast.angle_between(q, p) == pytest.approx(float(rot.angle_between(q, p)), abs=1e-12)
