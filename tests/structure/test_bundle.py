"""Bundle adjustment: derivatives by differences, the minimum by SciPy, exact data, Huber's rule, covariances."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.optimize import least_squares

from camnet.errors import ConfigError
from camnet.estimation.structure.bundle.covariance import covariance, depth_sd
from camnet.estimation.structure.bundle.equations import cost_of, linearise
from camnet.estimation.structure.bundle.plain import moved, residuals
from camnet.estimation.structure.bundle.preintegrate import preintegrate
from camnet.estimation.structure.bundle.problem import BundleState, Observations, build_problem
from camnet.estimation.structure.bundle.solver import adjust
from camnet.estimation.structure.camera_path import CameraPath, forward_camera
from camnet.estimation.structure.odometry import Odometry, OdometryErrors, measure_odometry
from camnet.geometry import rotations as rot

SD = 5e-4
T = np.linspace(0.0, 4.0, 5)
KNOTS = np.linspace(-0.5, 4.5, 11)
PATH = CameraPath(
    KNOTS,
    np.column_stack([0.2 * KNOTS, 0.3 * np.sin(KNOTS), 0.1 * np.cos(KNOTS)]),
    rot.multiply(
        forward_camera(0.1 * np.sin(KNOTS)), rot.exp(0.05 * np.column_stack([KNOTS, KNOTS**0, KNOTS]))
    ),
)
ERRORS = OdometryErrors(scale=0.02, slip=0.01, gyro_bias_radps=(0.002, -0.001, 0.003), gyro_noise_radps=0.002)


def a_problem(noise=SD, count=12, errors=ERRORS, seed=0, **options):
    """Five poses, points 3 to 6 m away, the first half held in pose 0, the others in pose 1."""
    rng = np.random.default_rng(seed)
    truth = PATH.states(T)
    r = rot.to_matrix(truth.q_world)
    points = truth.p_world[0] + rng.uniform([-1.5, -1.0, 3.0], [1.5, 1.0, 6.0], (count, 3)) @ r[0].T
    anchor = (np.arange(count) >= count // 2).astype(int)
    pose, point, xy = [], [], []
    for i in range(len(T)):
        for j in range(count):
            if i == 0 and anchor[j] == 1:
                continue
            x = (points[j] - truth.p_world[i]) @ r[i]
            pose.append(i)
            point.append(j)
            xy.append(x[:2] / x[2] + noise * rng.standard_normal(2))
    seen = Observations(np.array(pose), np.array(point), np.array(xy), np.full(len(pose), SD))
    odometry = measure_odometry(PATH, np.arange(0.0, 4.001, 0.004), errors, rng)
    steps = [preintegrate(odometry, a, b, ERRORS) for a, b in pairwise(T)]
    problem = build_problem(seen, anchor, steps, 0.03, 0.005, **options)
    local = np.einsum("jk,jkl->jl", points - truth.p_world[anchor], r[anchor])
    true = BundleState(
        (truth.p_world - truth.p_world[0]) @ r[0],
        rot.multiply(rot.conjugate(truth.q_world[0]), truth.q_world),
        np.column_stack([local[:, :2] / local[:, 2:], 1.0 / local[:, 2]]),
        np.array([errors.scale, *errors.gyro_bias_radps]),
    )
    return problem, true


def equations(problem, state):
    size, count = 6 * (len(state.p) - 1) + 4, len(state.points)
    out = (
        np.empty((size, size)),
        np.empty(size),
        np.empty((count, 3, size)),
        np.empty((count, 3, 3)),
        np.empty((count, 3)),
    )
    return linearise(problem, *state, *out), *out


def unknowns(state):
    return 6 * (len(state.p) - 1) + 4 + 3 * len(state.points)


def differences(problem, state):
    step = 1e-6 * np.eye(unknowns(state))
    return np.column_stack(
        [(residuals(problem, moved(state, d)) - residuals(problem, moved(state, -d))) / 2e-6 for d in step]
    )


def test_normal_equations_are_those_of_the_residuals():
    prior = np.column_stack([np.full(12, 0.2), np.full(12, 0.05)])
    problem, true = a_problem(inverse_prior=prior)
    state = moved(true, 1e-3 * np.random.default_rng(1).standard_normal(unknowns(true)))
    cost, h_cc, g_c, h_yc, h_yy, g_y = equations(problem, state)
    e, j = residuals(problem, state), differences(problem, state)
    assert cost == pytest.approx(0.5 * e @ e, rel=1e-12)
    assert cost_of(problem, *state) == pytest.approx(cost, rel=1e-12)
    h, g, size = j.T @ j, j.T @ e, len(g_c)
    # turns: the derivative of Log is taken as the identity, which is right to the size of the residual
    np.testing.assert_allclose(h_cc, h[:size, :size], atol=2e-3 * np.abs(h[:size, :size]).max())
    np.testing.assert_allclose(h_yc.reshape(-1, size), h[size:, :size], atol=1e-6 * np.abs(h).max())
    for k in range(len(h_yy)):
        at = size + 3 * k
        np.testing.assert_allclose(h_yy[k], h[at : at + 3, at : at + 3], atol=1e-6 * np.abs(h_yy).max())
    np.testing.assert_allclose(g_y.ravel(), g[size:], atol=1e-6 * np.abs(g).max())


def test_gradients_agree_where_turns_fit():
    """With odometry left out the equations are exact."""
    problem, true = a_problem()
    problem = problem._replace(turn_weight=np.zeros(4))
    state = moved(true, 1e-2 * np.random.default_rng(2).standard_normal(unknowns(true)))
    _, h_cc, g_c, *_ = equations(problem, state)
    e, j = residuals(problem, state), differences(problem, state)
    np.testing.assert_allclose(g_c, (j.T @ e)[: len(g_c)], atol=1e-6 * np.abs(g_c).max())
    np.testing.assert_allclose(h_cc, (j.T @ j)[: len(g_c), : len(g_c)], atol=1e-6 * np.abs(h_cc).max())


def test_the_minimum_is_that_of_scipy():
    problem, true = a_problem()
    rng = np.random.default_rng(3)
    start = moved(true, 0.02 * rng.standard_normal(unknowns(true)))
    start = start._replace(points=start.points * [1.0, 1.0, 0.0] + [0.0, 0.0, 0.4])
    found, cost, count = adjust(problem, start)
    best = least_squares(
        lambda x: residuals(problem, moved(true, x)), np.zeros(unknowns(true)), xtol=1e-14, ftol=1e-14
    )
    assert count < 50
    assert cost == pytest.approx(best.cost, rel=1e-6)
    again = moved(true, best.x)
    np.testing.assert_allclose(found.p, again.p, atol=1e-5)
    np.testing.assert_allclose(found.points, again.points, atol=1e-5)
    np.testing.assert_allclose(found.common, again.common, atol=1e-5)


def test_exact_data_give_the_truth_from_a_start_five_times_too_near():
    problem, true = a_problem(noise=0.0, errors=OdometryErrors())
    near = true.points * [1.0, 1.0, 0.0] + [0.0, 0.0, 1.0]
    found, cost, _ = adjust(problem, true._replace(points=near, common=np.zeros(4)), tolerance=1e-12)
    assert cost < 1e-2
    np.testing.assert_allclose(found.points, true.points, atol=1e-4)
    np.testing.assert_allclose(found.p, true.p, atol=1e-3)


def test_one_wrong_observation_does_less_harm_with_huber():
    def error(huber):
        problem, true = a_problem(huber=huber)
        problem.xy[7] += 0.05
        return np.abs(adjust(problem, true)[0].p - true.p).max()

    assert error(2.0) < 0.5 * error(np.inf)


def test_a_start_behind_the_camera_is_told_and_left_alone():
    problem, true = a_problem()
    behind = true._replace(points=true.points * [1.0, 1.0, 0.0] + [0.0, 0.0, 20.0])
    found, cost, count = adjust(problem, behind)
    assert cost == np.inf
    assert count == 0
    np.testing.assert_array_equal(found.points, behind.points)


def test_covariances_are_those_of_repeated_estimates():
    """Spread of estimates over runs that draw noise and odometry errors from the priors."""
    problem, true = a_problem(noise=0.0, errors=OdometryErrors())
    said = np.sqrt(np.diag(covariance(problem, true._replace(common=np.zeros(4)))))
    size = 6 * 4 + 4
    off = []
    for seed in range(60):
        rng = np.random.default_rng(100 + seed)
        b = 0.005 * rng.standard_normal(3)
        errors = OdometryErrors(0.03 * rng.standard_normal(), 0.01, 1.0, (b[0], b[1], b[2]), 0.0, 0.0, 0.002)
        noisy, _ = a_problem(noise=SD, errors=errors, seed=seed)
        # the same points: those of seed 0
        fresh = noisy._replace(xy=problem.xy + SD * rng.standard_normal(problem.xy.shape))
        found = adjust(fresh, true)[0]
        off.append(np.concatenate([found.common - [errors.scale, *b], (found.points - true.points)[:, 2]]))
    spread = np.sqrt(np.mean(np.square(off), axis=0))
    expected = np.concatenate([said[size - 4 : size], said[size + 2 :: 3]])
    ratio = spread / expected
    assert np.all(ratio > 0.6), ratio
    assert np.all(ratio < 1.4), ratio


def test_the_spread_of_depths_follows_from_the_covariance():
    problem, true = a_problem(noise=0.0, count=6)
    anchored = problem._replace(anchor=np.zeros(6, dtype=np.int64))
    world = true.points.copy()
    r1, p1 = rot.to_matrix(true.q[1]), true.p[1]
    for j in range(3, 6):
        x = r1 @ np.array([*true.points[j, :2], 1.0]) / true.points[j, 2] + p1
        world[j] = [x[0] / x[2], x[1] / x[2], 1.0 / x[2]]
    state = true._replace(points=world)
    full = covariance(anchored, state)
    r = rot.to_matrix(state.q[-1])

    def depths(step):
        s = moved(state, step)
        ray = np.column_stack([s.points[:, :2], np.ones(6)]) / s.points[:, 2:]
        return ((ray - s.p[-1]) @ rot.to_matrix(s.q[-1]))[:, 2]

    assert r.shape == (3, 3)
    j = np.column_stack([(depths(d) - depths(-d)) / 2e-6 for d in 1e-6 * np.eye(unknowns(state))])
    np.testing.assert_allclose(depth_sd(anchored, state), np.sqrt(np.diag(j @ full @ j.T)), rtol=1e-5)


def test_odometry_steps_and_their_derivatives_by_the_bias():
    t = np.arange(0.0, 3.001, 0.01)
    v = np.column_stack([0.3 + 0.1 * np.sin(t), 0.05 * t, 0.2 * np.cos(t)])
    w = np.column_stack([0.1 * np.cos(t), 0.4 * np.sin(2 * t), 0.2 + 0.0 * t])
    step = preintegrate(Odometry(t, v, w), 0.2, 2.7, ERRORS)
    half = preintegrate(Odometry(t, v, w), 0.2, 1.3, ERRORS)
    rest = preintegrate(Odometry(t, v, w), 1.3, 2.7, ERRORS)
    np.testing.assert_allclose(step.shift, half.shift + rot.rotate(half.turn, rest.shift), atol=1e-10)
    np.testing.assert_allclose(step.turn, rot.multiply(half.turn, rest.turn), atol=1e-10)
    for k in range(3):
        bias = 1e-4 * np.eye(3)[k]
        up, down = (preintegrate(Odometry(t, v, w - s * bias), 0.2, 2.7, ERRORS) for s in (1.0, -1.0))
        np.testing.assert_allclose((up.shift - down.shift) / 2e-4, step.shift_by_bias[:, k], atol=1e-5)
        turned = rot.log(rot.multiply(rot.conjugate(down.turn), up.turn)) / 2e-4
        np.testing.assert_allclose(turned, step.turn_by_bias[:, k], atol=1e-5)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"scale_sd": 0.0}, "scale_sd 0.0"),
        ({"huber": -1.0}, "huber -1"),
        ({"bias_sd_radps": np.nan}, "bias_sd_radps nan"),
    ],
)
def test_bad_settings_are_refused(change, words):
    seen = Observations(np.array([0]), np.array([0]), np.zeros((1, 2)), np.ones(1))
    with pytest.raises(ConfigError, match=words):
        build_problem(seen, np.zeros(1, int), [None], **{"scale_sd": 0.1, "bias_sd_radps": 0.1, **change})


def test_observations_of_nothing_are_refused():
    seen = Observations(np.array([3]), np.array([0]), np.zeros((1, 2)), np.ones(1))
    with pytest.raises(ConfigError, match=r"outside 0\.\.1"):
        build_problem(seen, np.zeros(1, int), [None], 0.1, 0.1)
