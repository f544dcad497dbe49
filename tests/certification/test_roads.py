"""Coverage, gaps and verdicts on road networks against sampling, brute force and walking targets."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from camnet.certification.benchmark import benchmark_certify, generated_city, nadir_views
from camnet.certification.coverage import Views, cover_roads, hidden_interval
from camnet.certification.growth import error_after
from camnet.certification.road_arcs import arcs_from_polylines, arcs_from_roads
from camnet.certification.road_gaps import road_gaps
from camnet.certification.transitions import GrowthModel, RoadTargetClass, certify_roads, network_report
from camnet.errors import CertificateError

HEIGHT, EXTENT = 0.5, 1.0


def box_occluder(low, high):
    return np.vstack([np.eye(3), -np.eye(3)]), np.concatenate([high, -np.asarray(low)])


def random_views(rng, n, spread):
    """Tilted pinhole views over the plane."""
    normals, offsets, corners, eyes = [], [], [], []
    for _ in range(n):
        q, r = np.linalg.qr(rng.normal(size=(3, 3)))
        q *= np.sign(np.diag(r))
        forward = np.array([*rng.normal(size=2) * 0.6, -1.0])
        forward /= np.linalg.norm(forward)
        right = np.cross(forward, q[:, 0])
        right /= np.linalg.norm(right)
        rot = np.stack([right, np.cross(forward, right), forward], 1)
        w, h, near, far = *rng.uniform(0.3, 0.8, 2), 1.0, rng.uniform(15, 40)
        cam = np.array(
            [[np.cos(w), 0, -np.sin(w)], [-np.cos(w), 0, -np.sin(w)], [0, np.cos(h), -np.sin(h)],
             [0, -np.cos(h), -np.sin(h)], [0, 0, -1], [0, 0, 1]]
        )  # fmt: skip
        eye = np.array([*rng.uniform(-spread, spread, 2), rng.uniform(6, 15)])
        a = cam @ rot.T
        normals.append(a)
        offsets.append(np.array([0, 0, 0, 0, -near, far]) + a @ eye)
        rays = np.array([[x * np.tan(w), y * np.tan(h), 1.0] for x in (-1, 1) for y in (-1, 1)]) @ rot.T
        corners.append(np.concatenate([eye + near * rays, eye + far * rays]))
        eyes.append(eye)
    return Views.create(*(np.array(x) for x in (normals, offsets, corners, eyes)))


def blocked(eye, points, occluder):
    """Whether the straight lines from the eye to points meet a convex occluder, by the slab method."""
    normals, limits = occluder
    start, slope = limits - normals @ eye, (points - eye) @ normals.T
    low, high = np.zeros(len(points)), np.ones(len(points))
    for f in range(len(limits)):
        with np.errstate(divide="ignore", invalid="ignore"):
            t = start[f] / slope[:, f]
        low = np.where(slope[:, f] < 0, np.maximum(low, t), low)
        high = np.where(slope[:, f] > 0, np.minimum(high, t), high)
        high = np.where((slope[:, f] == 0) & (start[f] < 0), -1.0, high)
    return low <= high


def ball_points(rng, count):
    """Points on the sphere of the target's extent."""
    x = rng.normal(size=(count, 3))
    return EXTENT * x / np.linalg.norm(x, axis=1, keepdims=True)


def cylinder_rims(count):
    """Points on the rims of the upright cylinder about that sphere."""
    angle = 2 * np.pi * np.arange(count) / count
    rim = EXTENT * np.c_[np.cos(angle), np.sin(angle), np.ones(count)]
    return np.r_[rim, rim * [1, 1, -1]]


