import numpy as np
import pytest

from camnet.estimation.adate.chain import backward, forward, full_phi, solve_normal_equations
from camnet.estimation.adate.scores import fade, scores
from camnet.estimation.kalman.linalg import cholesky, invert3


def _positive(rng, n, low=0.1):
    a = rng.normal(size=(n, n))
    return a @ a.T / n + low * np.eye(n)


def _window(rng, n, condition=1.0):
    """A random chain of ``n`` states with a gap; everything that one Gauss-Newton step needs."""
    scale = np.logspace(0.0, -np.log10(condition) / 2.0, 10)
    return {
        "s": rng.normal(size=(n, 10)),
        "nxt": rng.normal(size=(n, 10)),
        "jac": 0.4 * rng.normal(size=(n, 6, 7)),
        "q": np.array([_positive(rng, 10) * np.outer(scale, scale) for _ in range(n)]),
        "z": rng.normal(size=(n, 3)),
        "r": np.array([_positive(rng, 3) for _ in range(n)]),
        "seen": np.array([not 3 <= i < 6 for i in range(n)]),
        "mean": rng.normal(size=10),
        "cov": _positive(rng, 10),
    }


def _solve(w):
    n = len(w["s"])
    shapes = {"pd": (10,), "pp": (10, 10), "fd": (10,), "fp": (10, 10), "k": (10, 3), "si": (3, 3), "y": (3,)}
    o = {k: np.zeros((n, *v)) for k, v in shapes.items()}
    forward(
        n, w["s"], w["nxt"], w["jac"], w["q"], w["z"], w["r"], w["seen"], w["mean"], w["cov"],
        o["pd"], o["pp"], o["fd"], o["fp"], o["k"], o["si"], o["y"],
    )  # fmt: skip
    d, lam = np.zeros((n, 10)), np.zeros((n, 10))
    backward(n, w["jac"], w["seen"], o["pd"], o["pp"], o["k"], o["si"], o["y"], d, lam)
    return d, lam, o


@pytest.mark.parametrize("n", [1, 2, 9, 30])
def test_step_equals_the_block_cholesky_solution_of_the_normal_equations(n):
    w = _window(np.random.default_rng(n), n)
    d, _, o = _solve(w)
    expected, last = solve_normal_equations(**w)
    np.testing.assert_allclose(d, expected, atol=1e-8)
    np.testing.assert_allclose(o["fp"][-1], last, atol=1e-9)


def test_step_equals_a_dense_least_squares_solution():
    rng = np.random.default_rng(0)
    n = 7
    w = _window(rng, n)
    rows, rhs = [], []

    def add(block_columns, target, cov):
        j = np.zeros((len(target), 10 * n))
        for i, block in block_columns:
            j[:, 10 * i : 10 * i + block.shape[1]] = block
        white = np.linalg.inv(np.linalg.cholesky(cov))
        rows.append(white @ j)
        rhs.append(white @ target)

    add([(0, np.eye(10))], w["mean"] - w["s"][0], w["cov"])
    for i in range(n):
        if w["seen"][i]:
            add([(i, np.eye(3))], w["z"][i] - w["s"][i, :3], w["r"][i])
        if i + 1 < n:
            add([(i, -full_phi(w["jac"][i])), (i + 1, np.eye(10))], w["nxt"][i] - w["s"][i + 1], w["q"][i])
    dense = np.linalg.lstsq(np.vstack(rows), np.concatenate(rhs), rcond=None)[0].reshape(n, 10)
    np.testing.assert_allclose(_solve(w)[0], dense, atol=1e-8)


def test_multipliers_are_the_weighted_transition_errors():
    w = _window(np.random.default_rng(4), 12)
    d, lam, _ = _solve(w)
    for i in range(11):
        error = w["s"][i + 1] + d[i + 1] - w["nxt"][i] - full_phi(w["jac"][i]) @ d[i]
        np.testing.assert_allclose(error, -w["q"][i] @ lam[i + 1], atol=1e-8)


def test_covariances_stay_positive_definite_when_q_is_nearly_singular():
    w = _window(np.random.default_rng(1), 60, condition=1e12)
    _, _, o = _solve(w)
    for p in (*o["pp"], *o["fp"]):
        sd = np.sqrt(np.diag(p))
        assert np.linalg.eigvalsh(p / np.outer(sd, sd))[0] > 0.0


def test_scores_are_the_gradient_of_the_likelihood():
    rng = np.random.default_rng(8)
    n, lag, step = 14, 6, 1e-5
    w = _window(rng, n)
    target = n - 1 - lag
    power, steer = _positive(rng, 10), _positive(rng, 10)

    def log_likelihood(a, b):
        trial = dict(w, q=w["q"].copy())
        trial["q"][target - 1] += a * power + b * steer
        _, _, o = _solve(trial)
        total = 0.0
        for i in np.flatnonzero(w["seen"]):
            cov = o["pp"][i][:3, :3] + w["r"][i]
            total -= 0.5 * (np.linalg.slogdet(cov)[1] + o["y"][i] @ np.linalg.solve(cov, o["y"][i]))
        return total

    _, lam, o = _solve(w)
    q_power, q_steer = np.zeros((n, 10, 10)), np.zeros((n, 10, 10))
    q_power[target - 1], q_steer[target - 1] = power, steer
    num_p, den_p, num_s, den_s = scores(n, lag, w["jac"], w["seen"], o["k"], o["si"], lam, q_power, q_steer)
    by_power = (log_likelihood(step, 0.0) - log_likelihood(-step, 0.0)) / (2 * step)
    by_steer = (log_likelihood(0.0, step) - log_likelihood(0.0, -step)) / (2 * step)
    assert 0.5 * (num_p - den_p) == pytest.approx(by_power, rel=1e-5, abs=1e-7)
    assert 0.5 * (num_s - den_s) == pytest.approx(by_steer, rel=1e-5, abs=1e-7)
    assert scores(4, lag, w["jac"], w["seen"], o["k"], o["si"], lam, q_power, q_steer) == (0.0, 0.0, 0.0, 0.0)


def test_fade_is_the_printed_rule():
    rng = np.random.default_rng(2)
    s, nxt = rng.normal(size=(2, 10)), rng.normal(size=(1, 10))
    q = _positive(rng, 10)[None]
    e = s[1] - nxt[0]
    expected = (20.0 * q[0] + 0.5 * np.outer(e, e)) / 20.5
    fade(2, s, nxt, q, np.array([0.5, 0.5]), 20.0)
    np.testing.assert_allclose(q[0], expected, rtol=1e-9)


def test_small_linear_algebra():
    rng = np.random.default_rng(3)
    a, out, low = _positive(rng, 3), np.empty((3, 3)), np.empty((10, 10))
    invert3(a, out)
    np.testing.assert_allclose(out @ a, np.eye(3), atol=1e-12)
    b = _positive(rng, 10)
    cholesky(b, low)
    np.testing.assert_allclose(low, np.linalg.cholesky(b), atol=1e-12)
