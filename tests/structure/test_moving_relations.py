"""Identities of bell2019, chapter 5, without noise, against numerical differentiation; and that printed forms err."""

import math

import numpy as np
import pytest

from camnet.errors import ConfigError
from camnet.estimation.structure import geometry, rates
from camnet.estimation.structure.camera_path import CameraPath, forward_camera
from camnet.estimation.structure.moving import relations as rel
from camnet.estimation.structure.moving import unseen_growth as growth
from camnet.geometry import rotations as rot

ARMS = np.random.default_rng(2).uniform(-0.4, 0.4, (6, 3))


def camera():
    t = np.linspace(0.0, 6.0, 13)
    p = np.column_stack([0.2 * t, np.sin(0.6 * t), 0.2 * np.cos(0.9 * t)])
    q = rot.multiply(
        forward_camera(0.2 * np.sin(t)), rot.exp(np.column_stack([0.2 * np.sin(t), 0.1 * t, 0.1 * t]))
    )
    return CameraPath(t, p, q)


def body():
    """A target that turns about all axes; its frame at time 0 is not the camera's."""
    t = np.linspace(0.0, 6.0, 13)
    p = np.column_stack([5.0 + np.sin(0.5 * t), 0.3 * t, 0.1 * np.sin(t)])
    return CameraPath(t, p, rot.exp(np.column_stack([0.2 * np.sin(t), 0.1 * t, 0.3 * t])))


def seen(t):
    """Positions of the features, and the rotation R_{m/c}, in the camera frame; first frame at t = 0."""

    def at(x):
        c, b = camera().states(x), body().states(x)
        world = b.p_world[0] + ARMS @ rot.to_matrix(b.q_world[0]).T
        r_c = rot.to_matrix(c.q_world[0])
        return (world - c.p_world[0]) @ r_c, r_c.T @ rot.to_matrix(b.q_world[0])

    p_k, r_k = at(0.0)
    p_c, r_c = at(t)
    return p_c, r_c @ r_k.T, p_k


def central(f, t, h=1e-4):
    return (8.0 * (f(t + h) - f(t - h)) - (f(t + 2 * h) - f(t - 2 * h))) / (12.0 * h)


def truth(t):
    """v_m of feature m1 and w_m in camera axes, v_c, w_c: exact derivatives of the splines."""
    c, b = camera().states(t), body().states(t)
    r_b, r_c = rot.to_matrix(b.q_world[0]), rot.to_matrix(c.q_world[0])
    v_world = r_b @ (b.v_cam[0] + np.cross(b.w_cam[0], ARMS[0]))
    return r_c.T @ v_world, r_c.T @ r_b @ b.w_cam[0], c.v_cam[0], c.w_cam[0]


def mm(t):
    p_c, r_mc, p_k = seen(t)
    return rel.lever_position(p_c[0], r_mc, p_k[0])


TIMES = [0.9, 2.1, 3.3, 4.7]


@pytest.mark.parametrize("t", TIMES)
def test_psi_holds_with_the_lever_in_place_of_the_key_frame(t):
    p_c, r_mc, p_k = seen(t)
    u_ic, d_ic = geometry.unit(p_c)
    u_ik, d_ik = geometry.unit(p_k)
    u_mm, d_mm = geometry.unit(mm(t))
    psi = geometry.distance_ratios(u_ic, u_mm, r_mc, u_ik)
    np.testing.assert_allclose(psi[:, 0] * d_ik, d_ic, atol=1e-10)
    np.testing.assert_allclose(psi[:, 1] * d_ik, d_mm, atol=1e-10)
    np.testing.assert_allclose(rel.remaining_distance(psi[0], psi, d_ik[0]), d_ik, rtol=1e-10)
    # chi is the matrix whose smallest eigenvalue the condition states
    chi = geometry.velocity_matrix(u_ic[0], u_mm)
    low = np.linalg.eigvalsh(chi.T @ chi)[0]
    assert geometry.velocity_excitation(u_ic[0], u_mm) == pytest.approx(low, abs=1e-12)


@pytest.mark.parametrize("t", TIMES)
def test_rates_of_features_and_of_the_lever_agree_with_numerical_differentiation(t):
    v_m, w_m, v_c, w_c = truth(t)
    p_c, r_mc, p_k = seen(t)
    arms = (p_k - p_k[0]) @ r_mc.T
    ours = rel.feature_rate(p_c, (v_m, w_m), (v_c, w_c), arms)
    np.testing.assert_allclose(ours, central(lambda x: seen(x)[0], t), atol=1e-10)
    lever = rel.feature_rate(mm(t), (v_m, w_m), (v_c, w_c), -r_mc @ p_k[0])
    np.testing.assert_allclose(lever, central(mm, t), atol=1e-10)