@pytest.mark.parametrize("seed", range(4))
def test_coverage_matches_point_sampling_with_occluders(seed):
    rng = np.random.default_rng(seed)
    lines = [np.cumsum(rng.normal(size=(6, 2)) * 12, axis=0) for _ in range(5)]
    roads = arcs_from_polylines(lines, [[] for _ in lines])
    views = random_views(rng, 8, 30.0)
    low = np.array([*rng.uniform(-20, 10, 2), 0.0])
    occluders = [box_occluder(low, low + rng.uniform(2, 8, 3)), box_occluder(low + 12, low + 16)]
    cover = cover_roads(roads, views, HEIGHT, EXTENT, occluders)
    assert len(cover.arc) > 3
    checked = 0
    for arc in range(roads.n_arcs):
        s = np.sort(rng.uniform(0, roads.length_m[arc], 400))
        points = np.c_[np.array([roads.position(arc, x) for x in s]), np.full(len(s), HEIGHT)]
        for camera in range(len(views)):
            depth = (views.offsets[camera] - points @ views.normals[camera].T).min(1)
            seen = depth >= EXTENT
            whole = seen.copy()
            for occluder in occluders:
                for part in ball_points(rng, 24):  # some part of the target is hidden
                    seen &= ~blocked(views.position[camera], points + part, occluder)
                for part in 1.1 * np.r_[ball_points(rng, 24), cylinder_rims(24)]:
                    whole &= ~blocked(views.position[camera], points + part, occluder)
            mine = (cover.arc == arc) & (cover.camera == camera)
            inside = ((s[:, None] >= cover.start_m[mine]) & (s[:, None] <= cover.end_m[mine])).any(1)
            assert (inside & ~seen).mean() < 0.005  # samples at the very edge may differ by rounding
            assert (whole & ~inside).mean() < 0.02  # and a little beyond the extent nothing is hidden
            checked += int(seen.sum())
            if mine.any() and (seen & inside).any():
                level = np.linalg.norm(views.normals[camera][:, :2], axis=1)
                disc = (
                    (
                        (views.offsets[camera] - EXTENT - points[seen & inside] @ views.normals[camera].T)
                        / level
                    )
                    .min(1)
                    .max()
                )
                assert disc - 1e-9 <= cover.depth_m[mine].max() <= disc + 0.5
    assert checked > 50


def test_an_eye_inside_the_occluder_sees_nothing():
    occluder = box_occluder(np.zeros(3), np.ones(3) * 2)
    eye, start, direction = np.ones(3), np.array([5.0, 0, 0]), np.array([0.0, 1, 0])
    assert hidden_interval(eye, start, direction, 3.0, *occluder) == (0.0, 3.0)
    assert hidden_interval(np.array([9.0, 9, 5]), start, direction, 3.0, *occluder) is None


def test_straight_road_worked_by_hand():
    # nadir cameras at x = 0 and 100, footprint 30 m at z = 0 from 20 m up; at 0.5 m up: half-width 14.625
    roads = arcs_from_polylines([np.array([[-50.0, 0.0], [150.0, 0.0]])], [[]])
    views = nadir_views(np.array([[0.0, 0.0], [100.0, 0.0]]), 20.0, 30.0)
    lean = EXTENT / math.cos(math.atan2(15, 20))  # the ball touches the slanted side
    half = 15.0 * 19.5 / 20.0 - lean
    cover = cover_roads(roads, views, HEIGHT, EXTENT)
    assert cover.start_m == pytest.approx([50 - half, 150 - half])
    assert cover.end_m == pytest.approx([50 + half, 150 + half])
    assert cover.deepest_m == pytest.approx([50, 150])
    assert cover.depth_m == pytest.approx([half] * 2)  # a level disc: up to the next side
    gaps = road_gaps(roads, cover)
    assert gaps.longest_m == pytest.approx([100 - 2 * half])
    assert gaps.leaves.tolist() == [False, True]
    target = RoadTargetClass(5.0, 10.0, EXTENT)
    growth = GrowthModel(e0_m=0.5, model_error_mps=0.2)
    tables = certify_roads(gaps, target, 20.0, 1.0, growth)
    unseen = tables["unseen"]
    assert unseen.certified.tolist() == [True]
    assert unseen.margin_s == pytest.approx([min(20 - (100 - 2 * half) / 5, 2 * half / 10 - 1)])
    arrival = (100 - half) / 5
    ball = half
    assert tables["learned"].margin_m[0] == pytest.approx(min(ball - (0.5 + 0.2 * arrival), 2 * half - 10))
    assert tables["learned"].horizon_s == pytest.approx([(ball - 0.5) / 0.2])
    largest = growth.largest_model_error(ball, arrival, 10.0)
    assert error_after(0.0, 0.5, largest, 10.0, arrival) == pytest.approx(ball)
    assert not certify_roads(gaps, target, 10.0, 1.0)["unseen"].certified[0]
    assert certify_roads(gaps, target, None, 1.0)["unseen"].certified.tolist() == [True]  # nothing is limited
    assert not certify_roads(gaps, target, None, 1.0, off_max_m=99 - 2 * half)["unseen"].certified[0]
    assert certify_roads(gaps, target, None, 1.0, off_max_m=101 - 2 * half)["unseen"].certified[0]
    # what is allowed proves nothing about the estimate: that rests on the dwell times of its analysis
    assert "sound" not in tables
    proven = {
        times: certify_roads(gaps, target, 20.0, 1.0, dwell=times)["sound"]
        for times in ((20.0, 1.0), (9.0, 1.0))
    }
    assert [t.certified[0] for t in proven.values()] == [True, False]
    assert not certify_roads(gaps, target, 1e6, 0.0, dwell=(None, None))["sound"].certified[0]


