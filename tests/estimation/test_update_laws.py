"""Update laws against the continuous differential equations, projection, convergence to known weights."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from camnet.estimation.basis import RbfBasis
from camnet.estimation.concurrent_learning import (
    SWITCHING,
    MotionModel,
    correct_pose,
    implicit_step,
    output_error,
    switching,
)
from camnet.estimation.feedback import world_feedback
from camnet.estimation.measured_step import measured_step
from camnet.estimation.projection import project_rate, project_step
from camnet.estimation.propagate import PRIORS, advance, model_twist, roll_out
from camnet.estimation.road_prior import NO_ROADS
from camnet.estimation.settings import EstimatorSettings, GapSettings, StackSettings
from camnet.estimation.weight_step import weight_step
from camnet.geometry import rotations
from camnet.types import CameraMotion

FORMS = ["twist", "stacked"]
LOW, HIGH = np.full(3, -50.0), np.full(3, 50.0)


def _target(t: float) -> tuple[np.ndarray, np.ndarray]:
    """A smooth pose with all six velocities alive."""
    p = np.array([math.cos(0.7 * t), math.sin(0.5 * t), 0.2 * math.sin(t)])
    return p, rotations.exp(np.array([0.3 * math.sin(0.4 * t), 0.2 * t, 0.8 * math.sin(0.6 * t)]))


def _model(form: str, seed: int = 0, **changes: float) -> tuple[MotionModel, RbfBasis, EstimatorSettings]:
    """A model with some windows in its stack."""
    rng = np.random.default_rng(seed)
    settings = EstimatorSettings(
        form=form, leakage=0.0, weight_bound=1e3, stack=StackSettings(size=20), **changes
    )
    basis = RbfBasis.create(rng.uniform(-1.5, 1.5, (6, 2)), 0.5)
    model = MotionModel(settings, basis.size, 1e-3)
    for _ in range(9):
        model.learn_window(0.0, rng.uniform(0, 0.5, 6), 0.3 * rng.standard_normal(8))
        if settings.alpha < 1.0:
            model.learn_rate(0.0, rng.uniform(0, 1.0, 6), 0.5 * rng.standard_normal(8))
    return model, basis, settings


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("alpha", [0.0, 0.4, 1.0])
def test_measured_updates_follow_the_continuous_laws(form: str, alpha: float) -> None:
    """(7), (8), (4-16), (4-18): pose and weights together, small steps against solve_ivp on the printed equations."""
    model, basis, s = _model(form, k1_per_s=2.0, k2=0.2, kcl=1.5, gamma=0.8, alpha=alpha, switching="tanh")
    n = 7 if form == "stacked" else 6
    psi = alpha * model.integral.gram + (1 - alpha) * model.instantaneous.gram
    q_sum = alpha * model.integral.moment + (1 - alpha) * model.instantaneous.moment
    p0, q0 = _target(0.0)
    start = np.concatenate(
        (p0 + 0.3, rotations.normalise(q0 + np.array([0.0, 0.1, -0.1, 0.05])), np.zeros(6 * n))
    )

    def rhs(t: float, y: np.ndarray) -> np.ndarray:
        p, q = _target(t)
        w = y[7:].reshape(6, n)
        sigma = basis(p, q)
        e = np.concatenate((p, rotations.align_sign(q, y[3:7]))) - y[:7]
        g = np.eye(7)
        if form == "twist":
            g = np.zeros((7, 6))
            g[:3, :3], g[3:, 3:] = np.eye(3), 0.5 * rotations.kinematic_matrix(q)
        eta_dot = g @ (w.T @ sigma) + s.k1_per_s * e + s.k2 * np.tanh(e / s.boundary_layer)
        # the estimate is kept on the sphere, which the printed law leaves by its feedback term
        eta_dot[3:] -= y[3:7] * (y[3:7] @ eta_dot[3:])
        w_dot = s.gamma * (np.outer(sigma, g.T @ e) + s.kcl * (q_sum[:, :n] - psi @ w))
        return np.concatenate((eta_dot, w_dot.ravel()))

    exact = solve_ivp(rhs, (0.0, 1.0), start, rtol=1e-8, atol=1e-10).y[:, -1]
    p_hat, q_hat = start[:3].copy(), start[3:7].copy()
    twist, no_prior = np.zeros(6), np.zeros(6)
    for k in range(1000):
        p, q = _target((k + 1) * 1e-3)
        sigma = basis(p, q)
        rates = model.weights.T @ sigma
        p_hat = p_hat + 1e-3 * rates[:3]
        if form == "twist":
            model_twist(
                p, q, no_prior, False, False, model.weights, basis.centres, basis.precision, 1.0, twist
            )
            np.testing.assert_allclose(twist, rates[:6], atol=1e-5)
            q_hat = (
                q_hat + 1e-3 * 0.5 * rotations.kinematic_matrix(rotations.align_sign(q, q_hat)) @ twist[3:]
            )
        else:
            q_hat = q_hat + 1e-3 * rates[3:7]
        p_hat, q_hat, error = correct_pose(
            p_hat, q_hat, p, q, s.k1_per_s, s.k2, SWITCHING["tanh"], s.boundary_layer, 1e-3
        )
        model.step(sigma, output_error(error, rotations.align_sign(q, q_hat), form == "stacked"))
    np.testing.assert_allclose(p_hat, exact[:3], atol=2e-3)
    np.testing.assert_allclose(q_hat, exact[3:7], atol=2e-3)
    np.testing.assert_allclose(model.weights[:, :n], exact[7:].reshape(6, n), atol=3e-3)


@pytest.mark.parametrize("dt", [1e-3, 1e-4])
def test_implicit_weight_integration_converges_to_the_matrix_exponential(dt: float) -> None:
    rng = np.random.default_rng(0)
    a = rng.standard_normal((8, 5))
    psi, moment, w0 = a.T @ a, rng.standard_normal((5, 8)), rng.standard_normal((5, 8))
    inverse = np.linalg.inv(np.eye(5) + dt * 2.0 * 0.5 * psi)
    w = w0
    for _ in range(round(0.2 / dt)):
        w = implicit_step(
            w, inverse, np.arange(5), moment, np.zeros(5), np.zeros(8), dt, 0.5, 2.0, 6, 1e6, 1.0
        )
    fixed = np.linalg.solve(psi, moment)
    exact = fixed + expm(-0.2 * psi) @ (w0 - fixed)
    np.testing.assert_allclose(w, exact, atol=20 * dt)


def test_implicit_integration_is_stable_where_explicit_euler_is_not() -> None:
    psi, dt = np.diag([1e-6, 50.0]), 1 / 60
    assert abs(1 - dt * 10.0 * 50.0) > 1  # explicit Euler's growth factor
    w = np.full((2, 8), 5.0)
    inverse = np.linalg.inv(np.eye(2) + dt * 10.0 * psi)
    for _ in range(500):
        w = implicit_step(
            w,
            inverse,
            np.arange(2),
            psi @ np.ones((2, 8)),
            np.zeros(2),
            np.zeros(8),
            dt,
            1.0,
            10.0,
            6,
            1e6,
            1.0,
        )
    np.testing.assert_allclose(w[1], 1.0, atol=1e-9)


@given(seed=st.integers(0, 10_000))
def test_the_compact_weight_step_is_the_plain_one(seed: int) -> None:
    """Kernels in any order, some never touched, with projection at work or not."""
    rng = np.random.default_rng(seed)
    p, n = 11, int(rng.integers(0, 12))
    order = rng.permutation(p)[:n]
    rows = rng.standard_normal((4, p)) * np.isin(np.arange(p), order)
    dt, gamma, kcl, leakage = 0.1, 0.7, 2.0, 0.3
    inverse = np.linalg.inv(np.eye(p) + dt * gamma * kcl * (rows.T @ rows + leakage * np.eye(p)))
    w, sigma, error = rng.standard_normal((p, 8)), rng.uniform(0, 1, p), rng.standard_normal(8)
    moment = rows.T @ rng.standard_normal((4, 8))
    bound = float(rng.uniform(1.0, 20.0))
    w *= min(1.0, bound / np.linalg.norm(w[:, :6]))
    fade = 1.0 / (1.0 + dt * gamma * kcl * leakage)
    compact = np.ascontiguousarray(inverse[np.ix_(order, order)])
    fast = weight_step(w, compact, order, fade, moment, sigma, error, dt * gamma, kcl, 6, bound, 0.1)
    plain = implicit_step(w, inverse, np.arange(p), moment, sigma, error, dt, gamma, kcl, 6, bound, 0.1)
    np.testing.assert_allclose(fast, plain, atol=1e-12)


@pytest.mark.parametrize("form", FORMS)
@given(seed=st.integers(0, 10_000))
def test_the_fused_measured_step_is_model_and_feedback(form: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    s = EstimatorSettings(form=form)
    basis = RbfBasis.create(rng.uniform(-1, 1, (9, 2)), 0.3)
    w, prior = 0.3 * rng.standard_normal((9, 8)), 0.3 * rng.standard_normal(6)
    p, q = rng.standard_normal(3), rotations.exp(rng.standard_normal(3))
    pm, qm = (
        p + 0.1 * rng.standard_normal(3),
        rotations.multiply(q, rotations.exp(0.2 * rng.standard_normal(3))),
    )
    qm *= rng.choice([-1.0, 1.0])
    twist, still = np.zeros(6), CameraMotion(np.zeros(3), q, np.zeros(3), np.zeros(3))
    model_twist(pm, qm, prior, True, form == "stacked", w, basis.centres, basis.precision, 1.0, twist)
    state = world_feedback(p, q, twist, 0.05, pm, qm, still, still, s)
    sigma, error, fast = np.zeros(9), np.zeros(8), np.zeros(6)
    residual = measured_step(
        p, q, fast, sigma, error, pm, qm, 0.05, prior, True, form == "stacked", w, basis.centres, basis.precision, 1.0,
        s.k1_per_s, s.k2, SWITCHING[s.switching], s.boundary_layer,
    )  # fmt: skip
    np.testing.assert_allclose(fast, twist, atol=1e-14)
    np.testing.assert_allclose(p, state.p, atol=1e-14)
    np.testing.assert_allclose(q, state.q, atol=1e-14)
    np.testing.assert_allclose(error, state.error, atol=1e-14)
    np.testing.assert_allclose(sigma, basis(pm, qm))
    assert residual == pytest.approx(state.residual_m)


@pytest.mark.parametrize("alpha", [1.0, 0.3])
def test_the_kept_inverse_follows_the_stack(alpha: float) -> None:
    """Steps with rank-one updated inverses equal steps with freshly solved equations, while the stack churns."""
    rng = np.random.default_rng(4)
    s = EstimatorSettings(alpha=alpha, kcl=3.0, stack=StackSettings(size=12))
    model = MotionModel(s, 9, 0.05)
    w = np.zeros((9, 8))
    for _ in range(80):
        row = rng.uniform(0, 1, 9) * (rng.uniform(0, 1, 9) < 0.4)
        model.learn_window(0.0, row, rng.standard_normal(8), rng.uniform(0.2, 1))
        if alpha < 1.0:
            model.learn_rate(0.0, row, rng.standard_normal(8))
        sigma, e = rng.uniform(0, 1, 9), 0.1 * rng.standard_normal(8)
        model.step(sigma, e)
        moment = alpha * model.integral.moment + (1 - alpha) * model.instantaneous.moment
        left = np.eye(9) + 0.05 * 3.0 * (model.psi + s.leakage * np.eye(9))
        w = np.linalg.solve(left, w + 0.05 * (np.outer(sigma, e) + 3.0 * moment))
        np.testing.assert_allclose(model.weights, w, atol=1e-9)


@pytest.mark.parametrize("form", FORMS)
def test_weights_converge_to_the_true_ones(form: str) -> None:
    """Exact windows of a system with known W and finite excitation: V decreases and W_til goes to zero."""
    rng = np.random.default_rng(0)
    s = EstimatorSettings(form=form, leakage=0.0, kcl=5.0)
    model, w_true = MotionModel(s, 8, 1 / 30), 0.3 * rng.standard_normal((8, 8))
    for _ in range(60):
        row = rng.uniform(0, 0.6, 8)
        model.learn_window(0.0, row, row @ w_true)
    assert model.excited_s() == 0.0
    norms = []
    for _ in range(3000):
        norms.append(float(np.linalg.norm(w_true - model.weights)))
        model.step()
    assert (np.diff(norms) <= 1e-12).all()
    # |W_til| falls at least at the rate kCL lambda_min of the analysis
    rate = 5.0 * np.linalg.eigvalsh(model.psi)[0]
    assert norms[-1] <= norms[0] * (1 + rate / 30) ** -3000 + 1e-12
    assert norms[-1] < 1e-3


def test_settling_is_the_stack_law_over_a_long_time() -> None:
    fast, _, _ = _model("twist")
    slow, _, _ = _model("twist")
    fast.settle(40.0, steps=200)
    for _ in range(40_000):
        slow.step()
    np.testing.assert_allclose(fast.weights, slow.weights, atol=5e-3)


@given(seed=st.integers(0, 10_000), dt=st.floats(1e-3, 10.0))
def test_projection_keeps_the_weights_bounded(seed: int, dt: float) -> None:
    rng = np.random.default_rng(seed)
    w = rng.standard_normal((4, 8))
    w *= rng.uniform(0, 2.1) / np.linalg.norm(w)
    after = w + dt * rng.standard_normal((4, 8))
    reference = w + dt * project_rate(w, (after - w) / dt, 2.0, 0.1)
    project_step(w, after, 8, 2.0, 0.1)
    assert np.linalg.norm(after) <= 2.1 + 1e-9
    if np.linalg.norm(reference) <= 2.1:
        np.testing.assert_allclose(after, reference, atol=1e-9)


def test_projected_flow_stays_in_its_ball_and_inward_rates_pass() -> None:
    w = np.array([[1.0, 0.0]])

    def rhs(t: float, y: np.ndarray) -> np.ndarray:
        return project_rate(y, np.array([2.0, 0.5]), 1.0, 0.2)

    path = solve_ivp(rhs, (0, 20), w[0], max_step=0.01).y
    assert np.linalg.norm(path, axis=0).max() <= 1.2 + 1e-6
    np.testing.assert_allclose(
        path[:, -1] / np.linalg.norm(path[:, -1]), np.array([2.0, 0.5]) / math.hypot(2, 0.5), atol=1e-2
    )
    inward = np.array([-1.0, 3.0])
    np.testing.assert_array_equal(project_rate(np.array([1.15, 0.0]), inward, 1.0, 0.2), inward)


@pytest.mark.parametrize("kind", list(SWITCHING))
def test_switching_functions(kind: str) -> None:
    code = SWITCHING[kind]
    for x in (-3.0, -0.01, 0.0, 0.01, 3.0):
        value = switching(x, code, 0.05)
        assert value == pytest.approx(
            {"sign": np.sign(x), "sat": np.clip(x / 0.05, -1, 1), "tanh": math.tanh(x / 0.05)}[kind]
        )


def test_output_error_is_the_transpose_of_the_kinematics() -> None:
    rng = np.random.default_rng(0)
    q = rotations.normalise(rng.standard_normal(4))
    e = rng.standard_normal(7)
    g = np.zeros((7, 6))
    g[:3, :3], g[3:, 3:] = np.eye(3), 0.5 * rotations.kinematic_matrix(q)
    np.testing.assert_allclose(output_error(e, q, False)[:6], g.T @ e)
    np.testing.assert_allclose(output_error(e, q, True)[:7], e)


def _predict(form: str, code: int, duration: float, steps: int) -> tuple[np.ndarray, np.ndarray, object]:
    rng = np.random.default_rng(2)
    basis = RbfBasis.create(rng.uniform(-1, 1, (7, 2)), 0.4)
    w = 0.5 * rng.standard_normal((7, 8))
    w[:, 7] = rng.uniform(0, 0.3, 7)
    prior = np.array([0.3, -0.2, 0.05, 0.1, -0.1, 0.4])
    p, q = np.array([0.1, -0.2, 0.3]), rotations.exp(np.array([0.2, 0.1, 0.7]))
    out = advance(
        p, q, prior.copy(), duration, steps, code, 4.0, 0.8, form == "stacked", w, basis.centres, basis.precision, 1.0,
        LOW, HIGH, np.zeros(6), 0.0, NO_ROADS,
    )  # fmt: skip
    return out[0], out[1], (basis, w, prior, p, q)


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("prior_kind", ["none", "constant_velocity", "constant_turn"])
def test_predictor_follows_its_differential_equation(form: str, prior_kind: str) -> None:
    """(3-15), (4-16) unseen with prior mean, support and handover, written out plainly."""
    code = PRIORS[prior_kind]
    p1, q1, (basis, w, prior, p0, q0) = _predict(form, code, 2.0, 400)  # type: ignore[misc]

    def rhs(t: float, y: np.ndarray) -> np.ndarray:
        p, q, m = y[:3], y[3:7] / np.linalg.norm(y[3:7]), y[7:]
        b = rotations.kinematic_matrix(q)
        out = w.T @ basis(p, q)
        u = np.clip(out[7], 0, 1)
        rates = out[3:6] if form == "twist" else 2 * b.T @ out[3:7]
        twist = np.concatenate((out[:3], rates)) + (1 - u) * m * (code > 0)
        m_dot = (u / 0.8) * (twist - m)
        if code == 2:
            m_dot[:3] += np.cross(rotations.rotate(q, m[3:]), m[:3])
            m_dot[3:] -= m[3:] / 4.0
        return np.concatenate((twist[:3], 0.5 * b @ twist[3:], m_dot))

    y = solve_ivp(rhs, (0, 2.0), np.concatenate((p0, q0, prior)), rtol=1e-9, atol=1e-11).y[:, -1]
    np.testing.assert_allclose(p1, y[:3], atol=4e-3)
    assert abs(q1 @ y[3:7] / np.linalg.norm(y[3:7])) == pytest.approx(1.0, abs=1e-5)


def test_prior_carries_a_constant_velocity_exactly_through_fading_support() -> None:
    """The unit output: model and unit learned from the same data of a constant velocity give it back everywhere."""
    rng = np.random.default_rng(0)
    basis = RbfBasis.create(np.column_stack((np.linspace(0, 3, 7), np.zeros(7))), 0.25)
    model = MotionModel(EstimatorSettings(), 7, 1 / 30)
    v = np.array([0.4, 0.1, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
    for x in rng.uniform(0, 1.2, 20):
        row = 0.4 * basis(np.array([x, 0.0, 0.0]), np.array([1.0, 0, 0, 0]))
        model.learn_window(0.0, row, 0.4 * v)
    model.settle(100.0)
    twist = np.zeros(6)
    support = []
    for x in np.linspace(0.2, 3.0, 29):
        u = model_twist(
            np.array([x, 0.0, 0.0]), np.array([1.0, 0, 0, 0]), v[:6], True, False, model.weights, basis.centres,
            basis.precision, 1.0, twist,
        )  # fmt: skip
        support.append(u)
        if 0.0 < u < 1.0:
            np.testing.assert_allclose(twist[:2], v[:2], atol=1e-9)
    assert support[0] > 0.97
    assert support[-1] < 0.05
    model_twist(
        np.array([3.0, 0.0, 0.0]), np.array([1.0, 0, 0, 0]), v[:6], False, False, model.weights, basis.centres,
        basis.precision, 1.0, twist,
    )  # fmt: skip
    assert abs(twist[0]) < 0.02  # without the prior the printed predictor stops there


def test_rollout_is_the_predictor_repeated_and_changes_nothing() -> None:
    _, _, (basis, w, prior, p, q) = _predict("twist", 2, 0.1, 1)  # type: ignore[misc]
    copy = prior.copy()
    ps, qs = roll_out(
        p, q, prior, 0.1, 20, 2, 2, 4.0, 0.8, False, w, basis.centres, basis.precision, 1.0, LOW, HIGH, 0.0, NO_ROADS,
    )  # fmt: skip
    np.testing.assert_array_equal(prior, copy)
    p1, q1, _ = _predict("twist", 2, 2.0, 40)
    np.testing.assert_allclose(ps[-1], p1, atol=1e-12)
    np.testing.assert_allclose(qs[-1], q1, atol=1e-12)


def test_predictions_stay_in_the_tracking_space() -> None:
    basis = RbfBasis.create(np.zeros((1, 2)), 1.0)
    ps, _ = roll_out(
        np.zeros(3), np.array([1.0, 0, 0, 0]), np.array([1.0, -2.0, 0, 0, 0, 0]), 0.1, 400, 1, 1, 1.0, 1.0, False,
        np.zeros((1, 8)), basis.centres, basis.precision, 1.0, np.full(3, -3.0), np.full(3, 2.0), 0.0,
        NO_ROADS,
    )  # fmt: skip
    assert ps.max() <= 2.5 + 1e-9
    assert ps.min() >= -3.5 - 1e-9
    assert ps[-1, 0] > 2.0


def test_printed_settings_switch_every_remedy_off() -> None:
    gap = GapSettings(prior="none", learn_across=False)
    assert PRIORS[gap.prior] == 0
