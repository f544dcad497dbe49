"""The search for placements against the certifier, on random road networks: what one allows, the other certifies."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import Delaunay

from camnet.certification.benchmark import nadir_views
from camnet.certification.coverage import cover_roads
from camnet.certification.design import place_cameras
from camnet.certification.road_arcs import RoadArcs, arcs_from_roads
from camnet.certification.site import certify_road_site
from camnet.certification.transitions import RoadTargetClass
from camnet.certification.way_search import WaySearch, usable_coverage
from camnet.errors import CertificateError

HEIGHT_M = 0.5


def random_roads(rng: np.random.Generator) -> list[np.ndarray]:
    """Edges of a triangulation, some left out, some bent."""
    places = rng.uniform(0.0, 400.0, (int(rng.integers(5, 12)), 2))
    pairs = {tuple(sorted(pair)) for t in Delaunay(places).simplices for pair in ((t[0], t[1]), (t[1], t[2]))}
    out = []
    for a, b in sorted(pairs):
        line = [places[a], places[b]]
        if rng.random() < 0.4:
            line.insert(1, 0.5 * (places[a] + places[b]) + rng.uniform(-20.0, 20.0, 2))
        if rng.random() < 0.85:
            out.append(np.array(line))
    return out or [places[:2]]


def certified(roads: RoadArcs, centres: np.ndarray, target: RoadTargetClass, limit_m: float) -> bool:
    """Ask the certifier about cameras at the centres alone."""
    views = nadir_views(centres, 20.0, 30.0)
    names = [f"c{k}" for k in range(len(centres))]
    report, _, _ = certify_road_site(
        roads, views, names, target, height_m=HEIGHT_M, off_max_s=None, off_max_m=limit_m, on_min_s=None
    )
    return bool(report["claims"]["unseen"]["verdict"] == "certified")


def compare(count: int, seed: int) -> tuple[int, int]:
    """Return how many designs were certified and how many other choices were refused; both by both."""
    rng = np.random.default_rng(seed)
    designs = refused = 0
    for _ in range(count):
        lines = random_roads(rng)
        roads, limit = arcs_from_roads(lines), float(rng.uniform(40.0, 600.0))
        target = RoadTargetClass(5.0, 10.0, float(rng.uniform(0.1, 2.0)))
        centres = np.concatenate([line[:1] + rng.random((4, 1)) * (line[-1:] - line[:1]) for line in lines])
        cover = cover_roads(roads, nadir_views(centres, 20.0, 30.0), HEIGHT_M, target.extent_m)
        search = WaySearch(roads, usable_coverage(roads, cover, 0.0), 1 + int(cover.camera.max()), limit)
        try:
            chosen = place_cameras(roads, cover, len(centres), limit).chosen
        except CertificateError:
            assert not certified(roads, centres, target, limit)
            refused += 1
            continue
        assert certified(roads, centres[chosen], target, limit)
        designs += 1
        for _ in range(3):
            few = np.sort(
                rng.choice(len(centres), max(1, len(chosen) + int(rng.integers(-1, 2))), replace=False)
            )
            allowed = not search.violations(few)
            assert certified(roads, centres[few], target, limit) == allowed, (seed, few.tolist(), limit)
            refused += not allowed
    return designs, refused


def test_search_and_certifier_agree() -> None:
    designs, refused = compare(12, 1)
    assert designs >= 4
    assert refused >= 4


@pytest.mark.slow
def test_search_and_certifier_agree_on_a_thousand_networks() -> None:
    designs, refused = compare(1000, 2)
    assert designs >= 300
    assert refused >= 300
