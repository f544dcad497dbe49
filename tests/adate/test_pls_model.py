import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from camnet.errors import ConfigError
from camnet.estimation.pls import (
    ConstantTurn,
    PowerLimitedSteering,
    compensation,
    equilibrium_speed,
    linear_form,
    speed_transition,
)
from camnet.estimation.pls.reference import derivative, ode_flow, simulate

ALPHA, BETA = 0.01, 0.4


def _speed(r: float, p: float, tau: float) -> float:
    state = np.zeros(10)
    state[3], state[6] = r, p
    return float(ode_flow(state, tau, ALPHA, BETA)[3])


@pytest.mark.parametrize("p", [-6.0, -4.0, -3.0, -1.0, -1e-3, -1e-9, 0.0, 1e-12, 1e-6, 0.05, 0.41, 3.0])
@pytest.mark.parametrize("r", [1.6, 2.5, 30.0])
@pytest.mark.parametrize("tau", [1e-3, 0.1])
def test_speed_and_its_derivatives_match_the_differential_equation(r, p, tau):
    r1, psi, power = speed_transition(r, p, tau, ALPHA, BETA)
    assert r1 == pytest.approx(_speed(r, p, tau), rel=1e-11)
    h = 1e-3
    dr = (_speed(r + h, p, tau) - _speed(r - h, p, tau)) / (2 * h)
    dp = (_speed(r, p + h, tau) - _speed(r, p - h, tau)) / (2 * h)
    assert psi == pytest.approx(dr, abs=1e-6)
    assert power == pytest.approx(dp, rel=1e-5)


def test_speed_is_continuous_across_zero_power_and_across_the_branch():
    branch = -3.0 * BETA**2 / (16.0 * ALPHA)
    for r in (0.5, 2.0, 15.0):
        for centre in (0.0, branch):
            around = [speed_transition(r, centre + d, 1.0, ALPHA, BETA) for d in (-1e-9, 0.0, 1e-9)]
            np.testing.assert_allclose(around[0], around[1], rtol=1e-6, atol=1e-8)
            np.testing.assert_allclose(around[2], around[1], rtol=1e-6, atol=1e-8)


def test_a_braking_body_stops_and_stays():
    assert speed_transition(1.0, 0.0, 10.0, ALPHA, BETA) == (0.0, 0.0, 0.0)
    assert speed_transition(1.0, -9.0, 5.0, ALPHA, BETA) == (0.0, 0.0, 0.0)
    assert speed_transition(0.0, -1.0, 1.0, ALPHA, BETA)[0] == 0.0
    # r' = -(alpha r + beta) stops after log(1 + alpha r/beta)/alpha
    stop = np.log1p(ALPHA / BETA) / ALPHA
    assert speed_transition(1.0, 0.0, stop * 0.999, ALPHA, BETA)[0] > 0.0
    assert speed_transition(1.0, 0.0, stop * 1.001, ALPHA, BETA)[0] == 0.0


def test_power_starts_a_body_from_rest():
    r1, psi, power = speed_transition(0.0, 2.0, 1e-4, ALPHA, BETA)
    assert r1 == pytest.approx(np.sqrt(2 * 2.0 * 1e-4), rel=2e-2)
    assert psi == 0.0
    assert np.isfinite(power)


@pytest.mark.parametrize("p", [1e-9, 0.41, 5.0])
def test_speed_settles_at_equilibrium(p):
    settled = equilibrium_speed(p, ALPHA, BETA)
    assert settled == pytest.approx((-BETA + np.sqrt(BETA**2 + 4 * ALPHA * p)) / (2 * ALPHA), rel=1e-5)
    assert speed_transition(settled, p, 7.0, ALPHA, BETA)[0] == pytest.approx(settled, rel=1e-9)
    assert speed_transition(3.0, p, 500.0, ALPHA, BETA)[0] == pytest.approx(settled, abs=1e-8)


@given(
    r=st.floats(0.0, 50.0),
    p=st.floats(-20.0, 20.0),
    tau=st.floats(1e-6, 100.0),
    alpha=st.floats(1e-3, 1.0),
    beta=st.floats(1e-2, 2.0),
)
def test_speed_is_finite_and_composes(r, p, tau, alpha, beta):
    whole = speed_transition(r, p, tau, alpha, beta)
    assert np.isfinite(whole).all()
    assert min(whole) >= 0.0
    half = speed_transition(r, p, 0.5 * tau, alpha, beta)[0]
    assert speed_transition(half, p, 0.5 * tau, alpha, beta)[0] == pytest.approx(whole[0], rel=1e-6, abs=1e-5)


state = st.builds(
    lambda v, p, c: np.concatenate([[3.0, -1.0, 2.0], v, [p], c]),
    st.lists(st.floats(-4.0, 4.0), min_size=3, max_size=3),
    st.one_of(st.floats(-3.0, 3.0), st.floats(-1e-6, 1e-6)),
    st.lists(st.floats(-0.5, 0.5), min_size=3, max_size=3),
)


@given(s=state, tau=st.sampled_from([0.01, 0.05]))
def test_phi_is_the_derivative_of_the_flow(s, tau):
    assume(np.linalg.norm(s[3:6]) > 0.5)
    end, phi, _ = PowerLimitedSteering().linearise(s, tau)
    np.testing.assert_allclose(end, ode_flow(s, tau, ALPHA, BETA), rtol=1e-9, atol=1e-9)
    exact = derivative(s, tau, ALPHA, BETA)
    assert np.abs(phi - exact).max() <= 1e-6 * np.abs(exact).max()
    for block in (np.s_[3:6, 3:6], np.s_[3:6, 6:7], np.s_[3:6, 7:10], np.s_[0:3, 7:10]):
        assert np.abs(phi[block] - exact[block]).max() <= 1e-6 * max(np.abs(exact[block]).max(), 1e-3)


