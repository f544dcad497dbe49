"""Constants against an independent decimal evaluation, and the inequality chain against random systems."""

from __future__ import annotations

import math
from decimal import Decimal, getcontext

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from camnet.certification.constants import (
    EstimatorBounds,
    lattice_sigma_bar,
    published,
    sound,
    switching_residue,
)
from camnet.errors import CertificateError

getcontext().prec = 50

BASE = EstimatorBounds(
    k=3.0, kcl=0.7, gamma_inv_min=0.5, gamma_inv_max=2.0, alpha=0.6, window_s=0.1, stack_size=20, eps_bar=0.01,
    etadot_max=0.35, sigma_bar=3.2, weight_bound=0.5, lambda_min_psi=1.5,
)  # fmt: skip


def decimal_constants(b: EstimatorBounds, *, mobile: bool, repaired: bool) -> dict[str, Decimal]:
    """The formulas written out a second time, in 50-digit arithmetic and term by term."""
    d = {name: Decimal(getattr(b, name) or 0) for name in EstimatorBounds.__slots__}
    one, two = Decimal(1), Decimal(2)
    if repaired:
        per_window = d["sigma_bar"] * d["window_s"] * d["eps_bar"] * d["window_s"]
        per_sample = d["sigma_bar"] * d["eps_bar"]
        w_til = two * d["weight_bound"]
        stack = d["stack_size"] * (d["alpha"] * per_window + (one - d["alpha"]) * per_sample)
        c1 = d["kcl"] * w_til * stack
        speed = w_til * d["sigma_bar"] + d["weight_bound"] * two * d["sigma_bar"] + d["eps_bar"]
    else:
        w_til = two * d["etadot_max"]
        c1 = (
            d["kcl"]
            * w_til
            * d["stack_size"]
            * d["eps_bar"]
            * (d["alpha"] * d["window_s"] + (one - d["alpha"]))
        )
        speed = (Decimal(6) if mobile else Decimal(4)) * d["etadot_max"] + d["eps_bar"]
    c2 = d["gamma_inv_max"] * w_til * w_til / two
    slow = min(d["k"], d["kcl"] * d["lambda_min_psi"])
    g1, g2 = min(one, d["gamma_inv_min"]), max(one, d["gamma_inv_max"])
    return {
        "c1": c1,
        "c2": c2,
        "c3": speed * speed / two + c1,
        "beta1": c1 / (two * d["k"]) + c2,
        "c_ub": c1 * g2 / (two * slow),
        "lambda_d": two * d["k"],
        "lambda_dt": two * slow / g2,
        "lambda_g": one / g1,
    }


positive = st.floats(0.01, 50.0)
bounds_strategy = st.builds(
    EstimatorBounds,
    k=positive,
    kcl=positive,
    gamma_inv_min=st.floats(0.05, 1.0),
    gamma_inv_max=st.floats(1.0, 20.0),
    alpha=st.floats(0.0, 1.0),
    window_s=st.floats(0.01, 2.0),
    stack_size=st.integers(1, 2000),
    eps_bar=st.floats(0.0, 1.0),
    etadot_max=positive,
    sigma_bar=st.floats(0.1, 10.0),
    weight_bound=positive,
    lambda_min_psi=st.floats(1e-4, 50.0),
)


@given(bounds_strategy, st.booleans())
@settings(max_examples=150, deadline=None)
def test_both_certificates_agree_with_decimal_arithmetic(bounds, mobile):
    for make, repaired in ((published, False), (sound, True)):
        got = make(bounds, mobile=mobile)
        for name, value in decimal_constants(bounds, mobile=mobile, repaired=repaired).items():
            assert getattr(got, name) == pytest.approx(float(value), rel=1e-12, abs=1e-300), (
                make.__name__,
                name,
            )


def test_learning_lowers_the_floor_and_never_raises_the_rate():
    # Remark 3.4 says lambda_DT > lambda_D; by the definitions it is never larger
    for make in (published, sound):
        c = make(BASE)
        assert c.lambda_dt <= c.lambda_d
        assert c.c_ub < c.beta1


