"""Road networks against a brute-force walk and shortest paths on a fine grid of places."""

import itertools

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from camnet.errors import WorldError
from camnet.geometry.road_graph import RoadGraph, Stretch
from camnet.geometry.roads import Polyline
from camnet.geometry.settings import Road


def town():
    """A block with a diagonal, a dead end and a loop at one corner."""
    corners = np.array([[0, 0], [10, 0], [10, 7], [0, 7]], dtype=float)
    lines = [Polyline([corners[i], corners[(i + 1) % 4]]) for i in range(4)]
    lines.append(Polyline([corners[0], [4, 4], corners[2]]))
    lines.append(Polyline([corners[1], [14, -2]]))
    lines.append(Polyline([corners[3], [-2, 8], [-1, 10]], closed=True))
    return RoadGraph(lines)


TOWN = town()


def walk(graph, edge, s, forward, length, rng):
    """End of one random way of a length."""
    room = graph.lengths[edge] - s if forward else s
    while length > room:
        length -= room
        ways = graph.successors((edge, forward))
        edge, forward = ways[rng.integers(len(ways))]
        room = graph.lengths[edge]
    left = room - length
    return edge, graph.lengths[edge] - left if forward else left


def inside(stretches, edge, s, slack=1e-9):
    return any(p.edge == edge and p.s_lo - slack <= s <= p.s_hi + slack for p in stretches)


def test_nodes_are_where_ends_meet():
    assert len(TOWN.nodes) == 5
    assert TOWN.ends.tolist()[6][0] == TOWN.ends.tolist()[6][1]
    np.testing.assert_allclose(TOWN.nodes[TOWN.ends[5, 1]], [14, -2])
    assert len(TOWN.leaving(int(TOWN.ends[0, 0]))) == 3
    loose = RoadGraph([Polyline([[0, 0], [1, 0]]), Polyline([[1.05, 0], [2, 0]])])
    joined = RoadGraph([Polyline([[0, 0], [1, 0]]), Polyline([[1.05, 0], [2, 0]])], tolerance_m=0.1)
    assert (len(loose.nodes), len(joined.nodes)) == (4, 3)


def test_no_turning_round_but_at_a_dead_end():
    for heading in [(e, f) for e in range(len(TOWN.edges)) for f in (True, False)]:
        ways = TOWN.successors(heading)
        back = (heading[0], not heading[1])
        assert (back in ways) == (heading == (5, True))
    assert TOWN.successors((5, True)) == [(5, False)]


def test_locate():
    edge, s, lateral = TOWN.locate([5.0, 0.2])
    assert (edge, s, lateral) == (0, 5.0, pytest.approx(0.2))


def fine_distances(graph, step):
    """Places every ``step`` m or less on all edges, and the distances between all of them."""
    places, rows, cols, weights = [], [], [], []
    node_ids = {}
    for e, line in enumerate(graph.edges):
        n = int(np.ceil(line.length / step))
        ids = []
        for i in range(n + 1):
            if i in (0, n):
                key = int(graph.ends[e, 0 if i == 0 else 1])
                if key not in node_ids:
                    node_ids[key] = len(places)
                    places.append((e, line.length * i / n))
                ids.append(node_ids[key])
            else:
                ids.append(len(places))
                places.append((e, line.length * i / n))
        rows += ids[:-1]
        cols += ids[1:]
        weights += [line.length / n] * n
    return places, dijkstra(
        coo_array((weights, (rows, cols)), shape=(len(places),) * 2).tocsr(), directed=False
    )


def test_shortest_paths_agree_with_a_fine_grid():
    places, distance = fine_distances(TOWN, 0.5)
    rng = np.random.default_rng(0)
    for a, b in rng.integers(len(places), size=(200, 2)):
        length, route = TOWN.shortest_path(places[a], places[b])
        assert length == pytest.approx(distance[a, b], abs=1e-9)
        assert sum(p.length for p in route) == pytest.approx(length)
        ends = [TOWN.edges[p.edge].point([p.s_lo, p.s_hi]) for p in route]
        for before, after in itertools.pairwise(ends):
            np.testing.assert_allclose(before[1], after[0], atol=1e-9)
        if route:
            np.testing.assert_allclose(ends[0][0], TOWN.edges[places[a][0]].point(places[a][1]), atol=1e-9)
            np.testing.assert_allclose(ends[-1][1], TOWN.edges[places[b][0]].point(places[b][1]), atol=1e-9)


