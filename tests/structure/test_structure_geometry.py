"""Identities of bell2019, chapter 2, without noise, against numerical differentiation; and that a printed form errs."""

import numpy as np
import pytest

from camnet.estimation.structure import geometry, rates
from camnet.estimation.structure.camera_path import CameraPath, forward_camera, planar_path
from camnet.geometry import rotations as rot

RNG = np.random.default_rng(4)
POINTS = np.array([4.0, 0.0, 0.5]) + RNG.uniform(-1.0, 1.0, (20, 3))


def a_path():
    t = np.linspace(0.0, 4.0, 9)
    p = np.column_stack([0.5 * t, np.sin(0.6 * t), 0.2 * np.cos(0.9 * t)])
    q = rot.multiply(forward_camera(0.1 * t), rot.exp(np.column_stack([0.1 * np.sin(t), 0.05 * t, 0.2 * t])))
    return CameraPath(t, p, q)


def seen(path, t):
    """Directions, distances, rotation and direction of the key frame at time t; the key frame is at 0."""
    now, key = path.states(t), path.states(0.0)
    r_c, r_k = rot.to_matrix(now.q_world[0]), rot.to_matrix(key.q_world[0])
    u_ic, d_ic = geometry.unit((POINTS - now.p_world) @ r_c)
    u_ik, d_ik = geometry.unit((POINTS - key.p_world) @ r_k)
    u_kc, d_kc = geometry.unit((key.p_world - now.p_world) @ r_c)
    return u_ic, d_ic, u_ik, d_ik, u_kc[0], d_kc[0], r_c.T @ r_k


@pytest.mark.parametrize("t", [0.3, 1.0, 2.2, 3.9])
def test_distances_are_psi_times_the_distance_at_the_key_frame(t):
    u_ic, d_ic, u_ik, d_ik, u_kc, d_kc, r_kc = seen(a_path(), t)
    psi = geometry.distance_ratios(u_ic, u_kc, r_kc, u_ik)
    np.testing.assert_allclose(psi[:, 0] * d_ik, d_ic, atol=1e-10)
    np.testing.assert_allclose(psi[:, 1] * d_ik, d_kc, atol=1e-10)
    # by the pseudo-inverse that the paper writes
    for i, m in enumerate(geometry.direction_matrix(u_ic, u_kc)):
        np.testing.assert_allclose(psi[i], np.linalg.pinv(m) @ r_kc @ u_ik[i], atol=1e-10)
        low = np.linalg.eigvalsh(m.T @ m)[0]
        assert geometry.excitation(u_ic[i], u_kc) == pytest.approx(low, abs=1e-12)
    row = geometry.range_row(u_ic, u_kc, r_kc, u_ik)
    np.testing.assert_allclose(row[:, 0] * d_kc + row[:, 1] * d_ik, d_ic, atol=1e-10)


def test_motion_along_the_line_of_sight_has_no_excitation_and_no_psi():
    u = np.array([0.0, 0.0, 1.0])
    assert geometry.excitation(u, -u) == 0.0
    assert not np.isfinite(geometry.distance_ratios(u, -u, np.eye(3), u)).all()


def central(f, t, h=1e-4):
    """Fourth-order central difference."""
    return (8.0 * (f(t + h) - f(t - h)) - (f(t + 2 * h) - f(t - 2 * h))) / (12.0 * h)


@pytest.mark.parametrize("t", [0.7, 1.3, 2.6])
def test_rates_agree_with_numerical_differentiation(t):
    path = a_path()
    now = path.states(t)
    v, w = now.v_cam[0], now.w_cam[0]
    u_ic, d_ic, _, _, u_kc, d_kc, _ = seen(path, t)

    def rate(k):
        return central(lambda x: seen(path, x)[k], t)

    np.testing.assert_allclose(rates.distance_rate(u_ic, v), rate(1), atol=1e-10)
    np.testing.assert_allclose(rates.distance_rate(u_kc, v), rate(5), atol=1e-10)
    u_rate = rates.direction_rate(u_ic, d_ic, v, w)
    np.testing.assert_allclose(u_rate, rate(0), atol=1e-10)
    np.testing.assert_allclose(rates.direction_rate(u_kc, d_kc, v, w), rate(4), atol=1e-10)
    p_rate = central(lambda x: (s := seen(path, x))[4] * s[5], t)
    np.testing.assert_allclose(rates.position_rate(u_kc * d_kc, v, w), p_rate, atol=1e-10)
    # the optical flow has the turning taken out: xi d = rho
    xi = rates.optical_flow(u_rate, u_ic, w)
    np.testing.assert_allclose(xi * d_ic[:, None], rates.translational_flow(u_ic, v), atol=1e-10)


def quaternion_of_key(path, t):
    q = rot.multiply(rot.conjugate(path.states(t).q_world[0]), path.states(0.0).q_world[0])
    return rot.align_sign(q, rot.IDENTITY)