def test_linear_form_reproduces_the_flow_to_first_order_in_the_turn():
    s = np.array([0.0, 0.0, 0.0, 1.2, -0.3, 0.1, 0.5, 1e-4, 2e-4, -1e-4])
    for p in (-0.3, 0.0, 0.5):
        s[6] = p
        phi = linear_form(s, 0.2, ALPHA, BETA)
        assert np.isfinite(phi).all()
        np.testing.assert_allclose((phi @ s)[3:6], PowerLimitedSteering().step(s, 0.2)[3:6], atol=1e-6)


def test_process_covariance_matches_monte_carlo():
    count = 40_000
    model = PowerLimitedSteering(
        power_density=1e-5, steering_density=(4e-6, 2e-6, 8e-6), velocity_density=1e-14
    )
    rng = np.random.default_rng(5)
    for s in (
        np.array([0, 0, 0, 1.0, 0.3, 0.2, 0.41, 0.05, -0.1, 0.03]),
        np.array([0, 0, 0, 2.0, -1.0, 0.2, -0.4, 0.0, 0.2, 0.3]),
    ):
        q = model.linearise(s, 1.0)[2]
        sample = np.cov(simulate(model, s, 1.0, count, 40, rng).T)
        # standard error of a sample covariance: sqrt((q_ii q_jj + q_ij^2)/N)
        error = np.sqrt((np.outer(np.diag(q), np.diag(q)) + q**2) / count)
        assert np.abs((sample - q) / error).max() < 5.0


def test_process_covariance_is_the_integral_of_the_flows_derivative():
    model = PowerLimitedSteering(velocity_density=1e-14)
    nodes, weights = np.polynomial.legendre.leggauss(8)
    density = np.diag([1e-4, 5e-5, 5e-5, 5e-5])
    for p in (-0.3, 0.0, 0.9):
        s = np.array([0, 0, 0, 1.0, 0.4, -0.2, p, 0.3, -0.1, 0.2])
        exact = np.zeros((10, 10))
        for x, w in zip(0.5 + 0.5 * nodes, 0.5 * weights, strict=True):
            b = model.linearise(model.step(s, x), 1.0 - x)[1][:, 6:]
            exact += w * b @ density @ b.T
        sd = np.sqrt(np.diag(exact))
        assert np.abs((model.linearise(s, 1.0)[2] - exact) / np.outer(sd, sd)).max() < 2e-3


@given(s=state, tau=st.floats(0.01, 2.0))
def test_process_covariance_is_positive_definite_everywhere(s, tau):
    for scale in (1.0, 1e-3, 0.0):
        s = s.copy()
        s[3:6] *= scale
        for model in (PowerLimitedSteering(), ConstantTurn()):
            end, phi, q = model.linearise(s, tau)
            assert np.isfinite(end).all()
            assert np.isfinite(phi).all()
            sd = np.sqrt(np.diag(q))
            assert np.linalg.eigvalsh(q / np.outer(sd, sd))[0] > 0.0


def test_compensation_against_its_integral_and_monte_carlo():
    # (58) with E[r r1] = D s^2/2, by quadrature: the printed (18) lacks one factor mu
    r, p, tau, density = 1.3, 1.4, 1.0, 1e-3
    mu = p - r * (ALPHA * r + BETA)
    s = np.linspace(0.0, tau, 20_001)
    value = -r * np.trapezoid(0.5 * s**2 * density / (r**2 + s * mu) ** 2, s)
    assert compensation(r, p, tau, ALPHA, BETA, density) == pytest.approx(value, rel=1e-7)
    # continuous where mu vanishes
    balanced = r * (ALPHA * r + BETA)
    near = [compensation(r, balanced + d, tau, ALPHA, BETA, density) for d in (-1e-2, 0.0, 1e-2)]
    assert near[1] == pytest.approx(0.5 * (near[0] + near[2]), rel=1e-3)
    # it has the sign of the measured shift of the mean speed
    model = PowerLimitedSteering(power_density=0.02, steering_density=1e-12)
    state = np.array([0, 0, 0, 1.0, 0, 0, 0.41, 0, 0, 0])
    drawn = simulate(model, state, 1.0, 200_000, 20, np.random.default_rng(0))[:, 3]
    shift, error = drawn.mean() - model.step(state, 1.0)[3], drawn.std() / np.sqrt(len(drawn))
    assert shift < -3.0 * error
    assert compensation(1.0, 0.41, 1.0, ALPHA, BETA, 0.02) < 0.0
    compensated = PowerLimitedSteering(power_density=0.02, steering_density=1e-12, compensate=True)
    assert abs(drawn.mean() - compensated.step(state, 1.0)[3]) < abs(shift)


@pytest.mark.parametrize(
    ("name", "value"), [("alpha", 0.0), ("beta", -1.0), ("power_density", np.nan), ("steering_density", 0.0)]
)
def test_bad_parameters_are_named(name, value):
    with pytest.raises(ConfigError, match=name):
        PowerLimitedSteering(**{name: value})
