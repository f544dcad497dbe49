"""Dwell times against hand numbers and against numerical integration of the comparison systems."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from camnet.certification.average_dwell import average_dwell
from camnet.certification.bell_dwell import (
    MovingTargetConstants,
    landmark_off_max,
    landmark_off_max_learned,
    landmark_off_max_sound,
    landmark_on_min_first,
    landmark_on_min_later,
    moving_target_initial_max,
    moving_target_off_max,
)
from camnet.certification.constants import EstimatorBounds, published, sound
from camnet.certification.dwell import DwellBounds
from camnet.errors import CertificateError

BOUNDS = EstimatorBounds(
    k=3.0, kcl=1.0, gamma_inv_min=0.5, gamma_inv_max=2.0, alpha=1.0, window_s=0.1, stack_size=600, eps_bar=0.001,
    etadot_max=0.25, sigma_bar=3.0, weight_bound=0.2, lambda_min_psi=1.0,
)  # fmt: skip


def integrate(rate, source, v0, duration):
    """V' = rate V + source by an adaptive Runge-Kutta method."""
    result = solve_ivp(
        lambda t, v: rate * v + source, (0, duration), [v0], rtol=1e-12, atol=1e-14, method="DOP853"
    )
    return result.y[0, -1]


def seen(c, v0, duration, excited):
    if excited:
        return integrate(-c.lambda_dt, c.c1, v0, duration)  # (4-29)
    return integrate(-c.lambda_d, c.lambda_d * c.c2 + c.c1, v0, duration)


def test_stationary_worked_example_by_hand():
    # k = 2, kcl = 1, Gamma = I, alpha = 1, Dt = 0.5, N = 10, eps = 0.01, etadot = 0.5, Psi: 4; R = 2, V_lo = 1
    b = EstimatorBounds(
        k=2, kcl=1, gamma_inv_min=1, gamma_inv_max=1, alpha=1, window_s=0.5, stack_size=10, eps_bar=0.01,
        etadot_max=0.5, sigma_bar=1, weight_bound=0.5, lambda_min_psi=4,
    )  # fmt: skip
    p = published(b)
    assert p.c1 == pytest.approx(0.05, rel=1e-12)  # 2 x 1 x 10 x 0.5 x 0.01 x 0.5
    assert p.c2 == pytest.approx(0.5, rel=1e-12)  # 2 x 0.25
    assert p.c3 == pytest.approx(2.07005, rel=1e-12)  # (2.01)^2 / 2 + 0.05
    assert p.beta1 == pytest.approx(0.5125, rel=1e-12)  # 0.05 / 4 + 0.5
    assert p.c_ub == pytest.approx(0.0125, rel=1e-12)  # 0.05 / 4
    d = DwellBounds(p, v_hi=2.0, v_lo=1.0)
    assert d.off_max(5, 0, d=False, h=False).seconds == pytest.approx(math.log(2), rel=1e-12)  # (3-31)
    assert d.on_min(h=False).seconds == pytest.approx(-math.log(0.4875 / 2) / 4, rel=1e-12)  # (3-35)
    assert d.on_min(h=True).seconds == pytest.approx(-math.log(0.9875 / 2) / 4, rel=1e-12)
    s = sound(b)  # c1 = 2 x 10 x 0.5 x 0.01 x 0.25 = 0.025, c3 = 2.01^2/2 + 0.025
    assert (s.c1, s.c3) == (pytest.approx(0.025, rel=1e-12), pytest.approx(2.04505, rel=1e-12))
    off = DwellBounds(s, v_hi=2.0, v_lo=1.0).off_max(5, 0, d=False, h=False).seconds
    assert off == pytest.approx(math.log(4.04505 / 3.04505), rel=1e-12)  # 0.284 s where 0.693 s is printed


