from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from camnet.control.planner import Planner, PlannerSettings, Waypoint, box, ellipsoid, sphere
from camnet.control.planner.objective import BAND
from camnet.control.planner.obstacles import pack
from camnet.control.planner.plan import Level
from camnet.control.planner.planner import _Task
from camnet.control.planner.solver import _Objective, minimise
from camnet.errors import ConfigError
from camnet.geometry.regions import BoxRegion

COVARIANCE = np.diag([1.0, 1.0, 0.25])
START, SPEED = np.zeros(3), np.array([3.0, 0.0, 0.0])
GOALS = [Waypoint(10.0, np.array([30.0, 0.0, 0.0]), COVARIANCE)]


@pytest.fixture(scope="module")
def planner():
    return Planner(PlannerSettings())


def problem_of(planner, obstacles, guess):
    task = _Task(START, SPEED, tuple(GOALS), pack(obstacles), len(guess), False)
    return planner._problem(task, guess, Level())


def dense(objective, n):
    out = np.zeros((10 * n, 10 * n))
    for k in range(BAND):
        for j in range(10 * n - k):
            out[j + k, j] = out[j, j + k] = objective.ab[k, j]
    return out


def wiggly(planner):
    guess = planner.plan(START, SPEED, GOALS).states
    return guess + np.random.default_rng(3).normal(scale=0.02, size=guess.shape)


def test_gradient_is_the_derivative_of_the_objective(planner):
    states = wiggly(planner)
    region = BoxRegion("r", (-5, -2, -2), (40, 2, 2))
    inside = Planner(PlannerSettings(), region)
    for which, obstacles in (
        (planner, [ellipsoid((15, 1.5, 0), (2, 1.5, 2.5))]),
        (inside, [box((15, 2, 0), (1, 1, 1))]),
    ):
        objective = _Objective(problem_of(which, obstacles, states), states, None)
        objective(states)
        gradient = objective.g.reshape(states.shape).copy()
        rng = np.random.default_rng(0)
        for _ in range(12):
            direction = rng.normal(size=states.shape)
            eps = 1e-5
            slope = (objective(states + eps * direction) - objective(states - eps * direction)) / (2 * eps)
            assert slope == pytest.approx(float(np.sum(gradient * direction)), rel=2e-4, abs=2e-4)


def test_curvature_is_symmetric_positive_and_exact_for_the_linear_part(planner):
    states = wiggly(planner)
    objective = _Objective(problem_of(planner, [sphere((15, 1, 0), 2.0)], states), states, None)
    objective(states)
    matrix = dense(objective, len(states))
    values = np.linalg.eigvalsh(matrix)
    assert values[0] > -1e-9 * values[-1]


def test_without_obstacles_the_descent_finds_the_same_plan_from_afar(planner):
    plan = planner.plan(START, SPEED, GOALS)
    rng = np.random.default_rng(1)
    guess = plan.states + rng.normal(scale=0.3, size=plan.states.shape)
    guess[0, :6] = plan.states[0, :6]
    problem = problem_of(planner, [], plan.states)
    problem = replace(problem, start=np.array([*plan.states[0, 6:], *problem.start[4:]]))
    again = minimise(problem, guess, 1e-4, 60, plan.statistics)
    np.testing.assert_allclose(again.states[:, :3], plan.states[:, :3], atol=0.1)
    assert (np.diff(again.costs) <= 1e-9).all()


def test_straight_through_the_middle_of_an_obstacle_is_left(planner):
    for obstacle in (ellipsoid((15, 0, 0), (2, 3, 3.5)), box((15, 0, 0), (1, 3, 2)), sphere((15, 0, 0), 3)):
        plan = planner.plan(START, SPEED, GOALS, [obstacle])
        assert plan.safe
        assert plan.met
        assert plan.clearance_m >= planner.settings.safety_m
        times = np.linspace(0, 10, 2000)
        assert min(obstacle.signed_distance(plan.curve.at(t)[0], t) for t in times) >= plan.clearance_m - 1e-6


def test_a_moving_ball_is_avoided_where_it_will_be(planner):
    ball = sphere((15, -10, 0), 2.0, (0, 2.0, 0))  # crosses the way at 5 s
    plan = planner.plan(START, SPEED, GOALS, [ball])
    assert plan.safe
    assert min(ball.signed_distance(plan.curve.at(t)[0], t) for t in np.linspace(0, 10, 500)) > 0.0


