from __future__ import annotations

import numpy as np
import pytest

from camnet.config.load import load_scenario
from camnet.control.planner import box
from camnet.control.planner.viewpoints import Viewpoints
from camnet.control.setpoints import Setpoint, at_ease
from camnet.control.settings import ControllerSettings
from camnet.geometry.regions import BoxRegion
from camnet.geometry.settings import CameraModel, Intrinsics
from camnet.simulation.network import build_network
from camnet.simulation.run import run_network

REGION = BoxRegion("r", (0, 0, 0), (10, 10, 3.5))
WALL = box((5, 5, 2), (2.0, 0.2, 2.0))
SETTINGS = ControllerSettings()
CAMERA = CameraModel(
    name="c",
    intrinsics=Intrinsics(width_px=640, height_px=480, fx_px=420, fy_px=420, cx_px=320, cy_px=240),
    far_m=8.0,
)
ROAD = np.array([[1.0, 1.0], [9.0, 1.0]])


@pytest.fixture(scope="module")
def views():
    return Viewpoints(SETTINGS, REGION, CAMERA, [WALL], [ROAD])


def free(p):
    inside = REGION.signed_distance(p) <= -SETTINGS.region_margin_m + 1e-9
    return inside and WALL.signed_distance(p) >= SETTINGS.obstacle_margin_m


def test_a_place_in_the_wall_is_left_for_a_free_one_that_sees_the_point(views):
    point = np.array([5.0, 4.6, 0.1])
    wanted = Setpoint(np.array([5.0, 4.9, 2.0]), np.zeros(2))
    found = views.seeing(wanted, point)
    assert free(found.p_world)
    assert WALL.segment_clearance(found.p_world, point) > 0.0
    assert np.linalg.norm(found.p_world - wanted.p_world) < 1.7
    assert np.abs(found.gaze).max() > 0.0


def test_a_free_place_without_sight_is_left_too_and_one_with_it_is_kept(views):
    point = np.array([5.0, 4.4, 0.1])
    hidden = Setpoint(np.array([5.0, 6.2, 2.0]), np.zeros(2))
    assert WALL.segment_clearance(hidden.p_world, point) < 0.0
    found = views.seeing(hidden, point)
    assert free(found.p_world)
    assert WALL.segment_clearance(found.p_world, point) > 0.0
    good = Setpoint(np.array([5.0, 3.0, 2.0]), np.zeros(2))
    assert views.seeing(good, point) is good


def test_with_nothing_to_do_an_agent_waits_over_the_road(views):
    assert free(views.rest.p_world)
    assert abs(views.rest.p_world[1] - 1.0) < 1.5


def test_where_the_straight_way_is_blocked_the_goal_itself_is_asked_for(views):
    goal = Setpoint(np.array([5.0, 8.0, 2.0]), np.zeros(2))
    assert views.on_the_way(goal, np.array([5.0, 2.0, 2.0])) is goal
    beside = np.array([9.0, 8.0, 2.0])
    eased = views.on_the_way(goal, beside)
    np.testing.assert_array_equal(eased.p_world, at_ease(goal, beside, SETTINGS).p_world)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_agents_of_the_shipped_course_hand_the_robot_over_without_touching(seed):
    scenario = load_scenario("obstacle_course", ["run.duration_s=300"], seed=seed)
    summary = run_network(scenario, seed, ("learned",)).summary
    assert summary["collisions"] == 0
    assert summary["handoffs"]["attempted"] >= 3
    assert summary["handoffs"]["completed"] >= 0.9 * summary["handoffs"]["attempted"]


def test_the_shipped_course_gives_both_agents_places_that_are_free():
    network = build_network(load_scenario("obstacle_course"))
    assert set(network.viewpoints) == {0, 1}
    for j, own in network.viewpoints.items():
        place = own.rest.p_world
        assert network.regions[j].contains(place)
        assert all(o.signed_distance(place) > SETTINGS.obstacle_margin_m for o in network.occluders)