@pytest.mark.parametrize("mobile", [False, True])
def test_sound_off_time_is_exactly_when_the_comparison_system_reaches_v_hi(mobile):
    c = sound(BOUNDS, mobile=mobile)
    bounds = DwellBounds(c, v_hi=2.0, v_lo=1.0)
    for d, h in ((False, False), (True, False), (True, True)):
        on, excited = 4.0, 2.5
        off = bounds.off_max(on, excited, d=d, h=h).seconds
        exit_level = bounds.v_lo if not mobile else bounds._at_exit(on, excited, d=d, h=h)
        assert integrate(c.lambda_g, c.c3, exit_level, off) == pytest.approx(2.0, rel=1e-9)


def test_published_off_time_lets_the_comparison_system_pass_v_hi():
    c = published(BOUNDS)
    off = DwellBounds(c, v_hi=2.0, v_lo=1.0).off_max(1, 0, d=False, h=False).seconds
    assert integrate(c.lambda_g, c.c3, 1.0, off) > 2.0


@given(st.floats(0.1, 20), st.floats(0, 1), st.sampled_from([(False, False), (True, False), (True, True)]))
@settings(max_examples=40, deadline=None)
def test_exit_level_bounds_the_integrated_comparison_system(on, share, case):
    d, h = case
    c = sound(BOUNDS, mobile=True)
    bounds = DwellBounds(c, v_hi=2.0, v_lo=1.0)
    excited = on * share
    if h:
        level = seen(c, bounds.v_on, on, True)
    elif d:
        level = seen(c, seen(c, bounds.v_on, on - excited, False), excited, True)
    else:
        level = seen(c, bounds.v_on, on, False)
    assert level <= bounds._at_exit_excited(on, excited, h=h) * (1 + 1e-9) if d else True
    assert seen(c, bounds.v_on, on, False) <= bounds._at_exit(on, excited, d=False, h=False) * (1 + 1e-9)


@pytest.mark.parametrize("mobile", [False, True])
@pytest.mark.parametrize("h", [False, True])
@pytest.mark.parametrize("make", [published, sound])
def test_after_the_on_time_the_comparison_system_is_below_v_lo(make, h, mobile):
    c = make(BOUNDS, mobile=mobile)
    bounds = DwellBounds(c, v_hi=2.0, v_lo=1.0)
    on = bounds.on_min(h=h).seconds
    assert on > 0
    rates = [h] if make is published else [h, False]
    assert min(seen(c, bounds.v_on, on, e) for e in rates) <= 1.0 + 1e-9


def test_mobile_published_matches_the_formula_written_out():
    c = published(BOUNDS, mobile=True)
    b = DwellBounds(c, v_hi=2.0, v_lo=1.0)
    nu1, nu3 = math.exp(-c.lambda_d * 3), math.exp(-c.lambda_dt * 2)
    nu2, nu4 = math.exp(-c.lambda_d * 1 - c.lambda_dt * 2), math.exp(-c.lambda_dt * 3)
    expected = {
        (False, False): math.log(2 / (2 * nu1 + c.beta1)) / c.lambda_g,
        (True, False): math.log(2 / (2 * nu2 + c.beta1 * nu3 + c.c_ub)) / c.lambda_g,
        (True, True): math.log(2 / (2 * nu4 + c.c_ub)) / c.lambda_g,
    }
    for (d, h), value in expected.items():
        assert b.off_max(3.0, 2.0, d=d, h=h).seconds == pytest.approx(value, rel=1e-12)
    assert b.on_min(h=True).seconds == pytest.approx(-math.log((1 - c.c_ub) / 2) / c.lambda_dt, rel=1e-12)


def test_the_next_regions_own_model_enters_at_the_handoff():
    c = sound(BOUNDS, mobile=True)
    own, shared = DwellBounds(c, 2.0, 1.0), DwellBounds(c, 2.0, 1.0, shared_model=True)
    assert own.v_on == 2.0 + c.c2
    assert shared.v_on == 2.0
    assert own.on_min(h=True).seconds > shared.on_min(h=True).seconds


