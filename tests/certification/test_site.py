"""Whole sites: free targets against random walks, road reports against their maps."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from camnet.certification.benchmark import generated_city, nadir_views
from camnet.certification.coverage import Views
from camnet.certification.free_network import FreeTargetClass, ground_views
from camnet.certification.growth import error_after
from camnet.certification.site import (
    certify_open_site,
    certify_road_site,
    road_segments_with_verdict,
)
from camnet.certification.transitions import GrowthModel, RoadTargetClass

WALKER = FreeTargetClass(2.0, 0.3)


def open_site():
    views = nadir_views(np.array([[0.0, 0.0], [60.0, 0.0], [0.0, 45.0]]), 20.0, 30.0)
    report = certify_open_site(
        views, ["a", "b", "c"], WALKER, height_m=0.0, off_max_s=5.0, on_min_s=1.0, e0_m=0.5,
        growth=GrowthModel(0.5, 0.4),
    )  # fmt: skip
    return views, report


def test_ground_views_are_squares_with_their_largest_disc():
    views, _ = open_site()
    ground = ground_views(views, ["a", "b", "c"], 0.0, 0.3)
    half = 15.0 - 0.3 / math.cos(math.atan2(15, 20))
    assert ground[0].outline.area == pytest.approx(4 * half**2)
    assert ground[1].radius_m == pytest.approx(half)
    assert ground_views(views, ["a", "b", "c"], -50.0, 0.3)[0].outline.is_empty  # below the far range


def test_open_site_report_by_hand():
    _, report = open_site()
    half = 15.0 - 0.3 / 0.8
    pairs = {(t["from"], t["to"]): t for t in report["transitions"]}
    assert len(pairs) == 6
    ab = pairs["a", "b"]
    assert ab["gap_m"] == pytest.approx(60 - 2 * half)
    assert ab["earliest_s"] == pytest.approx(ab["gap_m"] / 2)
    assert ab["sound"]["trust_horizon_s"] == pytest.approx((half - 0.5) / 2)
    assert ab["sound"]["margin_m"] == pytest.approx(-(ab["gap_m"] + 0.5))
    assert ab["learned"]["trust_horizon_s"] == pytest.approx((half - 0.5) / 0.4)
    largest = ab["learned"]["largest_model_error_mps"]
    assert error_after(0.0, 0.5, largest, 2.0, ab["earliest_s"]) == pytest.approx(half)
    assert pairs["b", "c"]["gap_m"] == pytest.approx(math.hypot(60 - 2 * half, 45 - 2 * half))
    assert report["certificates"]["published"]["verdict"] == "unsatisfiable"
    json.dumps(report, allow_nan=False)


def test_no_walker_arrives_before_the_earliest_time_or_leaves_its_horizon():
    views, report = open_site()
    ground = ground_views(views, ["a", "b", "c"], 0.0, 0.3)
    earliest = {(t["from"], t["to"]): t["earliest_s"] for t in report["transitions"]}
    rng = np.random.default_rng(4)
    p, h, arrivals = rng.uniform(-14, 14, (400, 2)), 0.1, 0
    heading = rng.uniform(0, 2 * np.pi, 400)
    left_s, left_at = np.full(400, np.nan), np.full((400, 2), np.nan)
    for i in range(600):
        heading += rng.normal(size=400) * 0.05
        p = p + h * 2.0 * np.c_[np.cos(heading), np.sin(heading)]
        inside = np.array([g.view.depth(p) >= 0 for g in ground])
        here = inside[0]
        left_s[here], left_at[here] = i * h, p[here]
        for j, name in ((1, "b"), (2, "c")):
            came = inside[j] & np.isfinite(left_s)
            arrivals += int(came.sum())
            assert (i * h - left_s[came] >= earliest["a", name] - 1e-6).all()
    assert arrivals > 100


def test_road_site_and_its_map():
    roads, views = generated_city(16, 5)
    target = RoadTargetClass(5.0, 10.0, 1.0)
    names = [f"c{i}" for i in range(16)]
    report, gaps, tables = certify_road_site(
        roads, views, names, target, height_m=0.5, off_max_s=25.0, on_min_s=0.5, growth=GrowthModel(0.5, 0.2)
    )
    assert report["claims"]["unseen"]["verdict"] == report["unseen"]["verdict"] == "certified"
    assert report["promise"]["unseen_max_s"] <= 25.0
    parts = road_segments_with_verdict(roads, gaps, tables["unseen"], kept=True)
    total = {k: sum(np.linalg.norm(np.diff(x, axis=0)) for x in v) for k, v in parts.items()}
    assert sum(total.values()) == pytest.approx(roads.length_m.sum())
    assert total["seen"] == pytest.approx((gaps.stretches.end_m - gaps.stretches.start_m).sum())
    assert total["uncertified"] == 0
    broken = road_segments_with_verdict(roads, gaps, tables["unseen"], kept=False)
    assert len(broken["uncertified"]) == len(parts["certified"]) - len(broken["certified"])
    fewer = Views(*(x[:6] for x in (views.normals, views.offsets, views.bounds_xy, views.position)))
    report, gaps, tables = certify_road_site(
        roads, fewer, names[:6], target, height_m=0.5, off_max_s=25.0, on_min_s=0.5
    )
    assert report["claims"]["unseen"]["verdict"] == report["unseen"]["verdict"] == "not certified"
    assert len(road_segments_with_verdict(roads, gaps, tables["unseen"], kept=False)["uncertified"]) > 10
