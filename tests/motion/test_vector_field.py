from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline
from scipy.optimize import minimize_scalar

from camnet.errors import WorldError
from camnet.geometry.settings import Road
from camnet.motion.curve import ClosedCurve
from camnet.motion.factory import build_motion
from camnet.motion.protocol import TargetMotion, TargetState, planar_state
from camnet.motion.settings import TargetSettings, VectorFieldTarget
from camnet.motion.vector_field import Drive, VectorFieldMotion

POINTS = (
    (4.3, 0.0),
    (3.0, 2.6),
    (0.0, 4.1),
    (-2.8, 2.7),
    (-4.0, 0.0),
    (-2.7, -2.9),
    (0.0, -4.2),
    (2.8, -2.7),
)
LOOP = Road(name="loop", points_m=POINTS, closed=True)
DT = 1 / 60


def target(
    start: tuple[float, float] | None = None, heading: float | None = None, **motion: object
) -> TargetSettings:
    field = VectorFieldTarget(**{"kind": "vector_field", "road": "loop", **motion})  # type: ignore[arg-type]
    return TargetSettings(name="robot", motion=field, start_m=start, start_heading_rad=heading)


def built(**settings: object) -> VectorFieldMotion:
    motion = build_motion(target(**settings), [LOOP])  # type: ignore[arg-type]
    assert isinstance(motion, VectorFieldMotion)
    return motion


def run(motion: TargetMotion, duration_s: float, seed: int = 0, dt_s: float = DT) -> list[TargetState]:
    rng = np.random.default_rng(seed)
    states = [motion.reset(rng)]
    for k in range(round(duration_s / dt_s)):
        states.append(motion.step(states[-1], k * dt_s, dt_s, rng))
    return states


def positions(states: list[TargetState]) -> np.ndarray:
    return np.array([s.p_world[:2] for s in states])


# ------------------------------------------------------------------ the curve


@given(st.floats(-6, 6), st.floats(-6, 6))
def test_nearest_point_is_nearest_by_brute_force_on_scipys_spline(x: float, y: float) -> None:
    curve = ClosedCurve.through(POINTS)
    spline = CubicSpline(curve.knots, np.array([*POINTS, POINTS[0]]), bc_type="periodic")

    def distance(u: float) -> float:
        return float(np.linalg.norm(spline(u % curve.period) - (x, y)))

    us = np.linspace(0, curve.period, 2000)
    coarse = us[np.argmin(np.linalg.norm(spline(us) - (x, y), axis=1))]
    best = minimize_scalar(
        distance, bounds=(coarse - 0.02, coarse + 0.02), method="bounded", options={"xatol": 1e-10}
    )
    assert distance(curve.nearest(x, y)) == pytest.approx(best.fun, abs=1e-6)


def test_frame_agrees_with_differences_and_closes_up() -> None:
    curve = ClosedCurve.through(POINTS)
    h = 1e-5
    for u in np.linspace(0.1, curve.period - 0.1, 57):
        (x0, y0, a0, _), (x1, y1, a1, _) = curve.frame(u - h), curve.frame(u + h)
        _, _, phi, kappa = curve.frame(u)
        ds = math.hypot(x1 - x0, y1 - y0)
        assert math.cos(phi - math.atan2(y1 - y0, x1 - x0)) == pytest.approx(1, abs=1e-9)
        assert math.remainder(a1 - a0, 2 * math.pi) / ds == pytest.approx(kappa, abs=1e-4)
    begin, end = curve.frame(0.0), curve.frame(curve.period)
    np.testing.assert_allclose(begin[:2], end[:2], atol=1e-12)
    assert begin[3] == pytest.approx(end[3], abs=1e-9)
    np.testing.assert_allclose(begin[:2], POINTS[0])


# ------------------------------------------------------------------ the fields