def test_one_way_roads_go_one_way():
    ring = [Polyline([[0, 0], [1, 0]]), Polyline([[1, 0], [1, 2]]), Polyline([[1, 2], [0, 0]])]
    graph = RoadGraph(ring, one_way=True)
    around = 3 + np.sqrt(5)
    assert graph.shortest_path((0, 0.2), (0, 0.7))[0] == pytest.approx(0.5)
    assert graph.shortest_path((0, 0.7), (0, 0.2))[0] == pytest.approx(around - 0.5)
    assert graph.reachable(0, 0.5, 0.0, 0.4) == [Stretch(0, 0.5, 0.9)]
    apart = RoadGraph([*ring, Polyline([[9, 9], [8, 8]])])
    assert apart.shortest_path((0, 0.1), (3, 0.1)) == (np.inf, [])


def test_reachable_on_simple_roads_is_exact():
    line = RoadGraph([Polyline([[0, 0], [10, 0]]), Polyline([[10, 0], [10, 5]])])
    assert line.reachable(0, 4.0, 1.0, 2.0) == [Stretch(0, 2.0, 3.0), Stretch(0, 5.0, 6.0)]
    assert line.reachable(0, 4.0, 1.0, 2.0, forward=True) == [Stretch(0, 5.0, 6.0)]
    assert line.reachable(0, 8.0, 1.0, 4.0, forward=True) == [Stretch(0, 9.0, 10.0), Stretch(1, 0.0, 2.0)]
    # a dead end sends back
    assert line.reachable(1, 4.0, 2.0, 3.0, forward=True) == [Stretch(1, 3.0, 4.0)]


@pytest.mark.parametrize(("d_lo", "d_hi"), [(0.0, 6.0), (5.0, 9.0), (20.0, 22.0), (30.0, 30.5)])
def test_reachable_holds_every_walk_and_little_else(d_lo, d_hi):
    rng = np.random.default_rng(2)
    for edge, s in [(0, 3.0), (4, 6.0), (6, 1.0), (5, 4.0)]:
        stretches = TOWN.reachable(edge, s, d_lo, d_hi, resolution_m=0.02)
        ends = [walk(TOWN, edge, s, bool(rng.integers(2)), rng.uniform(d_lo, d_hi), rng) for _ in range(3000)]
        assert all(inside(stretches, *end) for end in ends)
        # every stretch is visited all along
        for part in stretches:
            visited = np.sort([x for e, x in ends if e == part.edge and part.s_lo <= x <= part.s_hi])
            gaps = np.diff(np.concatenate([[part.s_lo], visited, [part.s_hi]]))
            assert gaps.max() < 1.3
        assert stretches == sorted(stretches, key=lambda p: (p.edge, p.s_lo))


def test_reachable_from_zero_is_everything_nearer_than_the_horizon():
    places, distance = fine_distances(TOWN, 0.4)
    start = 7
    horizon = 9.0
    stretches = TOWN.reachable(*places[start], 0.0, horizon)
    # no place beyond the horizon, and every place within it: turning round never helps to get somewhere sooner
    for k, place in enumerate(places):
        if 0.4 < place[1] < TOWN.lengths[place[0]] - 0.4:
            assert inside(stretches, *place, slack=-0.05) <= (distance[start, k] <= horizon)
            assert inside(stretches, *place) >= (distance[start, k] <= horizon)


def test_a_long_horizon_ends():
    rng = np.random.default_rng(1)
    lines = []
    for i in range(6):
        for j in range(6):
            jitter = rng.uniform(0, 1e-3, 2)
            lines.append(Polyline([[i, j], np.array([i + 0.5, j]) + jitter, [i + 1, j]]))
            lines.append(Polyline([[i, j], np.array([i, j + 0.5]) + jitter, [i, j + 1]]))
    graph = RoadGraph(lines)
    stretches = graph.reachable(0, 0.5, 38.0, 40.0, resolution_m=0.05)
    assert sum(p.length for p in stretches) > 0.8 * graph.lengths.sum()


def test_misuse_is_named():
    with pytest.raises(WorldError, match="no roads"):
        RoadGraph([])
    with pytest.raises(WorldError, match="2 values of one_way for 1 roads"):
        RoadGraph([Polyline([[0, 0], [1, 0]])], one_way=[True, False])
    with pytest.raises(ValueError, match=r"d_lo = 3"):
        TOWN.reachable(0, 1.0, 3.0, 2.0)
    graph = RoadGraph.from_settings([Road(name="a", points_m=((0, 0), (1, 0)))])
    assert len(graph.nodes) == 2