def test_an_unseen_circle_is_never_certified():
    square = np.array([[0.0, 0], [40, 0], [40, 40], [0, 40]])
    approach = np.array([[-200.0, 0.0], [0.0, 0.0]])
    leave = np.array([[40.0, 40.0], [240.0, 40.0]])
    sides = [square[[i, (i + 1) % 4]] for i in range(4)]
    lines = [approach, *sides, leave]
    roads = arcs_from_polylines(lines, [[1], [2], [3, 5], [4], [1], []])
    views = nadir_views(np.array([[-100.0, 0.0], [140.0, 40.0]]), 20.0, 30.0)
    gaps = road_gaps(roads, cover_roads(roads, views, HEIGHT, EXTENT))
    assert gaps.cyclic.tolist()[:1] == [True]
    assert np.isinf(gaps.longest_m).all()
    assert gaps.shortest_m[0] < 300
    report = network_report(
        gaps, certify_roads(gaps, RoadTargetClass(5, 10), 1e6, 0.0), RoadTargetClass(5, 10), ["a", "b"]
    )
    assert report["unseen"]["verdict"] == "not certified"
    assert any("circle" in str(u.get("reason")) for u in report["uncertified"])
    json.dumps(report, allow_nan=False)


def walk(roads, rng, start_arc, length):
    """Arcs and arc lengths of a random walk in steps of 0.25 m."""
    arc, s, out = start_arc, 0.0, []
    while len(out) * 0.25 < length:
        if s > roads.length_m[arc]:
            ways = roads.successor[roads.successor_ptr[arc] : roads.successor_ptr[arc + 1]]
            if len(ways) == 0:
                break
            s -= roads.length_m[arc]
            arc = int(rng.choice(ways))
            continue
        out.append((arc, s))
        s += 0.25
    return out