def velocity(t, as_printed=False):
    """v_m from directions and flows alone (exact derivatives of directions by the rates of the points)."""
    v_m, w_m, v_c, w_c = truth(t)
    p_c, r_mc, p_k = seen(t)
    u_1, d_1 = geometry.unit(p_c[0])
    u_mm, d_mm = geometry.unit(mm(t))
    u_k, d_k = geometry.unit(p_k[0])

    def direction_rate(u, d, p_rate):
        return (p_rate - u * (u @ p_rate)) / d

    rate_1 = direction_rate(u_1, d_1, rel.feature_rate(p_c[0], (v_m, w_m), (v_c, w_c), np.zeros(3)))
    rate_m = direction_rate(u_mm, d_mm, rel.feature_rate(mm(t), (v_m, w_m), (v_c, w_c), -r_mc @ p_k[0]))
    flows = (rates.optical_flow(rate_1, u_1, w_c), rates.optical_flow(rate_m, u_mm, w_c))
    psi = geometry.distance_ratios(u_1, u_mm, r_mc, u_k)
    return rel.velocity_by_directions(
        (u_1, u_mm), flows, psi, (w_m, w_c, r_mc), u_k, d_k, v_c, as_printed=as_printed
    )


@pytest.mark.parametrize("t", TIMES)
def test_the_velocity_follows_from_directions_and_one_distance(t):
    np.testing.assert_allclose(velocity(t), truth(t)[0], atol=1e-10)


def test_the_printed_velocity_errs_without_any_noise():
    errors = [np.linalg.norm(velocity(t, as_printed=True) - truth(t)[0]) for t in np.linspace(0.5, 5.5, 21)]
    assert np.sqrt(np.mean(np.square(errors))) > 0.1


@pytest.mark.parametrize("t", TIMES)
def test_the_angular_velocity_follows_from_the_quaternion_and_its_rate(t):
    def q(x):
        c, b = camera().states(x), body().states(x)
        start = rot.multiply(rot.conjugate(camera().states(0.0).q_world[0]), body().states(0.0).q_world[0])
        now = rot.multiply(rot.conjugate(c.q_world[0]), b.q_world[0])
        return rot.align_sign(rot.multiply(now, rot.conjugate(start)), np.array([1.0, 0.0, 0.0, 0.0]))

    _, w_m, _, w_c = truth(t)
    np.testing.assert_allclose(rel.angular_velocity(q(t), central(q, t), w_c), w_m, atol=1e-10)


def test_windows_give_the_distances_of_the_remaining_features():
    nodes, weights = np.polynomial.legendre.leggauss(24)
    start, end = 2.0, 3.5
    times = 0.5 * (end - start) * nodes + 0.5 * (end + start)
    p_k = seen(0.0)[2]
    u_k, d_k = geometry.unit(p_k)

    def integrands(t):
        v_m, w_m, v_c, _ = truth(t)
        p_c, r_mc, _ = seen(t)
        u_mi, u_mm = geometry.unit(p_c)[0], geometry.unit(mm(t))[0]
        return rel.window_rates((u_mi, u_mm), (v_m - v_c) / d_k[0], w_m, r_mc, (u_k, u_k[0]))

    def psi(t):
        p_c, r_mc, _ = seen(t)
        return geometry.distance_ratios(geometry.unit(p_c)[0], geometry.unit(mm(t))[0], r_mc, u_k)

    # splines have knots every half second: the integral is exact piece by piece
    a, b = np.zeros((6, 2)), np.zeros((6, 2))
    for low in (2.0, 2.5, 3.0):
        times = 0.25 * nodes + low + 0.25
        parts = [integrands(t) for t in times]
        a += 0.25 * sum(w * x[0] for w, x in zip(weights, parts, strict=True))
        b += 0.25 * sum(w * x[1] for w, x in zip(weights, parts, strict=True))
    left = (psi(end) - psi(start) - a) * d_k[:, None]
    np.testing.assert_allclose(left, d_k[0] * b, atol=1e-10)


def test_parallel_directions_give_no_velocity():
    u = np.array([0.0, 0.0, 1.0])
    assert not np.isfinite(rel.target_velocity(u, u, np.ones(6), 1.0, np.zeros(3))).any()


def test_lemma_5_3_is_false_and_its_repair_holds():
    """Scalar target, nothing but the weight errs: N windows of residual eps teach a wrong weight unseen."""
    eps, window, s, gain, gamma, count = 0.1, 1.0, 0.05, 4.0, 1.0, 100
    y = window * s
    stack = count * y * y
    error = count * y * eps * window
    # exact bound of |E| is reached: all windows have the same residual
    assert growth.stack_residual(count, stack, eps, window) == pytest.approx(error)
    # the largest of c5's terms for |W| = 0, sigma constant: 1 + s/2 (nu), over 1/2 min(1, 1/Gamma)
    rate = (1.0 + 0.5 * s) / 0.5
    worst = 0.0
    for t in np.linspace(0.05, 3.0, 60):
        w_til = -error / stack * (1.0 - math.exp(-gamma * gain * stack * t))
        v = 0.5 * w_til**2 / gamma
        worst = max(worst, v / growth.growth_bound(0.0, rate, growth.printed_drive(eps), t))
        assert v <= growth.growth_bound(0.0, rate, growth.drive(eps, gain, stack, error), t)
    assert worst > 10.0


@pytest.mark.parametrize(
    ("call", "field"),
    [
        (lambda: growth.drive(0.1, 1.0, 0.0, 1.0), "stack_min"),
        (lambda: growth.drive(math.nan, 1.0, 1.0, 1.0), "residual"),
        (lambda: growth.growth_bound(1.0, 0.0, 1.0, 1.0), "rate"),
        (lambda: growth.stack_residual(3, -1.0, 1.0, 1.0), "stack_max"),
    ],
)
def test_numbers_that_make_no_bound_are_refused_by_name(call, field):
    with pytest.raises(ConfigError, match=field):
        call()
