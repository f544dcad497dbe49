"""Placement and repair on a small SUMO network, through the command line."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import pytest

pytest.importorskip("sumolib")

from camnet.cli.main import main

STREETS = {
    "ab": ((0, 0), (300, 0)),
    "bc": ((300, 0), (300, 300)),
    "ca": ((300, 300), (0, 0)),
    "bd": ((300, 0), (600, 0)),
}


@pytest.fixture
def network(tmp_path):
    """A triangle with a spur, both directions, as SUMO writes it."""
    places = {"a": (0, 0), "b": (300, 0), "c": (300, 300), "d": (600, 0)}
    edges, links = [], []
    names = [*STREETS, *(n[::-1] for n in STREETS)]
    for n in names:
        (x0, y0), (x1, y1) = places[n[0]], places[n[1]]
        lane = f'<lane id="{n}_0" index="0" speed="14" length="300" shape="{x0},{y0} {x1},{y1}"/>'
        edges.append(f'<edge id="{n}" from="{n[0]}" to="{n[1]}" priority="1">{lane}</edge>')
    for n in names:
        for m in names:
            if n[1] == m[0] and (m != n[::-1] or n == "bd"):
                links.append(f'<connection from="{n}" to="{m}" fromLane="0" toLane="0" dir="s" state="M"/>')
    junctions = [
        f'<junction id="{k}" type="priority" x="{x}" y="{y}" incLanes="" intLanes="" shape="{x},{y}"/>'
        for k, (x, y) in places.items()
    ]
    path = tmp_path / "small.net.xml"
    path.write_text(f'<net version="1.16">{"".join(edges)}{"".join(junctions)}{"".join(links)}</net>')
    return path


def call(capsys, *words):
    code = main([str(w) for w in words])
    return code, json.loads(capsys.readouterr().out)


def test_the_fewest_cameras_of_a_triangle(network, capsys, tmp_path):
    out = tmp_path / "design"
    code, found = call(
        capsys, "design", "--roads", network, "--off-max", 130, "--json", "--quiet", "--out", out
    )
    assert code == 0
    assert {"count", "lower_bound", "gap", "cameras", "certified", "seconds"} <= set(found)
    # 1324 m of streets may not hold an unseen way of 650 m: one camera at b leaves the triangle's 1024 m
    assert found["count"] == found["lower_bound"] == 2
    assert found["certified"]
    assert (out / "cameras.csv").read_text().count("\n") == 3
    # the certifier agrees when it reads the file that the designer wrote
    code, report = call(
        capsys, "certify", "--roads", network, "--cameras", out / "cameras.csv", "--off-max", 130, "--json", "--quiet"
    )  # fmt: skip
    assert report["claims"]["unseen"]["verdict"] == "certified"


def test_more_cameras_allow_less_time_out_of_view(network, capsys):
    times = []
    for count in (2, 3, 4):
        _, found = call(
            capsys, "design", "--roads", network, "--off-max", 200, "--count", count, "--json", "--quiet"
        )
        assert found["count"] <= count
        times.append(found["off_max_s"])
    assert all(a >= b for a, b in pairwise(times))
    assert times[-1] < times[0]


def test_costs_choose_the_cheaper_pole(network, capsys, tmp_path):
    poles = tmp_path / "poles.csv"
    poles.write_text("name,x,y,cost\nb,300,0,1\nc_dear,300,300,5\nc_cheap,296,296,1\na,0,0,9\n")
    _, found = call(
        capsys, "design", "--roads", network, "--poles", poles, "--off-max", 150, "--json", "--quiet"
    )
    names = {c["name"] for c in found["cameras"]}
    assert "c_dear" not in names
    assert found["cost"] <= 2


def test_repairs_name_each_uncertified_way(network, capsys, tmp_path):
    cameras = tmp_path / "cameras.csv"
    cameras.write_text("name,x,y\nb,300,0\nc,300,300\n")
    _, found = call(
        capsys, "design", "--roads", network, "--repair", cameras, "--off-max", 60, "--json", "--quiet"
    )
    assert not found["certified"]
    assert found["repairs"]
    longest = {(r["from"], r["to"]): r for r in found["repairs"]}
    for r in longest.values():
        assert r["changes"]
    _, held = call(
        capsys, "design", "--roads", network, "--repair", cameras, "--off-max", 300, "--json", "--quiet"
    )
    assert held["certified"]


def test_a_repaired_pose_is_certified_and_additions_certify_the_whole(network, capsys, tmp_path):
    """The change that is named is carried out with code of its own, and the certifier agrees."""
    import numpy as np

    from camnet.certification.camera_poses import PoseChange, changed_view
    from camnet.certification.coverage import Coverage, cover_roads
    from camnet.certification.road_gaps import road_gaps
    from camnet.experiments.certify_site import read_road_site

    cameras = tmp_path / "cameras.csv"
    cameras.write_text("name,x,y\na,0,0\nb,300,0\nc,300,300\nd,600,0\n")
    _, found = call(
        capsys, "design", "--roads", network, "--repair", cameras, "--off-max", 76.0, "--json", "--quiet"
    )
    limit = 5.0 * 76.0  # the way from a to c is 424.3 m less twice what is seen at its ends
    row = next(r for r in found["repairs"] if (r["from"], r["to"]) == ("a", "c"))
    assert row["longest_m"] > limit
    poses = [c for c in row["changes"] if "pose" in c]
    assert {c["change"].split()[0] for c in poses} == {"move", "raise", "tilt"}
    site = read_road_site(network)
    places = {"a": (0, 0), "b": (300, 0), "c": (300, 300), "d": (600, 0)}
    for change in poses:
        p = change["pose"]
        amounts = PoseChange(
            p["east_m"], p["north_m"], p["up_m"], np.radians(p["tilt_degrees"]), np.radians(p["towards_degrees"])
        )  # fmt: skip
        parts = []
        for k, (name, place) in enumerate(places.items()):
            own = amounts if name == change["camera"] else PoseChange()
            seen = cover_roads(site.roads, changed_view(np.array(place), 20.0, 30.0, own), 0.5, 1.0)
            columns = [
                seen.arc,
                np.full_like(seen.arc, k),
                seen.start_m,
                seen.end_m,
                seen.depth_m,
                seen.deepest_m,
            ]
            parts.append(np.stack(columns))
        table = np.concatenate(parts, axis=1)
        table = table[:, np.lexsort((table[2], table[0]))]
        gaps = road_gaps(
            site.roads, Coverage(table[0].astype(int), table[1].astype(int), *np.ascontiguousarray(table[2:]))
        )
        stretches = gaps.stretches
        between = (stretches.exit_camera[gaps.exit_stretch] == 0) & (
            stretches.entry_camera[gaps.entry_stretch] == 2
        )
        assert gaps.longest_m[between].max() <= limit + 1e-6
    assert 1 <= len(found["additions"]) <= 2
    all_of_them = tmp_path / "all.csv"
    extra = "".join(f"new {k},{c['x']},{c['y']}\n" for k, c in enumerate(found["additions"]))
    all_of_them.write_text(cameras.read_text() + extra)
    _, report = call(
        capsys, "certify", "--roads", network, "--cameras", all_of_them, "--off-max", 76.0, "--json", "--quiet"
    )  # fmt: skip
    assert report["claims"]["unseen"]["verdict"] == "certified"


def test_objectives(network, capsys, tmp_path):
    poles = tmp_path / "poles.csv"
    poles.write_text(
        "name,x,y,cost\nb,300,0,9\nc,300,300,1\na,0,0,1\nm,150,150,1\nn,300,150,1\no,150,0,1\nd,600,0,9\n"
    )

    def ask(*words):
        return call(
            capsys, "design", "--roads", network, "--poles", poles, "--off-max", 200, "--json", "--quiet", *words
        )[1]  # fmt: skip

    fewest, cheapest, margin = (ask("--objective", o) for o in ("fewest", "cheapest", "margin"))
    assert fewest["count"] <= cheapest["count"]
    price = {"b": 9, "c": 1, "a": 1, "m": 1, "n": 1, "o": 1, "d": 9}
    assert cheapest["cost"] == sum(price[c["name"]] for c in cheapest["cameras"])
    assert cheapest["cost"] <= sum(price[c["name"]] for c in fewest["cameras"])
    assert margin["count"] <= fewest["count"]
    assert margin["off_max_s"] <= 200
    assert main(["design", "--roads", str(network), "--objective", "cheapest", "--quiet"]) == 2
    assert "--poles" in capsys.readouterr().err
    assert main(["design", "--roads", str(network), "--objective", "fewest", "--count", "3", "--quiet"]) == 2


def test_tracks_as_input(capsys, tmp_path):
    """Two people cross; the first one stands for 30 s halfway, which only a camera there can cover."""
    file = tmp_path / "people.csv"
    rows = ["id,t,x,y"]
    rows += [f"a,{t},{t},0" for t in range(0, 41, 10)]
    rows += [f"a,{40 + t},40,0" for t in range(10, 31, 10)]
    rows += [f"a,{70 + t},{40 + t},0" for t in range(10, 41, 10)]
    rows += [f"b,{t},40,{t - 40}" for t in range(0, 81, 10)]
    file.write_text("\n".join(rows) + "\n")
    out = tmp_path / "design"
    words = ("design", "--tracks", file, "--off-max", 45, "--footprint", 10, "--json", "--quiet")
    code, found = call(capsys, *words, "--out", out)
    assert code == 0
    assert found["certified"]
    assert found["tracks"] == 2
    # where they cross one view breaks both: 80 s and 110 s fall into pieces of some 35 s
    assert found["count"] == found["lower_bound"] == 1
    assert abs(found["cameras"][0]["x"] - 40) <= 5
    assert found["longest_unseen_s"] <= 45
    assert (out / "map.png").stat().st_size > 5000
    shorter = call(capsys, *words[:4], 20, *words[5:])[1]
    assert shorter["count"] > 1
    assert shorter["longest_unseen_s"] <= 20.2
    margin = call(capsys, *words, "--objective", "margin")[1]
    assert margin["count"] == 1
    assert margin["off_max_s"] < 45
    assert main(["design", "--tracks", str(file), "--repair", "x.csv"]) == 2


def test_bad_input_is_refused_with_status_2(network, tmp_path, capsys):
    assert main(["design", "--roads", str(network), "--off-max", "1"]) == 2
    assert "candidates together leave an unseen way" in capsys.readouterr().err
    assert main(["certify", "--quiet"]) == 2
    assert main(["certify", "quickstart", "--cameras", "x"]) == 2
    assert main(["falsify", "stationary_loop", "--trials", "0"]) == 2
    assert main(["falsify", "stationary_loop", "--trials", "5", "--quiet"]) == 2
    assert "--learn" in capsys.readouterr().err


@pytest.mark.slow
def test_a_network_by_sumos_own_generator(capsys, tmp_path):
    """Streets that no test was written for: the answer is certified, optimal, and found again by the certifier."""
    generator = shutil.which("netgenerate", path=str(Path(sys.executable).parent)) or shutil.which(
        "netgenerate"
    )
    if generator is None:
        pytest.skip("eclipse-sumo is not installed")
    net = tmp_path / "random.net.xml"
    words = (
        "--rand --rand.iterations 25 --rand.min-distance 80 --rand.max-distance 220 --rand.bidi-probability 1"
    )
    subprocess.run(
        [generator, *words.split(), "--seed", "11", "-o", str(net)], check=True, capture_output=True
    )
    code, found = call(
        capsys, "design", "--roads", net, "--off-max", 100, "--json", "--quiet", "--out", tmp_path / "out"
    )
    assert code == 0
    assert found["certified"]
    assert found["count"] == found["lower_bound"]
    _, report = call(
        capsys, "certify", "--roads", net, "--cameras", tmp_path / "out" / "cameras.csv", "--off-max", 100, "--json"
    )  # fmt: skip
    assert report["claims"]["unseen"]["verdict"] == "certified"


def test_sizes_are_refused_before_they_are_made(tmp_path: Path, capsys):
    from camnet.cli.main import main

    def refused(words: list[str], *mentions: str) -> None:
        assert main([*words, "--quiet"]) == 2
        said = capsys.readouterr().err
        assert all(mention in said for mention in mentions), said

    tracks = tmp_path / "t.csv"
    tracks.write_text("id,t,x,y\na,0,0,0\na,100,50,0\n")
    refused(["design", "--tracks", str(tracks), "--spacing", "1e-9"], "--spacing 1e-09", "1,000,000")
    refused(
        ["design", "--tracks", str(tracks), "--off-max", "100"], "--off-max 100", "nothing asks for a camera"
    )
    tracks.write_text("id,t,x,y\na,0,0,0\na,99999999,50,0\n")
    refused(["design", "--tracks", str(tracks)], "1e+09 looks", "seconds?")
    tracks.write_text("id,t,x,y\na,0,0,0\na,100,1e9,0\n")
    refused(["design", "--tracks", str(tracks)], "1e+09 m from the origin")