@pytest.mark.parametrize("seed", range(3))
def test_no_walking_target_breaks_the_bounds(seed):
    rng = np.random.default_rng(seed)
    roads, views = generated_city(16, seed)
    kept = rng.permutation(16)[:11]  # some junctions unwatched, so that gaps branch
    views = Views(*(x[kept] for x in (views.normals, views.offsets, views.bounds_xy, views.position)))
    cover = cover_roads(roads, views, HEIGHT, EXTENT)
    gaps = road_gaps(roads, cover)
    seen = gaps.stretches
    pairs = {}
    for row, key in enumerate(
        zip(seen.exit_camera[gaps.exit_stretch], seen.entry_camera[gaps.entry_stretch], strict=True)
    ):
        pairs.setdefault(tuple(int(k) for k in key), []).append(row)
    crossings, worst = 0, 0.0
    for _ in range(15):
        last, unseen, chord = None, 0.0, None
        for arc, s in walk(roads, rng, int(rng.integers(roads.n_arcs)), 3000.0):
            now = np.flatnonzero((seen.arc == arc) & (seen.start_m <= s) & (s <= seen.end_m))
            if len(now) == 0:
                if unseen == 0.0 and chord is not None:
                    assert chord[1] >= seen.chord_m[chord[0]] - 0.6
                unseen += 0.25
                continue
            k = int(now[0])
            if unseen > 0.0 and last is not None:
                key = (int(seen.exit_camera[last]), int(seen.entry_camera[k]))
                rows = pairs[key]  # KeyError: a transition that the certificate does not list
                assert unseen <= gaps.longest_m[rows].max() + 0.6
                assert unseen >= gaps.shortest_m[rows].min() - 0.6
                crossings += 1
                if np.isfinite(gaps.longest_m[rows].max()):
                    worst = max(worst, unseen / gaps.longest_m[rows].max())
            if unseen > 0.0 or last is None:
                chord = [k, 0.0] if last is not None else None
            if chord is not None:
                chord[1] += 0.25
            unseen, last = 0.0, k
    assert crossings > 100
    assert worst > 0.9  # attained, not only bounded