def random_error_system(rng, b, states=7, p=6):
    """One random state of the closed loop that respects the assumed bounds; returns exact V and V' in each mode."""

    def bounded(shape, radius):
        x = rng.normal(size=shape)
        return x * radius * rng.uniform(0.5, 1.0) / np.linalg.norm(x)

    w, w_hat = bounded((p, states), b.weight_bound), bounded((p, states), b.weight_bound)
    if rng.random() < 0.5:
        w_hat = -w  # the largest weight error
    w_til = w - w_hat
    eta_til = bounded(states, rng.uniform(0.0, 3.0))
    sig, sig_hat = bounded(p, b.sigma_bar), bounded(p, b.sigma_bar)
    eps = bounded(states, b.eps_bar)
    k_sw = 1.5 * b.eps_bar
    psi, disturb = np.zeros((p, p)), np.zeros((p, states))
    for _ in range(b.stack_size):
        y, e = b.window_s * bounded(p, b.sigma_bar), b.window_s * bounded(states, b.eps_bar)
        if rng.random() < 0.7:  # the worst direction of each entry
            e = -b.window_s * b.eps_bar * (w_til.T @ y) / max(np.linalg.norm(w_til.T @ y), 1e-12)
        psi += b.alpha * np.outer(y, y)
        disturb += b.alpha * np.outer(y, e)
        y, e = bounded(p, b.sigma_bar), bounded(states, b.eps_bar)
        psi += (1 - b.alpha) * np.outer(y, y)
        disturb += (1 - b.alpha) * np.outer(y, e)
    gamma_inv = b.gamma_inv_max
    value = 0.5 * eta_til @ eta_til + 0.5 * gamma_inv * np.sum(w_til**2)
    learn = -b.kcl * np.sum(w_til * (psi @ w_til + disturb))
    seen = eta_til @ (w_til.T @ sig + eps - b.k * eta_til - k_sw * np.sign(eta_til))
    seen += learn - np.sum(w_til * np.outer(sig, eta_til))
    unseen = eta_til @ (w.T @ sig + eps - w_hat.T @ sig_hat) + learn
    return value, seen, unseen, float(np.linalg.eigvalsh(psi)[0])


def test_sound_inequalities_hold_for_random_closed_loops():
    rng = np.random.default_rng(7)
    for _ in range(300):
        gamma_inv = float(rng.uniform(0.3, 3.0))
        b = EstimatorBounds(
            k=float(rng.uniform(0.5, 5)), kcl=float(rng.uniform(0.1, 2)), gamma_inv_min=gamma_inv,
            gamma_inv_max=gamma_inv, alpha=float(rng.uniform()), window_s=float(rng.uniform(0.05, 1.5)), stack_size=8,
            eps_bar=0.05, etadot_max=0.3, sigma_bar=float(rng.uniform(0.5, 4)), weight_bound=0.6, lambda_min_psi=1e-9,
        )  # fmt: skip
        value, seen, unseen, lam = random_error_system(rng, b)
        assert lam > 0
        c = sound(EstimatorBounds(**{n: getattr(b, n) for n in b.__slots__} | {"lambda_min_psi": lam}))
        tol = 1e-12 * (1.0 + abs(seen) + abs(unseen) + c.c3)
        assert seen <= -c.lambda_d * (value - c.beta1) + tol  # (3-23)
        assert seen <= -c.lambda_dt * (value - c.c_ub) + tol  # (3-26)
        assert unseen <= c.lambda_g * value + c.c3 + tol  # (3-29)


