"""Roads of several lanes: what counts as seen, how long ways are, and what traffic on the lanes finds."""

from __future__ import annotations

import csv
import json
import shutil
import subprocess
import sys

import numpy as np
import pytest

from camnet.certification.benchmark import nadir_views
from camnet.certification.coverage import cover_roads
from camnet.certification.road_arcs import arcs_from_lanes, arcs_from_polylines
from camnet.certification.unseen_stretches import stretches_of
from camnet.cli.main import main
from camnet.motion.track import Track

pytest.importorskip("sumolib")


def lanes_of(*offsets, length=100.0):
    return [np.array([[0.0, y], [length, y]]) for y in offsets]


def test_a_place_is_seen_only_where_every_lane_is():
    roads = arcs_from_lanes([lanes_of(0.0, 3.2, 6.4)], [[]])
    one, all_three = np.array([[50.0, 0.0]]), np.array([[50.0, 3.2]])
    assert len(cover_roads(roads, nadir_views(one, 20.0, 12.0), 0.0, 1.0).arc) == 0
    seen = cover_roads(roads, nadir_views(all_three, 20.0, 12.0), 0.0, 1.0)
    assert seen.start_m == pytest.approx([45.0], abs=0.05)  # 6 m to either side less the extent, a ball
    assert seen.end_m == pytest.approx([55.0], abs=0.05)


def test_one_lane_is_what_a_polyline_is():
    lines = [np.array([[0.0, 0], [60, 0], [60, 40]]), np.array([[60.0, 40], [200, 40]])]
    plain = arcs_from_polylines(lines, [[1], []])
    lanes = arcs_from_lanes([[line] for line in lines], [[1], []])
    views = nadir_views(np.array([[60.0, 10.0], [120.0, 38.0]]), 20.0, 30.0)
    a, b = (cover_roads(roads, views, 0.5, 1.0) for roads in (plain, lanes))
    for name in ("arc", "camera", "start_m", "end_m", "depth_m", "deepest_m"):
        assert np.allclose(getattr(a, name), getattr(b, name), atol=1e-9)


def test_a_way_is_as_long_as_its_longest_lane_slopes_and_lane_changes_included():
    turn = np.linspace(0.0, 0.5 * np.pi, 200)
    inner, outer = (np.c_[r * np.cos(turn), r * np.sin(turn)] for r in (10.0, 13.2))
    roads = arcs_from_lanes([[inner, outer]], [[]], [3.2])
    assert roads.length_m[0] == pytest.approx(0.5 * np.pi * 13.2 + 3.2, rel=1e-4)
    ramp = arcs_from_lanes([[np.array([[0.0, 0, 0], [30, 0, 40]])]], [[]])
    assert ramp.length_m[0] == pytest.approx(50.0)


def test_lanes_of_unequal_corners_are_cut_at_common_shares():
    rng = np.random.default_rng(5)
    for _ in range(20):
        lanes = [np.c_[np.sort(rng.uniform(0, 100, n)), rng.uniform(-3, 3, n)] for n in (2, 4, 6)]
        roads = arcs_from_lanes([lanes], [[]])
        view = nadir_views(rng.uniform([20, -3], [80, 3], (1, 2)), 20.0, 40.0)
        seen = cover_roads(roads, view, 0.0, 0.5)
        for s in rng.uniform(0, roads.length_m[0], 200):
            k = int(np.searchsorted(roads.piece_offset_m, s, side="right")) - 1
            rows = slice(roads.line_ptr[k], roads.line_ptr[k + 1])
            points = roads.line_start_xy[rows] + (s - roads.piece_offset_m[k]) * roads.line_direction_xy[rows]
            normals, offsets = view.normals[0], view.offsets[0]
            room = (offsets - np.c_[points, np.zeros(len(points))] @ normals.T).min()
            inside = bool(((seen.start_m < s) & (s < seen.end_m)).any())
            assert inside == (room >= 0.5) or abs(room - 0.5) < 1e-6


