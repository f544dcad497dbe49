"""What closed walks need at least, against exhaustive search with the certifier's own rule."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from camnet.certification.benchmark import nadir_views
from camnet.certification.closed_walks import LONGEST, WalkSearch, fewest_stretches
from camnet.certification.coverage import cover_roads
from camnet.certification.design import place_cameras
from camnet.certification.road_arcs import arcs_from_polylines
from camnet.certification.way_search import WaySearch, usable_coverage


def block(rng):
    """Return a one-way block of four streets and cameras at random places along them."""
    w, h = rng.uniform(100.0, 300.0, 2)
    corners = np.array([[0.0, 0], [w, 0], [w, h], [0, h], [0, 0]])
    roads = arcs_from_polylines([corners[k : k + 2] for k in range(4)], [[1], [2], [3], [0]])
    side, share = rng.integers(0, 4, 9), rng.uniform(0.0, 1.0, 9)
    places = corners[side] + share[:, None] * (corners[side + 1] - corners[side])
    cover = usable_coverage(roads, cover_roads(roads, nadir_views(places, 20.0, 30.0), 0.5, 1.0), 0.0)
    return roads, cover


@pytest.mark.parametrize("seed", range(12))
def test_the_fewest_stretches_agree_with_exhaustive_search(seed):
    rng = np.random.default_rng(seed)
    roads, cover = block(rng)
    limit = rng.uniform(0.25, 0.9) * roads.length_m.sum()
    search = WaySearch(roads, cover, 9, limit)
    sizes = (
        k
        for k in range(1, 10)
        if any(not search.violations(np.array(some)) for some in itertools.combinations(range(9), k))
    )
    fewest = next(sizes, 0)
    seen = (search.ptr, cover.start_m, cover.end_m, cover.camera, np.zeros(9), limit)
    camera, found, short = fewest_stretches(np.arange(4), roads.length_m, *seen)
    # a camera at a corner sees the end of one street and the start of the next: one stretch
    assert len(camera) == 9
    assert found == fewest
    assert short == (1.0 if fewest else 0.0)


def test_walks_break_a_solution_of_windows_alone_and_the_placement_is_optimal():
    corners = np.array([[0.0, 0], [250, 0], [250, 250], [0, 250], [0, 0]])
    roads = arcs_from_polylines([corners[k : k + 2] for k in range(4)], [[1], [2], [3], [0]])
    t = np.arange(0.0, 4.0, 0.05)
    places = corners[t.astype(int)] + (t % 1.0)[:, None] * np.diff(corners, axis=0)[t.astype(int)]
    cover = usable_coverage(roads, cover_roads(roads, nadir_views(places, 20.0, 12.0), 0.5, 1.0), 0.0)
    search = WaySearch(roads, cover, len(places), 300.0)
    spread = np.full(len(places), 3.25 / len(places))
    assert not search.light_rows(spread, 0.95, 1000)
    (found,) = WalkSearch(search, 0).broken(spread, LONGEST[-1], 10)
    assert found[2] == 4.0
    placed = place_cameras(roads, cover, len(places), 300.0)
    assert (placed.cost, placed.lower_bound) == (4.0, 4.0)
    assert not search.violations(placed.chosen)
    again = place_cameras(roads, cover, len(places), 300.0)
    np.testing.assert_array_equal(again.chosen, placed.chosen)
