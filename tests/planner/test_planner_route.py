from __future__ import annotations

import itertools

import numpy as np
import pytest

from camnet.control.planner import box, cylinder
from camnet.control.planner.obstacles import from_shape, pack
from camnet.control.planner.pilot import Pilot, pilots
from camnet.control.planner.route import RoadMap
from camnet.control.references import ReferenceGenerator
from camnet.control.settings import ControllerSettings
from camnet.experiments.adate_navigation_flight import draw_room
from camnet.geometry.regions import BoxRegion, PrismRegion

ROOM = BoxRegion("room", (0, -3, 0), (12, 3, 4))
DT = 1 / 60


def length(corners):
    return float(np.linalg.norm(np.diff(corners, axis=0), axis=1).sum())


def test_the_way_past_a_pillar_is_as_long_as_the_two_tangents_and_the_arc():
    room = BoxRegion("flat", (-5, -5, 0.9), (5, 5, 1.1))
    roads = RoadMap(room, pack([cylinder((0, 0, 1), 1.0, 5.0)]), 0.0, 0.5)
    corners = roads.route(np.array([-4.0, 0, 1]), np.array([4.0, 0, 1]))
    radius, away = 1.5, 4.0
    shortest = 2 * np.sqrt(away**2 - radius**2) + 2 * radius * np.arcsin(radius / away)
    assert shortest - 1e-6 <= length(corners) <= 1.04 * shortest


@pytest.mark.parametrize("seed", range(6))
def test_routes_keep_the_margins(seed):
    rng = np.random.default_rng(seed)
    solids = [from_shape(s) for s in draw_room(rng)]
    roads = RoadMap(ROOM, pack(solids), 0.25, 0.5)
    start, goal = np.array([0.8, rng.uniform(-1, 1), 1.5]), np.array([11.2, rng.uniform(-1, 1), 1.5])
    corners = roads.route(start, goal)
    np.testing.assert_array_equal(corners[[0, -1]], [start, goal])
    for a, b in itertools.pairwise(corners):
        along = a + np.linspace(0, 1, 200)[:, None] * (b - a)
        assert min(o.signed_distance(p) for o in solids for p in along) >= 0.5 - 1e-5
        assert ROOM.signed_distance(along).max() <= -0.25 + 1e-9


def test_there_is_no_way_through_a_closed_wall_and_the_agent_stays():
    wall = box((6, 0, 2), (0.2, 3, 2))
    roads = RoadMap(ROOM, pack([wall]), 0.25, 0.5)
    assert roads.route(np.array([1.0, 0, 1.5]), np.array([11.0, 0, 1.5])) is None
    pilot = Pilot(ControllerSettings(), ROOM, [wall], DT)
    before = np.concatenate([[1.0, 0.0, 1.5], np.zeros(6)])
    for _ in range(60):
        before = pilot.step(before, before, np.array([11.0, 0, 1.5]))
    np.testing.assert_allclose(before[:3], [1.0, 0, 1.5])


def test_a_way_around_the_corner_of_a_bent_region():
    outline = np.array([[0, 0], [8, 0], [8, 2], [2, 2], [2, 8], [0, 8]], dtype=float)
    bent = PrismRegion("bent", outline, (0.0, 3.0))
    roads = RoadMap(bent, pack([cylinder((5, 0.3, 1.5), 0.3, 1.5)]), 0.2, 0.3)
    corners = roads.route(np.array([7.5, 0.4, 1.5]), np.array([1.0, 7.5, 1.5]))
    for a, b in itertools.pairwise(corners):
        along = a + np.linspace(0, 1, 100)[:, None] * (b - a)
        assert bent.signed_distance(along).max() <= -0.2 + 1e-3


def cross(seed):
    rng = np.random.default_rng(seed)
    settings, shapes = ControllerSettings(), draw_room(rng)
    start, goal = np.array([0.8, rng.uniform(-1, 1), 1.5]), np.array([11.2, rng.uniform(-1, 1), 1.5])
    found = pilots(settings, [ROOM], shapes, DT)
    generator = ReferenceGenerator(settings, [ROOM], np.zeros(1), DT, found)
    state = generator.start(start[None])
    track, speeds = [state.p_world[0]], [state.v_world[0]]
    while np.linalg.norm(track[-1] - goal) > 0.05 and len(track) < 40 / DT:
        state = generator.step(state, goal[None], np.zeros((1, 2)))
        track.append(state.p_world[0])
        speeds.append(state.v_world[0])
    clearance = min(from_shape(s).signed_distance(p) for s in shapes for p in track[::2])
    return np.array(track), np.array(speeds), clearance, goal


@pytest.mark.parametrize("seed", [9, 49])
def test_rooms_that_one_descent_over_the_whole_way_does_not_cross(seed):
    track, _, clearance, goal = cross(seed)
    assert np.linalg.norm(track[-1] - goal) < 0.06
    assert clearance >= ControllerSettings().obstacle_margin_m - 1e-3


def test_without_a_smooth_plan_the_route_is_flown_with_stops(monkeypatch):
    monkeypatch.setattr(Pilot, "_smooth", lambda *_: None)
    settings = ControllerSettings()
    track, speeds, clearance, goal = cross(9)
    assert np.linalg.norm(track[-1] - goal) < 0.06
    assert clearance >= settings.obstacle_margin_m - 1e-3
    assert np.linalg.norm(speeds, axis=1).max() <= settings.reference_v_max_mps * 1.001
    change = np.linalg.norm(np.diff(speeds, axis=0), axis=1).max()
    assert change <= settings.reference_a_max_mps2 * DT * 1.01