def test_impossible_conditions_give_their_reason_and_no_nan():
    c = sound(
        EstimatorBounds(
            **{n: getattr(BOUNDS, n) for n in BOUNDS.__slots__} | {"weight_bound": 20.0, "eps_bar": 0.1}
        ),
        mobile=True,
    )
    bounds = DwellBounds(c, v_hi=2.0, v_lo=1.0)
    for time in (bounds.on_min(h=False), bounds.on_min(h=True), bounds.off_max(9, 9, d=False, h=False)):
        assert not time.possible
        assert "below" in time.reason
    with pytest.raises(CertificateError, match="v_lo"):
        DwellBounds(c, v_hi=2.0, v_lo=0.0)


def test_printed_4_35_does_not_bring_the_next_regions_level_down():
    """The numbers of the theory page: the next region's weights are still at the other side of their ball."""
    rate, beta1, c2, v_hi, v_lo = 4.0, 0.5125, 0.5, 2.0, 1.0
    printed = math.log(v_hi / (v_lo - beta1)) / rate
    v_on = v_hi + c2  # V_{j+1}: the common pose error at V_hi, and the weights' own part
    assert v_on * math.exp(-rate * printed) + beta1 == pytest.approx(1.121875, rel=1e-12)  # above V_lo
    b = EstimatorBounds(
        k=2, kcl=1, gamma_inv_min=1, gamma_inv_max=1, alpha=1, window_s=0.5, stack_size=10, eps_bar=0.01,
        etadot_max=0.5, sigma_bar=1.0, weight_bound=0.5, lambda_min_psi=4,
    )  # fmt: skip
    own, shared = (DwellBounds(sound(b, mobile=True), 2.0, 1.0, shared_model=x) for x in (False, True))
    c = own.constants
    assert own.on_min(h=False).seconds == pytest.approx(math.log((2 + c.c2) / (1 - c.beta1)) / 4, rel=1e-12)
    assert shared.on_min(h=False).seconds == pytest.approx(math.log(2 / (1 - c.beta1)) / 4, rel=1e-12)
    assert (2 + c.c2) * math.exp(-4 * own.on_min(h=False).seconds) + c.beta1 == pytest.approx(1.0, rel=1e-12)


# ---- parikh2018


@pytest.mark.parametrize("make", [published, sound])
@pytest.mark.parametrize("excited", [False, True])
def test_average_dwell_fixed_point_is_the_limit_of_the_iterated_envelope(make, excited):
    c = make(BOUNDS)
    on, off = [6.0, 1.5, 4.0], [0.5, 2.0, 0.2]
    result = average_dwell(c, on, off, excited=excited)
    assert result.satisfied
    rate, floor = (c.lambda_dt, c.c_ub) if excited else (c.lambda_d, c.beta1)
    v, peak = 0.0, 0.0
    for _ in range(200):
        peak = 0.0
        for a, b in zip(on, off, strict=True):
            peak = max(peak, v + floor)
            v = v * math.exp(-rate * a) + floor
            v = (v + c.growth_offset) * math.exp(c.lambda_g * b) - c.growth_offset
            peak = max(peak, v)
    assert result.v_start == pytest.approx(v, rel=1e-10)
    assert result.v_peak >= peak * (1 - 1e-12)
    assert result.error_bound == pytest.approx(math.sqrt(2 * result.v_peak / c.gamma1))


def test_average_dwell_is_weaker_than_a_per_cycle_condition():
    c = sound(BOUNDS)
    on, off = [9.0, 0.1], [0.1, 2.0]
    assert average_dwell(c, on, off, excited=True).satisfied
    assert not average_dwell(c, on[1:], off[1:], excited=True).satisfied
    assert average_dwell(c, [1e4], [1e3], excited=True).v_peak == math.inf
    with pytest.raises(CertificateError, match="intervals"):
        average_dwell(c, [1.0], [], excited=True)


# ---- bell2019


def test_bell_check_value():
    assert landmark_on_min_first(0.3, 30.0, 5.0, 0.01).seconds == pytest.approx(0.75, abs=0.005)
    assert landmark_on_min_first(0.3, 30.0, 5.0, 0.01).seconds == pytest.approx(
        math.log(500 * 3**0.5) / 9, rel=1e-12
    )
    assert landmark_on_min_later(0.3, 30.0, 0.01, 0.1).seconds == pytest.approx(math.log(10) / 9, rel=1e-12)
    assert landmark_off_max(0.01, 0.41, 0.5).seconds == pytest.approx(0.2, rel=1e-12)
    assert not landmark_off_max(0.4, 0.3, 0.5).possible