def test_published_stack_bound_fails_for_overlapping_kernels():
    # one window, sigma constant with norm 3, residual against the weight error: c1 as printed is too small
    b = EstimatorBounds(
        k=1, kcl=1, gamma_inv_min=1, gamma_inv_max=1, alpha=1, window_s=1.0, stack_size=1, eps_bar=0.1,
        etadot_max=0.5, sigma_bar=3.0, weight_bound=0.5, lambda_min_psi=1,
    )  # fmt: skip
    sigma, eps, w_til = 3.0, 0.1, 1.0  # |W_til| = 2 W_bar
    exact = b.kcl * w_til * (b.window_s * sigma) * (b.window_s * eps)
    assert exact > published(b).c1
    assert exact <= sound(b).c1 * (1 + 1e-12)


def test_known_part_of_the_relative_kinematics_does_no_work():
    # f = -[v_c + w x p; 1/2 B(q) R(q)^T w]: eta_til^T (f(eta) - f(eta_hat)) = 0, so "6" in (4-28) may be "4"
    rng = np.random.default_rng(3)

    def f(p, q, v, w):
        q0, qv = q[0], q[1:]
        b = np.vstack([-qv, q0 * np.eye(3) + np.cross(np.eye(3), -qv)])
        r = (q0**2 - qv @ qv) * np.eye(3) + 2 * np.outer(qv, qv) + 2 * q0 * np.cross(np.eye(3), -qv)
        return -np.concatenate([v + np.cross(w, p), 0.5 * b @ (r.T @ w)])

    for _ in range(50):
        q, q_hat = (x / np.linalg.norm(x) for x in rng.normal(size=(2, 4)))
        p, p_hat, v, w = rng.normal(size=(4, 3))
        eta_til = np.concatenate([p - p_hat, q - q_hat])
        assert abs(eta_til @ (f(p, q, v, w) - f(p_hat, q_hat, v, w))) < 1e-12


@pytest.mark.parametrize(("spacing", "width"), [(0.3, 0.3**0.5), (0.5, 0.5), (1.0, 0.3)])
def test_lattice_supremum_bounds_and_meets_the_finite_grid(spacing, width):
    grid = np.arange(-8, 9) * spacing
    centres = np.stack(np.meshgrid(grid, grid), -1).reshape(-1, 2)
    probe = np.random.default_rng(0).uniform(-spacing, spacing, (400, 2))
    probe[0] = 0.0
    squared = np.exp(-np.sum((probe[:, None] - centres) ** 2, -1) / width**2).sum(1)
    bound = lattice_sigma_bar(spacing, width)
    assert np.sqrt(squared).max() <= bound * (1 + 1e-12)
    assert math.sqrt(squared[0]) == pytest.approx(bound, rel=1e-4)


@pytest.mark.parametrize(
    ("kind", "shape"), [("tanh", np.tanh), ("sat", lambda u: np.clip(u, -1, 1)), ("sign", np.sign)]
)
def test_switching_residue_bounds_what_the_term_leaves(kind, shape):
    delta, eps_bar, gain = 0.05, 0.02, 0.1
    bound = switching_residue(kind, gain, delta, eps_bar, states=7)
    rng = np.random.default_rng(1)
    worst = 0.0
    for _ in range(4000):
        eps = rng.normal(size=7)
        eps *= eps_bar / np.linalg.norm(eps)
        x = rng.normal(size=7) * 10 ** rng.uniform(-3, 0)
        worst = max(worst, x @ eps - gain * x @ shape(x / delta))
    assert worst <= bound + 1e-15


@pytest.mark.parametrize(
    ("field", "value"),
    [("k", 0.0), ("alpha", 1.2), ("eps_bar", -0.1), ("window_s", math.nan), ("stack_size", 0)],
)
def test_bad_bounds_are_named(field, value):
    arguments = {n: getattr(BASE, n) for n in BASE.__slots__} | {field: value}
    with pytest.raises(CertificateError, match=field):
        EstimatorBounds(**arguments)


def test_a_weak_switching_gain_is_refused():
    with pytest.raises(CertificateError, match="does not exceed eps_bar"):
        switching_residue("sign", 0.01, 0.0, 0.1)