def test_stretches_of_a_track_are_what_a_fine_walk_finds():
    rng = np.random.default_rng(7)
    views = nadir_views(rng.uniform(0, 200, (12, 2)), 20.0, 14.0)
    for _ in range(10):
        xy = np.cumsum(rng.normal(0, 6, (60, 2)), axis=0) + 100.0
        t = np.cumsum(rng.uniform(0.5, 1.5, 60))
        found = stretches_of([Track("v", t, np.c_[xy, np.zeros(60)])], views)
        fine = np.linspace(t[0], t[-1], 200_001)
        points = np.c_[np.interp(fine, t, xy[:, 0]), np.interp(fine, t, xy[:, 1]), np.zeros(len(fine))]
        seen = (
            ((views.offsets[:, None] - np.einsum("cfk,pk->cpf", views.normals, points)) >= 0)
            .all(axis=2)
            .any(axis=0)
        )
        step = np.r_[0.0, np.linalg.norm(np.diff(points[:, :2], axis=0), axis=1)]
        edges = np.flatnonzero(np.diff(np.r_[True, seen, True].astype(int)))
        brute = [step[a:b].sum() for a, b in edges.reshape(-1, 2) if b - a > 3]
        ours = [s.length_m for s in found if s.time_s > 4 * (fine[1] - fine[0])]
        assert ours == pytest.approx(brute, abs=0.05)


# ---- the whole command against traffic that a separate walk over the network makes


NODES = {"a": (0, 0), "b": (300, 0), "c": (300, 250), "d": (620, 30)}
STREETS = ("ab", "bc", "ca", "bd")


@pytest.fixture(scope="module")
def network(tmp_path_factory):
    """Four two-lane streets in both directions, 5 m beside their middles, with paths over the junctions."""
    edges, links, inner, lanes = [], [], [], {}
    names = [*STREETS, *(n[::-1] for n in STREETS)]
    for n in names:
        p, q = (np.array(NODES[k], dtype=float) for k in n)
        along = (q - p) / np.linalg.norm(q - p)
        right = np.array([along[1], -along[0]])
        for k in range(2):
            side = right * (1.6 + 3.2 * (1 - k))
            lanes[n, k] = np.array([p + 12 * along + side, q - 12 * along + side])
        shape = [" ".join(f"{x:.3f},{y:.3f}" for x, y in lanes[n, k]) for k in range(2)]
        length = np.linalg.norm(q - p) - 24
        edges.append(
            f'<edge id="{n}" from="{n[0]}" to="{n[1]}" priority="1">'
            + "".join(
                f'<lane id="{n}_{k}" index="{k}" speed="13.9" length="{length:.2f}" shape="{shape[k]}"/>'
                for k in range(2)
            )
            + "</edge>"
        )
    turns = {}
    for i, (n, m) in enumerate((n, m) for n in names for m in names if n[1] == m[0]):
        if m == n[::-1] and n[1] not in "d":
            continue
        for k in range(2):
            ends = [lanes[n, k][1], lanes[m, k][0]]
            middle = 0.5 * (ends[0] + ends[1]) + 3.0 * np.array([1.0, -1.0])
            turns.setdefault((n, m), {})[k] = np.array([ends[0], middle, ends[1]])
            shape = " ".join(f"{x:.3f},{y:.3f}" for x, y in turns[n, m][k])
            inner.append(
                f'<edge id=":{n[1]}_{i}{k}" function="internal"><lane id=":{n[1]}_{i}{k}_0" index="0" speed="8" '
                f'length="{np.linalg.norm(np.diff(turns[n, m][k], axis=0), axis=1).sum():.2f}" shape="{shape}"/></edge>'
            )
            links.append(
                f'<connection from="{n}" to="{m}" fromLane="{k}" toLane="{k}" via=":{n[1]}_{i}{k}_0" dir="s" '
                'state="M"/>'
            )
            links.append(
                f'<connection from=":{n[1]}_{i}{k}" to="{m}" fromLane="0" toLane="{k}" dir="s" state="M"/>'
            )
    junctions = [
        f'<junction id="{k}" type="priority" x="{x}" y="{y}" incLanes="" intLanes="" shape="{x},{y}"/>'
        for k, (x, y) in NODES.items()
    ]
    path = tmp_path_factory.mktemp("lanes") / "lanes.net.xml"
    path.write_text(f'<net version="1.16">{"".join((*inner, *edges, *junctions, *links))}</net>')
    return path, lanes, turns


