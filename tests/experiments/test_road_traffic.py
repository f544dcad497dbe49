"""Designs over SUMO networks against traffic that shares nothing with the certificate.

The traffic walks over lanes and turns as ``sumolib`` gives them; where SUMO is installed, it is SUMO's own too. The
judge is a program of its own beside the recorded inputs.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys

import numpy as np
import pytest

from camnet.cli.main import main

sumolib = pytest.importorskip("sumolib")


def walk(net, rng, steps):
    """Return the points (n, 2) of one vehicle, about 2 m apart: random turns, lane changes anywhere on an edge."""
    edges = net.getEdges(withInternal=False)
    lane = edges[rng.integers(len(edges))].getLanes()[0]
    points = []
    for _ in range(steps):
        edge, change = lane.getEdge(), rng.uniform(0.05, 0.95)
        shares = np.linspace(0.0, 1.0, max(2, int(lane.getLength() / 2.0)))
        before = shares[shares <= change]
        points += [along(lane, s) for s in before]
        lane = edge.getLanes()[rng.integers(len(edge.getLanes()))]
        points += [along(lane, s) for s in shares[len(before) :]]
        links = lane.getOutgoing()
        if not links:
            break
        link = links[rng.integers(len(links))]
        via = link.getViaLaneID()
        while via:
            inner = net.getLane(via)
            points += [along(inner, s) for s in np.linspace(0.0, 1.0, 8)]
            via = inner.getOutgoing()[0].getViaLaneID()
        lane = link.getToLane()
    return np.array(points)


def along(lane, share):
    line = np.array(lane.getShape())
    way = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))]
    return np.array([np.interp(share * way[-1], way, line[:, k]) for k in (0, 1)])


def write_fcd(path, ways):
    rows = []
    for k in range(max(map(len, ways))):
        at = "".join(
            f'<vehicle id="v{i}" x="{w[k][0]:.3f}" y="{w[k][1]:.3f}"/>'
            for i, w in enumerate(ways)
            if k < len(w)
        )
        rows.append(f'<timestep time="{0.2 * k:.1f}">{at}</timestep>')
    path.write_text(f"<fcd-export>{''.join(rows)}</fcd-export>")


def design(capsys, *words):
    status = main(["design", *map(str, words), "--json", "--quiet"])
    return status, json.loads(capsys.readouterr().out)


def judge(shared_data, fcd, cameras, footprint_m, limit_m):
    program = shared_data.parent / "tools" / "traffic-check"
    words = ["--footprint", str(footprint_m), "--limit", str(limit_m), "--slack", "5"]
    done = subprocess.run(
        [sys.executable, program, fcd, cameras, *words], capture_output=True, text=True, check=False
    )
    return done.returncode, json.loads(done.stdout)


def test_vehicles_on_outer_lanes_and_turns_keep_to_what_a_design_promises(shared_data, tmp_path, capsys):
    network = shared_data / "regressions" / "grid3.net.xml"
    net = sumolib.net.readNet(str(network), withInternal=True)
    rng = np.random.default_rng(11)
    fcd = tmp_path / "fcd.xml"
    write_fcd(fcd, [walk(net, rng, 8) for _ in range(60)])
    words = ("--roads", network, "--off-max", 60, "--footprint", 12, "--time-limit", 12, "--check", fcd)
    status, found = design(capsys, *words, "--out", tmp_path / "design")
    assert (status, found["certified"], found["check"]["verdict"]) == (0, True, "kept")
    assert found["unseen_max_m"] == pytest.approx(300.0)
    assert found["count"] <= 1.2 * found["lower_bound"]
    status, said = judge(shared_data, fcd, tmp_path / "design" / "cameras.csv", 12, 300)
    assert (status, sum(said["broken"].values())) == (0, 0)
    assert max(said["longest_m"].values()) > 0.6 * 300.0
    # half of the lower bound's cameras cannot keep it, whatever their places: the judge finds out
    rows = (tmp_path / "design" / "cameras.csv").read_text().splitlines()
    (tmp_path / "half.csv").write_text("\n".join(rows[: len(rows) // 2]))
    status, _ = judge(shared_data, fcd, tmp_path / "half.csv", 12, 300)
    assert status == 1


CITIES = {
    "grid": (
        "--grid",
        "--grid.number",
        "4",
        "--grid.length",
        "180",
        "--grid.attach-length",
        "100",
        "-L",
        "2",
    ),
    "spider": ("--spider", "--spider.arm-number", "6", "--spider.circle-number", "3", "-L", "3"),
    "rand": ("--rand", "--rand.iterations", "60", "--rand.max-distance", "250", "-L", "2"),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", [*CITIES, "bologna"])
def test_simulated_traffic_keeps_to_what_a_design_promises(name, shared_data, tmp_path, capsys):
    sumo = shutil.which("sumo")
    if sumo is None:
        pytest.skip("the program sumo is not on the path")
    network = tmp_path / "net.net.xml"
    if name == "bologna":
        shutil.copy(shared_data / "bologna" / "joined_buslanes.net.xml", network)
    else:
        subprocess.run(
            ["netgenerate", *CITIES[name], "--seed", "4", "-o", network], check=True, capture_output=True
        )
    limit, side = (600, 30) if name == "bologna" else (300, 12)
    trips, fcd = tmp_path / "trips.rou.xml", tmp_path / "fcd.xml.gz"
    net = sumolib.net.readNet(str(network))
    edges = [e.getID() for e in net.getEdges() if e.allows("passenger")]
    rng = np.random.default_rng(2)
    rows = "".join(
        f'<trip id="t{k}" depart="{k}" from="{a}" to="{b}"/>'
        for k, (a, b) in enumerate(rng.choice(edges, (1000, 2)).tolist())
    )
    trips.write_text(f"<routes>{rows}</routes>")
    words = ["--step-length", "0.1", "--time-to-teleport", "-1", "--ignore-route-errors", "--end", "2500"]
    words += ["--collision.action", "none", "--no-warnings", "--no-step-log", "--fcd-output", fcd]
    subprocess.run([sumo, "-n", network, "-r", trips, *words], check=True, capture_output=True)
    status, found = design(
        capsys, "--roads", network, "--unseen-max-m", limit, "--footprint", side, "--out", tmp_path / "d"
    )
    assert (status, found["certified"]) == (0, True)
    assert found["count"] <= 1.15 * found["lower_bound"]
    status, said = judge(shared_data, fcd, tmp_path / "d" / "cameras.csv", side, limit)
    assert (status, sum(said["broken"].values())) == (0, 0)
    assert max(said["longest_m"].values()) >= 0.6 * limit


def test_cameras_that_see_no_road_are_not_certified_and_a_repair_is(shared_data, tmp_path, capsys):
    folder = shared_data / "regressions"
    words = ("--roads", folder / "grid3.net.xml", "--off-max", 60, "--footprint", 12)
    status, found = design(capsys, *words, "--repair", folder / "far.csv", "--time-limit", 3)
    assert (status, found["certified"]) == (1, False)
    assert [c["name"] for c in found["promise"]["blind_cameras"]] == ["a", "b"]
    assert all("longitudes and latitudes?" in line for line in found["warnings"])
    added = [f"{c['name']},{c['x']},{c['y']}" for c in found["additions"]]
    (tmp_path / "repaired.csv").write_text("\n".join(["name,x,y", *added]))
    status = main(
        ["certify", *map(str, words), "--cameras", str(tmp_path / "repaired.csv"), "--json", "--quiet"]
    )
    assert (status, json.loads(capsys.readouterr().out)["promise"]["verdict"]) == (0, "certified")