def test_renewing_a_plan_that_was_followed_takes_one_iteration(planner):
    obstacle = ellipsoid((15, 1, 0), (2, 3, 3))
    plan = planner.plan(START, SPEED, GOALS, [obstacle])
    for k in range(1, 9):
        goals = [Waypoint(10.0 - k, GOALS[0].p_world, COVARIANCE)]
        plan = planner.plan(plan.curve.x[1], plan.curve.v[1], goals, [obstacle], last=plan)
        assert plan.warm
        assert plan.safe
        assert plan.iterations <= 3


def test_a_capped_descent_goes_on_where_it_stopped_and_ends_where_the_whole_one_does(planner):
    guess = planner.plan(START, SPEED, GOALS).states
    problem = problem_of(planner, [ellipsoid((15, 1, 0), (2, 3, 3))], guess)
    whole = minimise(problem, guess, 1e-3, 60)
    assert whole.iterations > 4
    part, solves = minimise(problem, guess, 1e-3, 3), 3
    while not part.converged:
        assert part.iterations <= 3
        part = minimise(problem, part.states, 1e-3, 3, part.statistics, part.damping)
        solves += part.iterations
    np.testing.assert_array_equal(part.states, whole.states)
    assert solves == whole.iterations


def test_no_call_solves_more_than_it_may_and_the_rest_is_carried_on():
    capped, free = Planner(PlannerSettings(solves_per_plan=3)), Planner(PlannerSettings())
    obstacle = ellipsoid((15, 1, 0), (2, 3, 3))
    want = free.plan(START, SPEED, GOALS, [obstacle])
    assert want.solves > 3
    plan, calls = capped.plan(START, SPEED, GOALS, [obstacle]), 1
    while plan.pending is not None and calls < 20:  # a body that stands still in time: the same call again
        assert plan.solves <= 3
        plan = capped.plan(START, SPEED, GOALS, [obstacle], last=plan, elapsed_steps=0)
        calls += 1
    assert plan.safe
    assert plan.met
    assert 1 < calls <= 7
    assert plan.cost == pytest.approx(want.cost, rel=0.05)


def test_a_checked_plan_stays_in_force_until_there_is_a_better_one():
    planner = Planner(PlannerSettings(solves_per_plan=1))
    last = planner.plan(START, SPEED, GOALS)
    assert last.safe
    kept = 0
    wall = ellipsoid((45, 0, 0), (2, 6, 6))
    for k in range(1, 9):
        goals = [
            Waypoint(10.0 - k, GOALS[0].p_world, COVARIANCE),
            Waypoint(20.0 - k, np.array([60.0, 0, 0]), COVARIANCE),
        ]
        plan = planner.plan(last.curve.x[1], last.curve.v[1], goals, [wall], last=last)
        assert plan.solves <= 1
        assert plan.safe
        if plan.kept:
            kept += 1
            np.testing.assert_array_equal(plan.states, last.states[1:])
        last = plan
    assert last.met  # found on the way
    assert kept < 8


def test_a_plan_to_rest_stays_in_its_region():
    region = BoxRegion("room", (-1, -4, -1), (12, 4, 4))
    settings = PlannerSettings(dt_s=0.5, margin_m=0.5, safety_m=0.3, region_margin_m=0.2)
    planner = Planner(settings, region)
    goal = Waypoint(8.0, np.array([10.0, 0, 1]), 0.01 * np.eye(3))
    plan = planner.plan((0, 0, 1), (0.5, 0, 0), [goal], [box((5, 0, 1.5), (0.5, 1.5, 3))], stop=True)
    assert plan.safe
    assert plan.depth_m >= 0.2 - 1e-9
    assert np.linalg.norm(plan.curve.v[-1]) < 0.05


def test_bad_requests_are_refused(planner):
    with pytest.raises(ConfigError, match="ascending"):
        planner.plan(START, SPEED, [])
    with pytest.raises(ConfigError, match="finite"):
        planner.plan(START * np.nan, SPEED, GOALS)
    with pytest.raises(ConfigError, match="safety_m"):
        Planner(PlannerSettings(safety_m=1.0, margin_m=0.5))