def drive(lanes, turns, rng, steps=9):
    """Return the points of one vehicle that changes lanes at random places: fixes about 2 m apart."""
    edge, lane = list(lanes)[rng.integers(len(lanes))]
    points = []
    for _ in range(steps):
        change = rng.uniform(0.1, 0.9) if rng.random() < 0.5 else 2.0
        for share in np.linspace(0.0, 1.0, 150):
            if share > change:
                lane, change = 1 - lane, 2.0
            a, b = lanes[edge, lane]
            points.append(a + share * (b - a))
        ways = [m for n, m in turns if n == edge]
        if not ways:
            break
        onward = ways[rng.integers(len(ways))]
        a, b, c = turns[edge, onward][lane]
        points += [p + share * (q - p) for p, q in ((a, b), (b, c)) for share in np.linspace(0.0, 1.0, 10)]
        edge = onward
    return np.array(points)


@pytest.fixture(scope="module")
def traffic(network, tmp_path_factory):
    _, lanes, turns = network
    rng = np.random.default_rng(3)
    ways = [drive(lanes, turns, rng) for _ in range(60)]
    path = tmp_path_factory.mktemp("traffic") / "fcd.xml"
    rows = []
    for k in range(max(map(len, ways))):
        at = "".join(
            f'<vehicle id="v{i}" x="{w[k][0]:.3f}" y="{w[k][1]:.3f}" speed="14"/>'
            for i, w in enumerate(ways)
            if k < len(w)
        )
        rows.append(f'<timestep time="{0.2 * k:.1f}">{at}</timestep>')
    path.write_text(f"<fcd-export>{''.join(rows)}</fcd-export>")
    return path


def run(capsys, *words):
    code = main([str(w) for w in words])
    return code, json.loads(capsys.readouterr().out)


def test_a_design_in_metres_is_not_broken_by_traffic_and_a_thinner_one_is(
    network, traffic, capsys, tmp_path, shared_data
):
    net = network[0]
    out = tmp_path / "design"
    words = ("--roads", net, "--footprint", 14, "--unseen-max-m", 400, "--json", "--quiet")
    code, found = run(capsys, "design", *words, "--check", traffic, "--out", out, "--time-limit", 10)
    assert code == 0
    assert found["certified"]
    assert found["check"]["broken"] == 0
    assert found["check"]["tightness"] > 0.6
    assert found["count"] <= 1.15 * found["lower_bound"]
    judge = shared_data.parent / "tools" / "traffic-check"
    verdict = subprocess.run(
        [sys.executable, judge, traffic, out / "cameras.csv", "--footprint", "14", "--limit", "400"],
        check=False,
    )
    assert verdict.returncode == 0
    with (out / "cameras.csv").open() as stream:
        cameras = list(csv.reader(stream))
    thinner = tmp_path / "thinner.csv"
    thinner.write_text("\n".join(",".join(row) for row in cameras[:-1]))
    code, broken = run(capsys, "certify", *words, "--cameras", thinner, "--check", traffic)
    assert code == 1
    assert broken["claims"]["unseen"]["verdict"] == "not certified"
    said = subprocess.run(
        [sys.executable, judge, traffic, thinner, "--footprint", "14", "--limit", "400", "--slack", "0.5"],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    theirs = json.loads(said.stdout)
    assert broken["check"]["broken"] == sum(theirs["broken"].values()) > 0
    for ours, row in zip(broken["check"]["worst"], theirs["worst"], strict=False):
        assert ours["unseen_m"] == pytest.approx(row["unseen_m"], abs=4.5)  # fixes 2 m apart


def test_checks_without_a_use_are_refused(network, traffic, capsys, tmp_path):
    assert main(["certify", "quickstart", "--check", str(traffic), "--quiet"]) == 2
    assert "--check" in capsys.readouterr().err
    tracks = tmp_path / "people.csv"
    shutil.copy(traffic, tracks)
    assert main(["design", "--tracks", str(tracks), "--unseen-max-m", "5", "--quiet"]) == 2
    assert "--unseen-max-m" in capsys.readouterr().err