def test_bell_out_of_view_drift_is_bounded_by_the_published_factor():
    rng = np.random.default_rng(0)
    for _ in range(500):
        u = rng.normal(size=(4, 3))
        u /= np.linalg.norm(u, axis=1, keepdims=True)
        v = rng.normal(size=3)
        drift = np.array([(u[1] - u[0]) @ v, (u[3] - u[2]) @ v, 0.0])
        assert np.linalg.norm(drift) <= 2 * math.sqrt(2) * np.linalg.norm(v) + 1e-12


def test_bell_moving_target_against_integration():
    c = MovingTargetConstants.from_bounds(
        camera_rate_radps=0.2, weight_bound=0.3, sigma_bar=1.5, sigma_eta=0.8, sigma_nu=0.5, nu_bar=0.5, phi_q=1.0,
        eps_bar=0.02, gamma_inv_min=1.0, gamma_inv_max=1.0, k_eta_min=4.0, k_nu_min=6.0, k_w_min=1.0, k_w_max=1.0,
        stack_lambda=2.0, stack_norm=9.0, stack_size=10, window_s=0.1,
    )  # fmt: skip
    assert c.c1 == pytest.approx((1 + 0.75 + 0.12 + 0.15) / 0.5, rel=1e-12)
    assert c.c3 == pytest.approx(2.0, rel=1e-12)  # min(4, 3, 1) / 0.5
    assert c.c4 == pytest.approx(0.0004 / 12 + (3 * 10 * 0.02 * 0.1) ** 2 / 4, rel=1e-12)
    e = 1.2
    first = moving_target_initial_max(c, 0.1, e).seconds
    assert integrate(max(c.c1, c.c5), c.c2, 0.1, first) == pytest.approx(0.5 * e * e, rel=1e-9)
    off = moving_target_off_max(c, 3.0, e).seconds
    exit_level = integrate(-c.c3, c.c4, 0.5 * e * e, 3.0)
    assert integrate(c.c5, c.c2, exit_level, off) == pytest.approx(0.5 * e * e, rel=1e-9)
    assert not moving_target_off_max(c, 0.0, e).possible
    assert not moving_target_initial_max(c, 1.0, e).possible


BELL = {
    landmark_on_min_first: {"lambda_a": 0.3, "kx_min": 30.0, "d_max_m": 5.0, "error_lo_m": 0.01},
    landmark_on_min_later: {"lambda_a": 0.3, "kx_min": 30.0, "error_lo_m": 0.01, "error_hi_m": 0.1},
    landmark_off_max: {"error_lo_m": 0.01, "error_hi_m": 0.41, "camera_speed_mps": 0.5},
    landmark_off_max_sound: {
        "error_lo_m": 0.01, "error_hi_m": 0.41, "speed_error_mps": 0.01, "rate_error_radps": 0.002, "d_max_m": 5.0,
    },
}  # fmt: skip


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, -1.0, 0.0])
@pytest.mark.parametrize(("form", "name"), [(form, name) for form, values in BELL.items() for name in values])
def test_bell_landmark_refuses_what_is_no_positive_number(form, name, value):
    if value == 0.0 and name.endswith(("_error_mps", "_error_radps")):
        assert form(**{**BELL[form], name: value}).possible
        return
    with pytest.raises(CertificateError, match=f"{name} = "):
        form(**{**BELL[form], name: value})