@pytest.mark.parametrize("field", ["loop", "wave"])
@given(st.floats(0, 2 * math.pi), st.floats(0.75, 1.15))
def test_gradient_of_the_direction_agrees_with_differences(field: str, angle: float, ratio: float) -> None:
    motion = built(field=field)
    radius = ratio * (4.0 if field == "loop" else 1.2)
    x, y, h = radius * math.cos(angle), radius * math.sin(angle), 1e-6
    guide = motion.field.guide(x, y)

    def difference(dx: float, dy: float) -> float:
        ahead, behind = motion.field.guide(x + dx, y + dy), motion.field.guide(x - dx, y - dy)
        return math.remainder(ahead.direction - behind.direction, 2 * math.pi) / (2 * h)

    assert guide.gradient_x == pytest.approx(difference(h, 0), abs=1e-4)
    assert guide.gradient_y == pytest.approx(difference(0, h), abs=1e-4)


@given(st.floats(0, 2 * math.pi), st.floats(0.05, 0.99))
def test_wave_has_no_rest_inside_and_turns_back_at_its_rim(angle: float, ratio: float) -> None:
    motion = built(field="wave", scale_m=2.0)
    outward = np.array([math.cos(angle), math.sin(angle)])
    rim = motion.field.guide(*(2.0 * outward))
    assert math.cos(rim.direction - angle) < 0
    guide = motion.field.guide(*(2.0 * ratio * outward))
    assert guide.speed > 0.2
    assert math.hypot(guide.gradient_x, guide.gradient_y) < 60  # directions do not jump away from the centre


# ------------------------------------------------------------------ the robot


