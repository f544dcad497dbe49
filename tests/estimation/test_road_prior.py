"""The prior along known roads: it follows them at the speed and offset of the exit, and does nothing off them."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from rounding import assert_rounded_alike

from camnet.errors import ConfigError
from camnet.estimation import EstimatorSettings, LearningEstimator, place_basis
from camnet.estimation.road_prior import NO_ROADS, RoadMap, map_of, offset_of, steer, turning_rate
from camnet.estimation.settings import BasisSettings, GapSettings
from camnet.geometry.roads import Polyline
from camnet.geometry.rotations import from_yaw, yaw_of
from camnet.geometry.settings import Road

BOUNDS = np.array([[-9.0, -9.0, -1.0], [9.0, 9.0, 3.0]])
ANGLE = np.linspace(0.0, 2.0 * math.pi, 16, endpoint=False)
LOOP = Road(
    name="loop", closed=True, points_m=tuple((4.0 * math.cos(a), 4.0 * math.sin(a)) for a in ANGLE.tolist())
)
CROSS = (
    Road(name="stem", points_m=((0.0, -4.0), (0.0, 0.0))),
    Road(name="left", points_m=((-5.0, 0.0), (0.0, 0.0))),
    Road(name="right", points_m=((0.0, 0.0), (5.0, 0.0))),
)


def estimator(prior: str, roads: tuple[Road, ...]) -> LearningEstimator:
    settings = EstimatorSettings(
        gap=GapSettings.model_validate({"prior": prior, "learn_across": False}),
        basis=BasisSettings(placement="grid", spacing_m=2.0, width_m=0.5),
    )
    basis = place_basis(settings.basis, [], np.full(2, -6.0), np.full(2, 6.0))
    return LearningEstimator(settings, basis, 1, 30.0, BOUNDS, roads=roads)


def see(
    target: LearningEstimator, measurement_of: Callable, start: np.ndarray, yaw: float, speed: float
) -> float:
    """Show a straight approach of 0.7 s that ends at ``start``; returns the time of its end."""
    v = speed * np.array([math.cos(yaw), math.sin(yaw), 0.0])
    for k in range(21):
        t = k / 30.0
        p = np.array([*start, 0.0]) + (t - 20 / 30.0) * v
        target.correct(measurement_of(t, p, from_yaw(yaw)), 0)
    return 20 / 30.0


@pytest.mark.parametrize("way", [1.0, -1.0])
@pytest.mark.parametrize("offset", [0.0, 0.15])
def test_a_closed_road_is_followed_at_the_exit_speed(
    measurement_of: Callable, way: float, offset: float
) -> None:
    """Where the target comes to, by the arc length of the polyline: a second route."""
    road, line, speed = LOOP, Polyline.from_settings(LOOP), 0.4
    s0 = 2.0
    tangent = way * line.tangent(s0)
    start = line.point(s0) + offset * np.array([-tangent[1], tangent[0]]) * way
    target = estimator("road", (road,))
    see(target, measurement_of, start, math.atan2(tangent[1], tangent[0]), speed)
    rollout = target.rollout(40.0, 0.2)
    s, lateral = line.project(rollout.p_world[:, :2])
    assert np.abs(lateral - offset).max() < 0.06
    travelled = np.unwrap(way * (s - s0) * 2 * np.pi / line.length) * line.length / (2 * np.pi)
    np.testing.assert_allclose(travelled, speed * (rollout.t_s - 20 / 30.0), rtol=0.06, atol=0.1)
    along = way * line.tangent(s)
    turned = yaw_of(rollout.q_world) - np.arctan2(along[:, 1], along[:, 0])
    assert np.abs(np.remainder(turned + np.pi, 2 * np.pi) - np.pi).max() < 0.3


def test_advancing_and_rolling_out_agree(measurement_of: Callable) -> None:
    line = Polyline.from_settings(LOOP)
    target = estimator("road", (LOOP,))
    tangent = line.tangent(2.0)
    t = see(target, measurement_of, line.point(2.0), math.atan2(tangent[1], tangent[0]), 0.4)
    ahead = target.rollout(20.0, 0.05)
    for k in range(1, 401):
        target.predict(t + 0.05 * k)
    assert np.linalg.norm(target.estimate.p_world - ahead.p_world[-1]) < 0.05


def test_at_a_junction_one_road_is_taken(measurement_of: Callable) -> None:
    target = estimator("road", CROSS)
    see(target, measurement_of, np.array([0.02, -2.0]), math.pi / 2, 0.4)
    end = target.rollout(12.0, 0.2).p_world[-1]
    assert abs(end[1]) < 0.15  # on the bar
    assert 1.5 < abs(end[0]) < 3.5


def test_off_the_roads_and_without_any_it_is_a_constant_turn(measurement_of: Callable) -> None:
    paths = []
    for prior, roads in (("constant_turn", ()), ("road", ()), ("road", (LOOP,))):
        target = estimator(prior, roads)
        see(target, measurement_of, np.array([0.5, 0.5]), 0.3, 0.2)
        paths.append(target.rollout(10.0, 0.2).p_world)
    assert_rounded_alike(paths[0], paths[1], scale=10.0, steps=50)
    np.testing.assert_allclose(paths[0], paths[2], atol=1e-9)


def test_the_arc_goes_through_the_goal() -> None:
    """Straight road, target beside it and askew: the steering rate is that of the circle through the goal."""
    roads = RoadMap.of([Road(name="r", points_m=((0.0, 0.0), (10.0, 0.0)), width_m=1.0)])
    p, prior = (
        np.array([3.0, 0.2, 0.0]),
        np.array([0.5 * math.cos(0.4), 0.5 * math.sin(0.4), 0, 9.0, 9.0, 9.0]),
    )
    offset = offset_of(p[0], p[1], prior[0], prior[1], roads)
    assert offset == pytest.approx(0.2)
    steer(p[0], p[1], prior, offset, roads)
    assert prior[3] == prior[4] == 0.0
    goal = np.array([4.0, 0.2])
    radius = 0.5 / prior[5]
    centre = p[:2] + radius * np.array([-math.sin(0.4), math.cos(0.4)])
    assert np.isclose(np.linalg.norm(goal - centre), abs(radius))
    assert turning_rate(3.0, 1.2, prior[0], prior[1], 0.0, roads) == (False, 0.0)
    assert offset_of(3.0, 1.2, prior[0], prior[1], roads) == 0.0


def test_a_map_needs_roads() -> None:
    with pytest.raises(ConfigError, match="no roads"):
        RoadMap.of([])


def _plain_rate(
    x: np.ndarray, v: np.ndarray, offset: float, roads: list[Road]
) -> tuple[bool, float, float] | None:
    """Whether on a road, steering rate, offset, by `Polyline`: nearest of all, goal by arc length, circle to it.

    None where a corner is nearest, which belongs to two segments.
    """
    lines = [Polyline.from_settings(road) for road in roads]
    found = [line.project(x[None]) for line in lines]
    r = int(np.argmin([abs(lateral[0]) for _, lateral in found]))
    (s, lateral), line, width = found[r], lines[r], roads[r].width_m
    if abs(lateral[0]) > width:
        return False, 0.0, 0.0
    if np.abs(line.arc - s).min() < 1e-6:
        return None
    way = 1.0 if line.tangent(s)[0] @ v >= 0.0 else -1.0
    held = way * float(np.clip(lateral[0], -0.5 * width, 0.5 * width))
    ahead = float(s[0] + way * width)
    over = 0.0 if roads[r].closed else ahead - min(max(ahead, 0.0), line.length)
    tangent = line.tangent(np.array([ahead - over]))[0]
    goal = line.point(np.array([ahead - over]))[0] + over * tangent
    goal = goal + way * offset * np.array([-tangent[1], tangent[0]]) - x
    angle = math.atan2(v[0] * goal[1] - v[1] * goal[0], v @ goal)
    sine = math.sin(angle) if abs(angle) <= 0.5 * math.pi else math.copysign(1.0, angle)
    return True, 2.0 * float(np.linalg.norm(v)) * sine / float(np.linalg.norm(goal)), held


def test_the_grid_of_segments_is_the_search_of_all_roads() -> None:
    """Random places about roads of several widths, against a steering written on the polylines."""
    rng = np.random.default_rng(3)
    roads = [
        LOOP.model_copy(update={"width_m": 1.3}),
        *CROSS,
        Road(name="far", points_m=((12.0, 9.0), (13.0, 9.0)), width_m=0.2),
        Road(name="bent", points_m=((-6.0, 5.0), (-5.0, 6.0), (-5.0, 8.0), (-7.5, 8.0)), width_m=0.8),
    ]
    m, on = RoadMap.of(roads), 0
    for _ in range(2000):
        x, v = rng.uniform(-9.0, 14.0, 2), 0.5 * rng.standard_normal(2)
        offset = rng.uniform(-0.3, 0.3)
        wanted = _plain_rate(x, v, offset, roads)
        if wanted is None:
            continue
        assert (*turning_rate(*x, *v, offset, m), offset_of(*x, *v, m)) == pytest.approx(wanted, abs=1e-9)
        on += wanted[0]
    assert 200 < on < 1800


def test_only_the_prior_along_roads_goes_by_the_map() -> None:
    assert map_of("constant_turn", CROSS) is NO_ROADS
    assert map_of("road", ()) is NO_ROADS
    assert map_of("road", CROSS) is map_of("road", list(CROSS))
    assert turning_rate(0.0, -1.0, 0.0, 0.5, 0.0, NO_ROADS) == (False, 0.0)
