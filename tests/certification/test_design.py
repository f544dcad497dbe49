"""Placements are certified by the certifier, and minimal by exhaustive search where that is possible."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from camnet.certification.benchmark import generated_city, nadir_views
from camnet.certification.coverage import cover_roads
from camnet.certification.design import place_cameras, smallest_repairs
from camnet.certification.road_arcs import arcs_from_polylines, arcs_from_roads
from camnet.certification.road_gaps import road_gaps
from camnet.certification.transitions import RoadTargetClass, certify_roads
from camnet.certification.way_search import WaySearch, coverage_rows, usable_coverage
from camnet.errors import CertificateError

TARGET = RoadTargetClass(5.0, 10.0, 1.0)
LEAST_MPS = TARGET.v_lo_mps


def candidates_along(roads_xy, spacing=40.0):
    points = []
    for line in roads_xy:
        length = np.linalg.norm(line[-1] - line[0])
        n = max(2, round(length / spacing) + 1)
        points += [line[0] + t * (line[-1] - line[0]) for t in np.linspace(0, 1, n)]
    return np.unique(np.round(points, 6), axis=0)


def too_long(roads, cover, chosen, limit_m):
    return WaySearch(
        roads, usable_coverage(roads, cover, 0.0), 1 + int(cover.camera.max()), limit_m
    ).violations(chosen)


def small_city():
    roads_xy = [np.array([a, b], float) for a, b in [
        ((0, 0), (120, 0)), ((120, 0), (120, 90)), ((120, 90), (0, 90)), ((0, 90), (0, 0)), ((120, 0), (240, 0)),
    ]]  # fmt: skip
    centres = candidates_along(roads_xy, 60.0)
    roads = arcs_from_roads(roads_xy)
    return roads, cover_roads(roads, nadir_views(centres, 20.0, 30.0), 0.5, 1.0), len(centres)


@pytest.mark.parametrize("off_s", [22.0, 40.0, 75.0])
def test_placement_is_minimal_by_exhaustive_search(off_s):
    roads, cover, n = small_city()
    found = place_cameras(roads, cover, n, off_s * LEAST_MPS)
    assert found.certified
    assert found.optimal
    limit = LEAST_MPS * off_s
    assert not too_long(roads, cover, found.chosen, limit)
    for fewer in itertools.combinations(range(n), len(found.chosen) - 1):
        assert too_long(roads, cover, np.array(fewer, dtype=int), limit)


def test_costs_decide_between_equal_sets():
    roads, cover, n = small_city()
    plain = place_cameras(roads, cover, n, 200)
    dear = np.ones(n)
    dear[plain.chosen] = 5.0
    other = place_cameras(roads, cover, n, 200, costs=dear)
    assert other.cost <= dear[plain.chosen].sum()
    assert other.cost >= other.lower_bound - 1e-9


def test_the_certifier_agrees_with_the_placement():
    roads, cover, n = small_city()
    found = place_cameras(roads, cover, n, 200, least_view_m=5.0)
    gaps = road_gaps(roads, coverage_rows(cover, np.isin(cover.camera, found.chosen)))
    assert certify_roads(gaps, TARGET, 40.0, 0.0)["unseen"].certified.all()
    assert not gaps.cyclic.any()


def test_greedy_beyond_the_limit_is_certified_and_has_a_bound():
    roads, views = generated_city(36, 2)
    cover = cover_roads(roads, views, 0.5, 1.0)
    exact = place_cameras(roads, cover, 36, 300)
    greedy = place_cameras(roads, cover, 36, 300, exact_limit=0)
    assert exact.optimal
    assert exact.cost <= greedy.cost
    assert greedy.lower_bound <= exact.cost
    assert not too_long(roads, cover, greedy.chosen, 300.0)
    assert greedy.as_dict()["count"] == len(greedy.chosen)


def test_unseen_way_is_as_long_as_asked_and_avoids_views():
    roads = arcs_from_polylines([np.array([[0.0, 0], [100, 0]]), np.array([[100.0, 0], [200, 0]])], [[1], []])
    cover = cover_roads(roads, nadir_views(np.array([[150.0, 0.0]]), 20.0, 30.0), 0.5, 1.0)
    assert too_long(roads, cover, np.array([0]), 120.0) == [((0, 0.0, 100.0), (1, 0.0, 20.0))]
    assert too_long(roads, cover, np.array([0]), 140.0) == []  # seen after 150 - 13.4 m


def test_hopeless_candidates_are_refused_with_the_place():
    roads, cover, n = small_city()
    with pytest.raises(CertificateError, match="along road"):
        place_cameras(roads, cover, n, 10)


def test_each_repair_certifies_by_itself():
    long_gap = smallest_repairs(300.0, 25.0, TARGET, 50.0, 1.0)
    assert [r.cost for r in long_gap] == sorted(r.cost for r in long_gap)
    by_name = {r.change: r for r in long_gap}
    assert (300.0 - by_name["move or widen views along the road by"].amount) / 5.0 == pytest.approx(50.0)
    assert 300.0 / (5.0 + by_name["raise the class's least speed by"].amount) == pytest.approx(50.0)
    assert 300.0 / (1 + by_name["add cameras on the way"].amount) <= 250.0
    short_view = smallest_repairs(100.0, 5.0, TARGET, 50.0, 0.8)
    slower = next(r for r in short_view if "top speed" in r.change)
    assert 5.0 / (10.0 - slower.amount) == pytest.approx(0.8)
    assert smallest_repairs(100.0, 25.0, TARGET, 50.0, 1.0) == []
    assert len(smallest_repairs(300.0, 5.0, TARGET, 50.0, 0.8)) == 1


@pytest.mark.slow
def test_streets_of_a_real_city(shared_data):
    pytest.importorskip("sumolib")
    from camnet.importers.sumo import read_sumo_network

    net = read_sumo_network(shared_data / "bologna" / "joined_buslanes.net.xml")
    number = {edge.id: i for i, edge in enumerate(net.edges)}
    following = [[number[s] for s in edge.successors if s in number] for edge in net.edges]
    roads = arcs_from_polylines([edge.points for edge in net.edges], following)
    places = list(net.junctions.values())
    places += [
        roads.position(a, s) for a in range(roads.n_arcs) for s in np.arange(25, roads.length_m[a], 50)
    ]
    cover = cover_roads(roads, nadir_views(np.array(places), 20.0, 30.0), 0.5, 1.0)
    found = place_cameras(roads, cover, len(places), 600)
    assert found.optimal
    assert found.certified
    gaps = road_gaps(roads, coverage_rows(cover, np.isin(cover.camera, found.chosen)))
    assert certify_roads(gaps, RoadTargetClass(5.0, 14.0, 1.0), 120.0, 0.0)["unseen"].certified.all()
