from __future__ import annotations

import numpy as np
import pytest

from camnet.control.planner.obstacles import from_shape
from camnet.control.planner.pilot import pilots
from camnet.control.references import ReferenceGenerator
from camnet.control.settings import ControllerSettings
from camnet.experiments.adate_navigation import make_world, run
from camnet.experiments.adate_navigation_flight import draw_room, fly
from camnet.geometry.regions import BoxRegion

ROOM = BoxRegion("room", (0, -3, 0), (12, 3, 4))
DT = 1 / 60


def test_worlds_are_as_described():
    for seed in range(20):
        world = make_world(np.random.default_rng(seed))
        points = np.vstack([world.start, world.waypoints])
        for leg, obstacle in zip(world.legs, world.obstacles, strict=True):
            np.testing.assert_allclose(obstacle.center, 0.5 * (points[leg - 1] + points[leg]))
            assert ((obstacle.row[16:] >= 2.0) & (obstacle.row[16:] <= 3.5)).all()
        assert len(set(world.legs)) == 4


def test_one_world_meets_both_criteria_and_reports(tmp_path):
    result = run(1, tmp_path, seed=0)
    assert result["both"] == 1.0
    assert result["iterations"]["one_near"] <= 3
    assert result["descents"]["unsafe_plans"] == 0
    assert (tmp_path / "navigation-plan.png").stat().st_size > 10_000
    assert (tmp_path / "navigation-convergence.png").stat().st_size > 5_000


def cross(seed, goals):
    rng = np.random.default_rng(seed)
    settings, shapes = ControllerSettings(), draw_room(rng)
    found = pilots(settings, [ROOM], shapes, DT)
    generator = ReferenceGenerator(settings, [ROOM], np.zeros(1), DT, found)
    state = generator.start(np.array([[0.8, 0.0, 1.5]]))
    track, speeds = [state.p_world[0]], [state.v_world[0]]
    for goal, seconds in goals:
        for _ in range(round(seconds / DT)):
            state = generator.step(state, np.array([goal]), np.zeros((1, 2)))
            track.append(state.p_world[0])
            speeds.append(state.v_world[0])
    return settings, [from_shape(s) for s in shapes], np.array(track), np.array(speeds)


def test_references_are_c1_inside_and_clear_of_obstacles():
    goals = [((11.0, 0.5, 1.5), 6.0), ((2.0, -2.0, 1.0), 3.0), ((11.0, 0.5, 1.5), 14.0)]
    settings, solids, track, speeds = cross(3, goals)
    clearance = min(s.signed_distance(p) for s in solids for p in track)
    assert clearance >= settings.obstacle_margin_m - 1e-3
    assert -ROOM.signed_distance(track).max() >= settings.region_margin_m - 1e-6
    assert np.linalg.norm(track[-1] - (11.0, 0.5, 1.5)) < 0.05
    bound = settings.reference_a_max_mps2 * DT
    assert np.linalg.norm(np.diff(speeds, axis=0), axis=1).max() <= bound * 1.01
    moved = np.diff(track, axis=0) - 0.5 * DT * (speeds[1:] + speeds[:-1])
    assert np.abs(moved).max() < 0.5 * bound * DT


def test_agents_without_obstacles_get_no_pilot():
    far = draw_room(np.random.default_rng(0))
    assert pilots(ControllerSettings(), [BoxRegion("away", (50, 0, 0), (60, 9, 4))], far, DT) == {}


@pytest.mark.slow
def test_a_quadrotor_crosses_a_hundred_rooms_without_touching():
    for seed in range(100):
        flight = fly(seed)
        assert flight.arrived, seed
        assert not flight.touched, seed
        assert flight.inside, seed


@pytest.mark.slow
def test_two_hundred_worlds():
    result = run(200)
    assert result["both"] >= 0.95
    assert result["iterations"]["one_near"] <= 3
    assert result["iterations"]["two_near"] <= 4
    assert result["descents"]["unsafe_plans"] == 0
