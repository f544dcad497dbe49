"""The planner's arithmetic against slower routes, and its team against the rule that looks at one target."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from camnet.agents import network_contexts
from camnet.agents.planner import _facts
from camnet.agents.planner_kernel import axis, expected_view, inside
from camnet.agents.planner_roads import advance, nearest_heading, place, road_map, scatter, thin_out
from camnet.config.load import load_scenario
from camnet.env.layout import ObservationLayout
from camnet.evaluation.play import Match
from camnet.evaluation.play_batch import play_together
from camnet.geometry.rotations import conjugate, nadir_gaze, rotate
from camnet.simulation.network import build_network

HARD = Path(__file__).resolve().parents[3] / "shared" / "data" / "worlds_hard"


def context(world: str = "pursuit"):
    network = build_network(load_scenario(world))
    layout = ObservationLayout(network.n_targets, min(2, network.n_agents - 1))
    return next(iter(network_contexts(network, layout, 1.2).values()))


def test_a_point_is_expected_in_view_where_the_pinhole_sees_it() -> None:
    known = context()
    facts, camera = np.array(_facts(known)), known.camera
    facts[22] = 0.0  # a point, not a ball
    rng, seen = np.random.default_rng(1), 0
    k = camera.intrinsics
    for _ in range(3000):
        pan, tilt = rng.uniform(-1.1, 1.1, 2)
        point = rng.uniform([-6, -6, -3.5], [6, 6, -0.5])
        x, y, z = rotate(conjugate(nadir_gaze(pan, tilt)), point)
        u, v = k.fx_px * x / z + k.cx_px, k.fy_px * y / z + k.cy_px
        truly = (
            camera.near_m <= z <= camera.far_m
            and -0.5 <= u <= k.width_px - 0.5
            and -0.5 <= v <= k.height_px - 0.5
        )
        chance = expected_view(*point, axis(np.tan(pan), np.tan(tilt)), 1e-4, facts)
        assert truly == (chance > 0.5) or 0.01 < chance < 0.99
        seen += truly
    assert seen > 300


@pytest.mark.parametrize("spread", [0.05, 0.5])
def test_the_chance_of_being_inside_is_that_of_a_normal_place(spread: float) -> None:
    known = context()
    facts, rng = np.array(_facts(known)), np.random.default_rng(2)
    c, h = known.center, known.half_size
    for along in (-2.0, -0.5, 0.0, 0.5, 2.0):
        x, y = c[0] + h[0] + along * spread, c[1]
        drawn = rng.normal([x, y], spread, (20_000, 2))
        share = np.mean((abs(drawn[:, 0] - c[0]) <= h[0]) & (abs(drawn[:, 1] - c[1]) <= h[1]))
        assert inside(x, y, spread, facts) == pytest.approx(share, abs=0.03)


def test_particles_stay_on_the_roads_and_turn_back_only_where_a_road_ends() -> None:
    scenario = load_scenario("grid_16")
    roads, seeds = road_map(scenario.roads), np.array([12345], dtype=np.uint64)
    particles = np.zeros((200, 5))
    scatter(roads, 1.0, particles, seeds, 0)
    assert particles[:, 3].sum() == pytest.approx(1.0)
    lines = [np.array(road.points_m, dtype=float) for road in scenario.roads]
    for row in particles:
        heading, arc = int(row[0]), row[1]
        for _ in range(30):
            before = place(roads, heading, arc)
            heading, arc = advance(roads, heading, arc, 0.4, seeds, 0)
            now = place(roads, heading, arc)
            assert np.hypot(now[0] - before[0], now[1] - before[1]) <= 0.4 + 1e-9
            away = min(
                np.hypot(*(line[k] + np.clip(_along(line, k, now), 0, 1) * (line[k + 1] - line[k]) - now))
                for line in lines
                for k in range(len(line) - 1)
            )
            assert away < 1e-9


def _along(line: np.ndarray, k: int, p: tuple[float, float]) -> float:
    way = line[k + 1] - line[k]
    return float((np.array(p) - line[k]) @ way / (way @ way))


def test_a_vehicle_is_found_on_its_road_and_its_way() -> None:
    roads, seeds, rng = (
        road_map(load_scenario("grid_16").roads),
        np.array([9], dtype=np.uint64),
        np.random.default_rng(3),
    )
    particles = np.zeros((50, 5))
    scatter(roads, 1.0, particles, seeds, 0)
    for row in particles:
        x, y = place(roads, int(row[0]), row[1])
        ahead = place(roads, *advance(roads, int(row[0]), row[1], 1e-6, seeds, 0))
        v = (np.array(ahead) - (x, y)) * 1e6
        heading, arc = nearest_heading(roads, x + rng.normal(0, 1e-3), y, *v)
        assert np.hypot(*(np.array(place(roads, heading, arc)) - (x, y))) < 0.01


def test_thinning_out_keeps_the_mean() -> None:
    roads, seeds, rng = (
        road_map(load_scenario("grid_16").roads),
        np.array([7], dtype=np.uint64),
        np.random.default_rng(4),
    )
    many = []
    for _ in range(300):
        particles = np.zeros((24, 5))
        particles[:, 1], particles[:, 3] = np.arange(24), rng.random(24) ** 4
        wanted = particles[:, 1] @ particles[:, 3] / particles[:, 3].sum()
        thin_out(roads, 1.0, particles, seeds, 0)
        assert particles[:, 3].sum() == pytest.approx(1.0)
        many.append(particles[:, 1] @ particles[:, 3] - wanted)
    assert abs(np.mean(many)) < 4.0 * np.std(many) / np.sqrt(len(many)) + 0.05


@pytest.mark.slow
@pytest.mark.parametrize(("world", "least"), [("crowd8r", 62.0), ("city6", 1.5), ("lost3", 2.7)])
def test_worlds_that_reward_choosing_and_search(world: str, least: float) -> None:
    path = HARD / f"{world}.yaml"
    if not path.exists():
        pytest.skip("needs the worlds in shared/data/worlds_hard")
    scores = play_together(Match("planner", str(path), 1200), range(20))
    assert np.mean([score["return"] for score in scores]) >= least