@pytest.mark.parametrize("t", [1.3, 2.6])
def test_orientation_rates_are_right_and_the_printed_one_errs(t):
    path = a_path()
    w = path.states(t).w_cam[0]
    q_kc = quaternion_of_key(path, t)
    true_rate = central(lambda x: quaternion_of_key(path, x), t)
    np.testing.assert_allclose(rates.key_quaternion_rate(q_kc, w), true_rate, atol=1e-10)
    np.testing.assert_allclose(
        rates.camera_quaternion_rate(rot.conjugate(q_kc), w), rot.conjugate(true_rate), atol=1e-10
    )
    back = -0.5 * rot.kinematic_matrix(q_kc) @ rot.to_matrix(q_kc).T @ w
    np.testing.assert_allclose(back, true_rate, atol=1e-10)
    printed = -0.5 * rot.kinematic_matrix(q_kc) @ w
    assert np.linalg.norm(printed - true_rate) > 0.02 * np.linalg.norm(true_rate)


def test_the_printed_orientation_leaves_the_true_one_where_the_corrected_one_stays():
    t = np.linspace(0.0, 3.0, 3001)
    w = np.column_stack([0.8 * np.sin(t), 0.6 * np.ones_like(t), 0.5 * np.cos(2.0 * t)])
    q_wc = right = printed = rot.IDENTITY
    dt = t[1] - t[0]
    for k in range(len(t) - 1):
        middle = 0.5 * (w[k] + w[k + 1])
        q_wc = rot.multiply(q_wc, rot.exp(dt * middle))
        right = rates.turn_key_frame(right, middle, dt)
        printed = rot.normalise(printed - 0.5 * dt * rot.kinematic_matrix(printed) @ middle)
    assert rot.angle_between(right, rot.conjugate(q_wc)) < 1e-10
    assert rot.angle_between(printed, rot.conjugate(q_wc)) > 0.1


def test_velocity_of_a_moving_target_from_chi():
    """Chapter 5: the corrected form gives the target's velocity, the printed one does not."""
    path, t = a_path(), 1.7
    first = np.array([3.0, 0.3, 0.4])
    spin, drift = np.array([0.2, -0.1, 0.7]), np.array([0.3, -0.5, 0.1])

    def at(x):
        now, key = path.states(x), path.states(0.0)
        r_c, r_k = rot.to_matrix(now.q_world[0]), rot.to_matrix(key.q_world[0])
        turn = rot.to_matrix(rot.exp(spin * x))  # target, world frame
        r_mc = r_c.T @ turn @ r_k
        p_m1 = r_c.T @ (first + drift * x - now.p_world[0])
        p_key = r_k.T @ (first - key.p_world[0])
        return p_m1, p_m1 - r_mc @ p_key, r_mc, p_key, r_c

    p_m1, p_mm, r_mc, p_key, r_c = at(t)
    now = path.states(t)
    v_c, w_c = now.v_cam[0], now.w_cam[0]
    w_m = r_c.T @ spin
    (u1, _), (um, dm), (uk, dk) = geometry.unit(p_m1), geometry.unit(p_mm), geometry.unit(p_key)
    xi1 = rates.optical_flow(central(lambda x: geometry.unit(at(x)[0])[0], t), u1, w_c)
    xim = rates.optical_flow(central(lambda x: geometry.unit(at(x)[1])[0], t), um, w_c)
    psi = geometry.distance_ratios(u1, um, r_mc, uk)
    np.testing.assert_allclose(psi[1] * dk, dm, atol=1e-10)
    chi = geometry.velocity_matrix(u1, um)
    assert np.linalg.eigvalsh(chi.T @ chi)[0] == pytest.approx(
        geometry.velocity_excitation(u1, um), abs=1e-12
    )
    phi = geometry.velocity_vector(xi1, xim, psi, um, w_m, r_mc, uk)
    np.testing.assert_allclose(np.linalg.pinv(chi) @ phi * dk + v_c, r_c.T @ drift, atol=1e-9)
    printed = geometry.velocity_vector(xi1, xim, psi, um, w_m - w_c, r_mc, uk)
    assert np.linalg.norm(np.linalg.pinv(chi) @ printed * dk + v_c - r_c.T @ drift) > 0.1


def test_a_planar_path_looks_where_it_says():
    path = planar_path(np.array([0.0, 1.0, 2.0]), np.array([[0, 0], [1, 0], [2, 0.0]]), np.full(3, 0.5), 0.3)
    s = path.states(np.array([0.5]))
    forward = rot.rotate(s.q_world, np.array([0.0, 0.0, 1.0]))[0]
    np.testing.assert_allclose(forward, [np.cos(0.5), np.sin(0.5), 0.0], atol=1e-12)
    down = rot.rotate(s.q_world, np.array([0.0, 1.0, 0.0]))[0]
    np.testing.assert_allclose(down, [0.0, 0.0, -1.0], atol=1e-12)
    np.testing.assert_allclose(rot.rotate(s.q_world, s.v_cam), [[1.0, 0.0, 0.0]], atol=1e-12)