@given(st.integers(0, 10**6), st.integers(3, 9))
@settings(max_examples=60, deadline=None)
def test_gap_lengths_match_exhaustive_enumeration(seed, n):
    """Random directed graphs: shortest and longest unseen ways by plain recursion over all paths."""
    rng = np.random.default_rng(seed)
    nodes = rng.uniform(-200, 200, (n, 2))
    edges = [(i, j) for i in range(n) for j in range(n) if i != j and rng.random() < 0.3]
    if not edges:
        return
    lines = [nodes[[i, j]] for i, j in edges]
    following = [[k for k, (a, _) in enumerate(edges) if a == j] for _, j in edges]
    roads = arcs_from_polylines(lines, following)
    watched = rng.permutation(len(edges))[: max(1, len(edges) // 3)]
    views = nadir_views(np.array([lines[k].mean(0) for k in watched]), 20.0, 30.0)
    cover = cover_roads(roads, views, HEIGHT, EXTENT)
    gaps = road_gaps(roads, cover)
    seen = gaps.stretches

    def explore(arc, travelled, visited, found):
        """All unseen ways from the start of an arc; a repeated arc means an endless way."""
        mine = np.flatnonzero(seen.arc == arc)
        if len(mine):
            found.setdefault(int(mine[0]), []).append(travelled + max(seen.start_m[mine[0]], 0.0))
            return False
        if arc in visited:
            return True
        endless = False
        for b in following[arc]:
            endless |= explore(b, travelled + roads.length_m[arc], visited | {arc}, found)
        return endless

    for stretch in range(len(seen.arc)):
        arc = int(seen.arc[stretch])
        if stretch + 1 < len(seen.arc) and seen.arc[stretch + 1] == arc:
            continue
        left, found, endless = roads.length_m[arc] - seen.end_m[stretch], {}, False
        for b in following[arc]:
            endless |= explore(b, left, frozenset(), found)
        rows = np.flatnonzero(gaps.exit_stretch == stretch)
        got = {int(gaps.entry_stretch[r]): r for r in rows}
        assert bool(gaps.cyclic[gaps.exits == stretch].any()) == endless
        for entry, lengths in found.items():
            if max(lengths) < 1e-6:
                continue
            r = got.pop(entry)
            assert gaps.shortest_m[r] == pytest.approx(min(lengths), abs=1e-6)
            assert gaps.longest_m[r] >= max(lengths) - 1e-6
            if not endless:
                assert gaps.longest_m[r] == pytest.approx(max(lengths), abs=1e-6)
        assert got == {}


def test_a_cut_search_never_certifies_what_it_did_not_follow():
    roads, views = generated_city(16, 1)
    views = Views(*(x[:6] for x in (views.normals, views.offsets, views.bounds_xy, views.position)))
    cover = cover_roads(roads, views, HEIGHT, EXTENT)
    whole, short = road_gaps(roads, cover), road_gaps(roads, cover, search_m=120.0)
    target = RoadTargetClass(5.0, 10.0, EXTENT)
    full = certify_roads(whole, target, 30.0, 1.0)["unseen"]

    def good(gaps, table):
        return set(zip(gaps.exit_stretch[table.certified], gaps.entry_stretch[table.certified], strict=True))

    part = certify_roads(short, target, 30.0, 1.0)["unseen"]
    assert short.cut.any()
    assert good(short, part) <= good(whole, full)


def test_both_directions_meet_at_shared_ends_and_turn_only_at_dead_ends():
    cross = [np.array([[0.0, 0], [50, 0]]), np.array([[50.0, 0], [50, 50]]), np.array([[50.0, 0], [99, 0]])]
    roads = arcs_from_roads(cross)
    following = [
        set(roads.successor[roads.successor_ptr[a] : roads.successor_ptr[a + 1]].tolist()) for a in range(6)
    ]
    assert following == [{2, 4}, {0}, {3}, {1, 4}, {5}, {1, 2}]
    ring = arcs_from_roads([np.array([[0.0, 0], [9, 0], [9, 9]])], [True])
    assert ring.length_m == pytest.approx([18 + math.sqrt(162)] * 2)
    assert ring.successor.tolist() == [0, 1]


def test_report_has_the_documented_fields_and_is_plain_json():
    roads, views = generated_city(9, 3)
    gaps = road_gaps(roads, cover_roads(roads, views, HEIGHT, EXTENT))
    target, growth = RoadTargetClass(5.0, 14.0, EXTENT), GrowthModel(0.5, 0.3)
    tables = certify_roads(gaps, target, 20.0, 1.0, growth, dwell=(20.0, 1.0))
    report = network_report(gaps, tables, target, [f"c{i}" for i in range(9)], growth=growth, on_min_s=1.0)
    json.dumps(report, allow_nan=False)
    assert report["network"] == {"cameras": 9, "regions": 0}
    assert set(report["certificates"]) == {"published", "sound", "learned"}
    assert report["certificates"]["published"]["verdict"] == "unsatisfiable"
    first = report["transitions"][0]
    for claim in ("unseen", "sound"):
        assert set(first[claim]) == {"verdict", "margin_m", "margin_s", "binding"}
    assert {"largest_model_error_mps", "trust_horizon_s"} <= set(first["learned"])
    assert report["certificates"]["sound"]["verdict"] == report["unseen"]["verdict"] == "certified"


def test_a_model_knows_one_way_over_an_unseen_junction():
    cross = [
        np.array([[0.0, 0], [100, 0]]),
        np.array([[100.0, 0], [200, 0]]),
        np.array([[100.0, 0], [100, 100]]),
    ]
    roads = arcs_from_roads(cross)
    target, growth = RoadTargetClass(5.0, 10.0, EXTENT), GrowthModel(0.5, 0.01)
    ends = np.array([[20.0, 0], [180, 0], [100, 80]])
    for centres, unseen_junction in ((ends, True), (np.vstack([ends, [100.0, 0]]), False)):
        gaps = road_gaps(roads, cover_roads(roads, nadir_views(centres, 20.0, 30.0), HEIGHT, EXTENT))
        inner = gaps.longest_m > 1.0
        assert (gaps.branches & inner).any() == unseen_junction
        table = certify_roads(gaps, target, 60.0, 0.0, growth)["learned"]
        assert not table.certified[gaps.branches].any()
        assert table.certified[~gaps.branches].all()


def test_benchmark_runs_and_counts():
    result = benchmark_certify((20, 60))
    assert [case["cameras"] for case in result["cases"]] == [20, 60]
    assert all(case["transitions"] > 20 for case in result["cases"])


def test_misuse_is_refused():
    with pytest.raises(CertificateError, match="v_lo_mps"):
        RoadTargetClass(0.0, 2.0)
    with pytest.raises(CertificateError, match="no length"):
        arcs_from_polylines([np.zeros((2, 2))], [[]])
    with pytest.raises(CertificateError, match="successors"):
        arcs_from_polylines([np.array([[0.0, 0], [1, 0]])], [[3]])