@pytest.mark.parametrize("lag", [0.0, 0.15])
def test_twenty_laps_stay_on_the_loop(lag: float) -> None:
    motion = built(start=(4.6, 0.5), heading=0.0, motor_lag_s=lag)
    states = run(motion, 1520.0, dt_s=1 / 20)
    length = motion.field.curve.length()  # type: ignore[attr-defined]
    turns = (states[-1].internal[0] - states[0].internal[0]) / (2 * math.pi)
    assert turns > 20
    spline = CubicSpline(motion.field.curve.knots, np.array([*POINTS, POINTS[0]]), bc_type="periodic")  # type: ignore[attr-defined]
    dense = spline(np.linspace(0, spline.x[-1], 4000))
    late = positions(states)[len(states) // 20 :: 40]
    away = np.linalg.norm(late[:, None] - dense, axis=2).min(axis=1)
    assert away.max() < (0.01 if lag == 0 else 0.08)
    driven = np.linalg.norm(np.diff(positions(states), axis=0), axis=1).sum()
    assert driven / length == pytest.approx(turns, rel=0.02)


@pytest.mark.parametrize("field", ["loop", "wave"])
def test_state_derivatives_are_the_reported_velocities(field: str) -> None:
    states = run(built(field=field, start=(1.1, 0.3), heading=2.0), 30.0, dt_s=1 / 240)
    p = np.array([s.p_world for s in states])
    q = np.array([s.q_world for s in states])
    v = np.array([s.v_world for s in states])
    w = np.array([s.w_body for s in states])
    np.testing.assert_allclose((p[2:] - p[:-2]) * 120, v[1:-1], atol=1e-3)
    dq = (q[2:] - q[:-2]) * 120
    # w = 2 conj(q) dq; only a turn about z here
    turn = 2 * (q[1:-1, 0] * dq[:, 3] - q[1:-1, 3] * dq[:, 0])
    rough = np.abs(turn - w[1:-1, 2])
    assert np.quantile(rough, 0.99) < 2e-3  # saturation has corners
    np.testing.assert_allclose(np.linalg.norm(q, axis=1), 1, atol=1e-12)
    heading = 2 * np.unwrap(np.arctan2(q[:, 3], q[:, 0]))
    np.testing.assert_allclose(np.cos(heading - np.arctan2(v[:, 1], v[:, 0])), 1, atol=1e-9)


def test_midpoint_steps_converge_to_an_adaptive_solver() -> None:
    motion = built(start=(4.5, 0.2), heading=1.2)

    def flow(_: float, state: np.ndarray) -> list[float]:
        q = np.array([math.cos(state[2] / 2), 0, 0, math.sin(state[2] / 2)])
        twist = motion.velocity(np.array([state[0], state[1], 0.0]), q, 0.0)
        assert twist is not None
        return [twist.v[0], twist.v[1], twist.w[2]]

    exact = solve_ivp(flow, (0, 60), [4.5, 0.2, 1.2], rtol=1e-10, atol=1e-12, max_step=0.1).y[:, -1]
    gaps = []
    for dt in (1 / 10, 1 / 20):
        last = run(motion, 60.0, dt_s=dt)[-1]
        gaps.append(np.linalg.norm([*last.p_world[:2], last.internal[0]] - exact))
    assert gaps[1] < 1e-3
    assert gaps[0] / gaps[1] == pytest.approx(4, rel=0.3)  # second order


@pytest.mark.parametrize("field", ["loop", "wave"])
def test_after_transients_velocity_is_a_function_of_position(field: str) -> None:
    states = run(built(field=field, start=(1.0, 1.0)), 700.0 if field == "wave" else 300.0)
    p, v = positions(states), np.array([s.v_world[:2] for s in states])
    half = len(states) // 2
    later, earlier = slice(half, None, 20), slice(half // 2, half)
    nearest = np.array([np.argmin(np.linalg.norm(p[earlier] - x, axis=1)) for x in p[later]])
    apart = np.linalg.norm(p[earlier][nearest] - p[later], axis=1)
    np.testing.assert_array_less(apart, 0.01)
    np.testing.assert_array_less(np.linalg.norm(v[earlier][nearest] - v[later], axis=1), 0.01)


@given(st.floats(0, 2 * math.pi), st.floats(0.02, 0.95))
def test_wave_keeps_the_robot_inside_and_moving(angle: float, ratio: float) -> None:
    scale, center = 1.5, (3.0, -2.0)
    start = (center[0] + ratio * scale * math.cos(angle), center[1] + ratio * scale * math.sin(angle))
    states = run(built(field="wave", scale_m=scale, center_m=center, start=start), 50.0, dt_s=1 / 10)
    assert np.linalg.norm(positions(states) - center, axis=1).max() <= scale
    assert min(np.linalg.norm(s.v_world) for s in states) > 0.3
    late = positions(states[250:])
    assert np.linalg.norm(late - late.mean(axis=0), axis=1).mean() > 0.4 * scale  # it circulates


@given(st.floats(-10, 10), st.floats(-10, 10), st.floats(-10, 10), st.floats(0.2, 0.7))
def test_no_command_exceeds_the_bounds(x: float, y: float, heading: float, wheel: float) -> None:
    motion = built(heading_gain_per_s=20.0, wheel_speed_max_mps=wheel, motor_lag_s=0.1)
    rng = np.random.default_rng(0)
    state = motion.reset(rng)
    states = [state] + [state := motion.step(state, 0.0, 0.05, rng) for _ in range(20)]
    moved = VectorFieldMotion(motion.field, motion.drive, 20.0, (x, y), heading, motion.start_points)
    for s in [*states, moved.reset(rng)]:
        v, w = np.linalg.norm(s.v_world), abs(s.w_body[2])
        assert v <= motion.v_max_mps + 1e-12
        assert w <= motion.w_max_radps + 1e-12
        assert v + w * 0.115 <= wheel + 1e-12


def test_wheel_limits_keep_the_curvature() -> None:
    drive = Drive(1.0, 3.0, 0.4, 0.5, 0.0)
    v, w = drive.limited(0.8, 2.0)
    assert abs(v) + abs(w) * 0.2 == pytest.approx(0.5)
    assert w / v == pytest.approx(2.0 / 0.8)
    assert drive.limited(0.1, 0.1) == (0.1, 0.1)


def test_seeds_repeat_and_differ_and_states_are_not_changed() -> None:
    motion = built()
    one, two, other = run(motion, 5.0, seed=1), run(motion, 5.0, seed=1), run(motion, 5.0, seed=2)
    assert all(np.array_equal(a.p_world, b.p_world) for a, b in zip(one, two, strict=True))
    assert not np.array_equal(one[0].p_world, other[0].p_world)
    before = one[10].p_world.copy()
    motion.step(one[10], 0.0, DT, np.random.default_rng(0))
    np.testing.assert_array_equal(one[10].p_world, before)


def test_velocity_is_none_only_when_motors_lag() -> None:
    q = np.array([1.0, 0, 0, 0])
    assert built(motor_lag_s=0.1).velocity(np.zeros(3), q, 0.0) is None
    twist, same = (built().velocity(np.array([4.0, 0, 0]), sign * q, 0.0) for sign in (1, -1))
    assert twist is not None
    assert same is not None
    np.testing.assert_allclose(twist.v, same.v)
    np.testing.assert_allclose(twist.w, same.w)


# ------------------------------------------------------------------ refusals

FIGURE_EIGHT = Road(
    name="loop", points_m=((0, 0), (2, 2), (4, 0), (2, -2), (0, 0.2), (-2, 2), (-4, 0), (-2, -2)), closed=True
)


@pytest.mark.parametrize(
    ("road", "settings", "message"),
    [
        (
            LOOP,
            {"road": "lop"},
            r"target 'robot': motion\.road = 'lop' is no road of this world; its roads: loop",
        ),
        (LOOP, {"road": None}, r"motion\.road is missing; name one of the roads: loop"),
        (LOOP.model_copy(update={"closed": False}), {}, r"'loop' is open; a closed road was expected"),
        (LOOP.model_copy(update={"points_m": POINTS[:2]}), {}, r"has 2 points; at least 3"),
        (
            LOOP.model_copy(update={"points_m": (*POINTS[:1], *POINTS)}),
            {},
            r"has the point \[4\.3, 0\.0\] twice",
        ),
        (FIGURE_EIGHT, {}, r"crosses itself"),
        (
            LOOP,
            {"speed_mps": 0.58},
            r"speed_mps = 0\.58 rises to 0\.638 m/s with its modulation, above v_max_mps = 0\.6",
        ),
        (
            LOOP,
            {"field": "wave", "scale_m": 0.2},
            r"its path turns at .* rad/s near .* above w_max_radps = 1\.5",
        ),
        (
            LOOP,
            {"field": "wave", "start": (2.5, 0.0)},
            r"start_m = \[2\.5, 0\.0\] lies 2\.5 m from .* scale_m = 2\.0",
        ),
        (LOOP, {"field": "wave", "start": (0.0, 0.0)}, r"more than 0 and less than"),
    ],
)
def test_impossible_targets_are_refused(road: Road, settings: dict[str, object], message: str) -> None:
    with pytest.raises(WorldError, match=message):
        build_motion(target(**settings), [road])  # type: ignore[arg-type]


def test_a_closed_road_may_repeat_its_first_point() -> None:
    road = Road(name="loop", points_m=(*POINTS, POINTS[0]), closed=True)
    motion = build_motion(target(start=(4.3, 0.0)), [road])
    assert isinstance(motion, VectorFieldMotion)
    np.testing.assert_allclose(run(motion, 5.0)[-1].p_world, run(built(start=(4.3, 0.0)), 5.0)[-1].p_world)


@given(
    st.floats(-6, 6), st.floats(-6, 6), st.floats(-7, 7), st.floats(0, 0.5), st.floats(-1, 1), st.booleans()
)
def test_compiled_step_on_a_loop_equals_the_readable_one(x, y, theta, v, w, lags):
    motion = MOTIONS[lags]
    state = planar_state(x, y, 0.0, theta, v, w, (theta, v, w))
    fast = motion.step(state, 0.0, DT, np.random.default_rng(0))
    slow = motion._step(x, y, theta, v, w, DT)
    np.testing.assert_allclose(fast.p_world, slow.p_world, atol=1e-12)
    np.testing.assert_allclose(fast.internal, slow.internal, atol=1e-9)


MOTIONS = {lags: built(start=(4.0, 0.0), motor_lag_s=0.2 if lags else 0.0) for lags in (False, True)}
