"""One quadrotor, two robots on roads: where an unseen robot may be, whom to follow, what is scored."""

from __future__ import annotations

import math

import numpy as np
import pytest

from camnet.errors import ConfigError
from camnet.experiments.road_network import print_table, run
from camnet.experiments.road_network_policy import NearestIntersection, RoadBelief
from camnet.experiments.road_network_scene import ROADS, RoadSceneSettings, lane_basis, road_scenario
from camnet.experiments.road_network_score import RoadTrace, conduct, passed_unseen, score
from camnet.geometry.frustum import Frustum
from camnet.geometry.road_graph import RoadGraph
from camnet.geometry.rotations import from_yaw, look_at
from camnet.motion.road_network import RoadNetwork
from camnet.simulation.network import build_network
from camnet.types import Array, TargetEstimate

SPEED = 0.3


def belief() -> RoadBelief:
    return RoadBelief(RoadGraph.from_settings(ROADS), RoadNetwork.of(ROADS).lines, SPEED)


def view_from(x: float, y: float) -> Frustum:
    network = build_network(road_scenario(RoadSceneSettings()))
    p = np.array([x, y, 2.6])
    return Frustum.from_camera(network.cameras[0]).in_world(p, look_at(p, np.array([x, y + 1e-3, 0.0])))


def at(x: float, y: float, vx: float, vy: float, seen: bool = True, region: int = 0) -> TargetEstimate:
    p, v = np.array([x, y, 0.0]), np.array([vx, vy, 0.0])
    return TargetEstimate(0.0, p, from_yaw(math.atan2(vy, vx)), v, np.zeros(3), seen, 0.0, region, 0.1)


def test_places_follow_the_road_and_part_at_junctions() -> None:
    b = belief()
    b.seen(np.array([0.0, -1.0, 0.0]), np.array([0.0, SPEED, 0.0]))  # up the middle road
    for _ in range(50):
        b.advance(0.1)
    np.testing.assert_allclose(b.points(), [[0.0, 0.5, 0.0]], atol=1e-9)
    for _ in range(100):
        b.advance(0.1)  # 4.5 m in all: 1.5 m beyond the junction at (0, 2)
    points = b.points()[np.argsort(b.points()[:, 0])]
    np.testing.assert_allclose(points, [[-1.5, 2.0, 0.0], [1.5, 2.0, 0.0]], atol=1e-9)
    assert [place.weight for place in b.places] == [0.5, 0.5]


def test_a_place_that_is_seen_empty_is_struck_out() -> None:
    b = belief()
    b.seen(np.array([0.0, 1.0, 0.0]), np.array([0.0, SPEED, 0.0]))
    for _ in range(100):
        b.advance(0.1)
    b.exclude(view_from(-2.0, 2.0))
    assert b.points()[:, 0] == pytest.approx([2.0])
    b.exclude(view_from(2.0, 2.0))
    assert len(b.places) > 40  # nowhere: so it may be anywhere


def follow(policy: NearestIntersection, *estimates: TargetEstimate, t_s: float = 400.0) -> Array:
    return policy.decide(t_s, 0.2, estimates, view_from(30.0, 0.0), np.array([0.0, 0.0, 2.6]))


def test_the_robot_nearest_an_intersection_is_followed() -> None:
    policy = NearestIntersection(ROADS, 300.0, SPEED, 2)
    far, near = at(-3.3, 0.0, 0.0, -SPEED), at(1.5, 2.0, -SPEED, 0.0)
    np.testing.assert_array_equal(follow(policy, far, near, t_s=10.0), far.p_world)  # the first, at first
    np.testing.assert_array_equal(follow(policy, far, near), near.p_world)
    beside = at(0.5, 2.0, -SPEED, 0.0)
    closer = at(0.0, -1.8, 0.0, -SPEED)
    np.testing.assert_array_equal(follow(policy, closer, beside), beside.p_world)  # stays through the turn
    gone = at(-1.0, 2.0, -SPEED, 0.0)
    np.testing.assert_array_equal(follow(policy, closer, gone), closer.p_world)


def test_a_robot_that_left_the_roads_is_looked_for_on_them() -> None:
    policy = NearestIntersection(ROADS, 300.0, SPEED, 2)
    known = at(-3.3, 0.0, 0.0, -SPEED)
    follow(policy, known, at(3.3, 1.0, 0.0, -SPEED))
    astray = at(6.0, 5.0, SPEED, 0.0, seen=False)
    place = follow(policy, known, astray)
    assert policy.lost(1)
    assert not policy.lost(0)
    np.testing.assert_allclose(place, [3.3, 1.0 - 0.2 * SPEED, 0.0], atol=1e-6)


def trace() -> RoadTrace:
    """Robot 1 is always seen; robot 2 unseen from 2 on, on another road from 4 on, seen again at 6."""
    t = np.arange(8.0)
    p = np.zeros((8, 2, 3))
    q = np.tile([1.0, 0.0, 0.0, 0.0], (8, 2, 1))
    seen = np.ones((8, 2), dtype=bool)
    seen[2:6, 1] = False
    road = np.zeros((8, 2), dtype=int)
    road[4:, 1] = 1
    wrong = p.copy()
    wrong[2:4, 1, 0], wrong[4:6, 1, 0] = 1.0, 3.0
    none = np.zeros((8, 2), dtype=bool)
    return RoadTrace(t, p, q, seen, road, {"learned": (wrong, q)}, np.zeros((8, 3)), np.zeros(8, int), none)


def test_scores_tell_turns_that_nobody_saw() -> None:
    run_ = trace()
    turned = passed_unseen(run_)
    assert turned[:, 1].tolist() == [False] * 4 + [True] * 2 + [False] * 2
    assert not turned[:, 0].any()
    row = score(run_, "learned", 1.0)
    assert row["position_rmse_unseen_same_road_m"] == pytest.approx(1.0)
    assert row["position_rmse_unseen_target_2_m"] == pytest.approx(math.sqrt(5.0))
    assert row["position_rmse_unseen_target_1_m"] == 0.0
    assert row["position_rmse_m"] == pytest.approx(math.sqrt(20.0 / 14.0))
    acts = conduct(run_, 1.0)
    assert acts["gaps"] == 1.0
    assert acts["turned_unseen_share_of_unseen"] == 0.5


def test_kernels_stand_on_both_directions_of_every_road() -> None:
    basis = lane_basis()
    assert 160 <= basis.size <= 175  # published: 172
    on_road = basis(np.array([-3.3, 0.5, 0.0]), from_yaw(math.pi / 2)).sum()
    other_way = basis(np.array([-3.3, 0.5, 0.0]), from_yaw(-math.pi / 2)).sum()
    across = basis(np.array([-3.3, 0.5, 0.0]), from_yaw(0.0)).sum()
    assert on_road == pytest.approx(other_way)
    assert across < 0.1 * on_road


def test_a_short_run_of_the_whole(capsys: pytest.CaptureFixture[str]) -> None:
    scene = RoadSceneSettings(follow_one_s=4.0, policy_s=2.0)
    result = run(1, None, 0, None, scene)
    assert result["rows"]["ideal"]["position_rmse_m"]["mean"] < 0.05
    print_table(result)
    assert "learned_published" in capsys.readouterr().out
    with pytest.raises(ConfigError, match="seeds: 0"):
        run(0)


@pytest.mark.slow
def test_acceptance_at_most_a_third_of_the_filters_error() -> None:
    result = run(5)
    assert max(result["ratio_to_ekf"].values()) <= 1.0 / 3.0