def test_bell_refuses_impossible_numbers():
    with pytest.raises(CertificateError, match=r"lambda_a = 1\.5"):
        landmark_on_min_first(1.5, 30.0, 5.0, 0.01)
    with pytest.raises(CertificateError, match="one must be > 0"):
        landmark_off_max_sound(0.01, 0.4, 0.0, 0.0, 5.0)
    assert not landmark_on_min_later(0.3, 30.0, 0.1, 0.1).possible
    values = {
        "camera_rate_radps": 0.2, "weight_bound": 0.3, "sigma_bar": 1.5, "sigma_eta": 0.8, "sigma_nu": 0.5,
        "nu_bar": 0.5, "phi_q": 1.0, "eps_bar": 0.02, "gamma_inv_min": 1.0, "gamma_inv_max": 1.0, "k_eta_min": 4.0,
        "k_nu_min": 6.0, "k_w_min": 1.0, "k_w_max": 1.0, "stack_lambda": 2.0, "stack_norm": 9.0, "stack_size": 10,
        "window_s": 0.1,
    }  # fmt: skip
    constants = MovingTargetConstants.from_bounds(**values)
    for name in values:
        for value in (math.nan, -1.0):
            with pytest.raises(CertificateError, match=f"{name} = "):
                MovingTargetConstants.from_bounds(**{**values, name: value})
    with pytest.raises(CertificateError, match="v0 = nan"):
        moving_target_initial_max(constants, math.nan, 1.0)
    with pytest.raises(CertificateError, match="on_s = -1"):
        moving_target_off_max(constants, -1.0, 1.0)


def test_bell_sound_time_out_of_view_holds_against_hostile_velocities():
    """Predictor and truth integrated with velocity errors at their bounds, chosen to do most harm."""
    lo, hi, dv, dw, d_max = 0.02, 0.2, 0.02, 0.005, 4.0
    seconds = landmark_off_max_sound(lo, hi, dv, dw, d_max).seconds
    rng = np.random.default_rng(0)
    worst = 0.0
    for _ in range(40):
        v, w = 0.4 * rng.normal(size=3), 0.3 * rng.normal(size=3)
        start = rng.normal(size=(2, 3))
        start *= (rng.uniform(0.5, 2.0, 2) / np.linalg.norm(start, axis=1))[:, None]
        # the distances err by lo in all, the directions are right when the view is lost
        shares = rng.normal(size=2)
        off = lo * shares / np.linalg.norm(shares)
        guess = start * (1.0 + off / np.linalg.norm(start, axis=1))[:, None]
        p, q = start.copy(), guess.copy()
        dt, largest = seconds / 400, 0.0
        for _ in range(400):
            e = (q - p)[int(np.argmax(np.linalg.norm(q - p, axis=1)))]
            e = e / np.linalg.norm(e)
            turn = np.cross(q[0], e)
            bad_w = w - dw * turn / max(np.linalg.norm(turn), 1e-12)
            q = q + dt * (-(v - dv * e) - np.cross(bad_w, q))
            p = p + dt * (-v - np.cross(w, p))
            largest = max(largest, np.linalg.norm(q, axis=1).max())
            if largest > d_max:
                break
            error = np.linalg.norm(np.linalg.norm(q, axis=1) - np.linalg.norm(p, axis=1))
            worst = max(worst, error)
            assert error <= hi
    assert worst > 0.3 * hi


def test_bell_learned_time_out_of_view():
    rng = np.random.default_rng(1)
    held = 0
    for _ in range(200):
        growths = np.abs(rng.normal(0.0, 0.01, 60))
        seconds = landmark_off_max_learned(0.01, 0.11, growths.tolist()).seconds
        # share of new cases that stay below the upper threshold
        held += math.erf(0.1 / seconds / 0.01 / math.sqrt(2.0)) >= 0.95
    assert held / 200 >= 0.92
    few = landmark_off_max_learned(0.01, 0.11, [0.01] * 58)
    assert not few.possible
    assert "59 are needed" in few.reason
    assert not landmark_off_max_learned(0.01, 0.11, [-0.01] * 60).possible
    with pytest.raises(CertificateError, match="share = 1"):
        landmark_off_max_learned(0.01, 0.11, [0.01] * 60, share=1.0)
    with pytest.raises(CertificateError, match="holds nan"):
        landmark_off_max_learned(0.01, 0.11, [math.nan] * 60)
