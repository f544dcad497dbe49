from __future__ import annotations

import importlib.util
import os
import shutil
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from camnet.errors import ConfigError, DataError
from camnet.importers import sumo
from camnet.importers.sumo import read_sumo_network, roads_of, run_sumo
from camnet.importers.tracks import Track, TrackOptions, read_tracks
from camnet.importers.traffic import busiest_regions, visits

needs_sumolib = pytest.mark.skipif(not importlib.util.find_spec("sumolib"), reason="sumolib is not installed")
needs_sumo = pytest.mark.skipif(
    not (importlib.util.find_spec("sumo") or shutil.which("sumo")), reason="eclipse-sumo is not installed"
)


@needs_sumolib
def test_streets_of_bologna(shared_data: Path) -> None:
    network = read_sumo_network(shared_data / "bologna/joined_buslanes.net.xml")
    ids = {edge.id for edge in network.edges}
    assert len(ids) == len(network.edges) == 243  # of 267; the rest is for buses
    for edge in network.edges:
        np.testing.assert_array_equal(edge.points[0], network.junctions[edge.start])
        np.testing.assert_array_equal(edge.points[-1], network.junctions[edge.end])
        assert np.all(np.linalg.norm(np.diff(edge.points, axis=0), axis=1) > 0)
        assert set(edge.successors) <= ids
        for other in network.edges:
            if other.id in edge.successors:
                assert other.start == edge.end


@needs_sumolib
def test_roads_meet_where_edges_do_and_every_edge_has_its_road(shared_data: Path) -> None:
    network = read_sumo_network(shared_data / "bologna/joined_buslanes.net.xml")
    roads = {road.name: np.array(road.points_m) for road in roads_of(network)}
    assert len(roads) < len(network.edges)
    corners = {tuple(p) for p in network.junctions.values()}
    assert all(tuple(points[k]) in corners for points in roads.values() for k in (0, -1))
    everything = np.vstack([_dense_line(points) for points in roads.values()])
    for edge in network.edges:
        if edge.id not in roads:  # its opposite direction stands for it
            middle = _dense_line(edge.points)[::20]
            gap = np.linalg.norm(everything[None] - middle[:, None], axis=2).min(axis=1)
            assert np.median(gap) < edge.width_m + 3.0


def _dense_line(points: np.ndarray) -> np.ndarray:
    arc = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    s = np.linspace(0, arc[-1], int(arc[-1]) + 2)
    return np.column_stack([np.interp(s, arc, points[:, k]) for k in (0, 1)])


@needs_sumolib
def test_a_wrong_network_is_a_data_error(tmp_path: Path) -> None:
    path = tmp_path / "n.net.xml"
    for text, message in [
        ("<net>", "not well-formed XML"),
        ("<network/>", "outermost element is <network>; <net> was expected"),
        ('<net version="1.20"/>', "has no edge that passenger cars may use"),
        (
            '<net version="1.20"><edge id="a" from="b" to="c"><lane/></edge></net>',
            "<lane> has no attribute id; it has none",
        ),
    ]:
        path.write_text(text)
        with pytest.raises(DataError, match=message):
            read_sumo_network(path)


def test_without_sumo_the_message_says_how_to_get_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "sumolib", None)
    with pytest.raises(ConfigError, match=r"needs sumolib; install the extra: pip install 'camnet\[sumo\]'"):
        read_sumo_network(tmp_path / "n.net.xml")
    monkeypatch.setattr(sumo.importlib.util, "find_spec", lambda name: None)
    monkeypatch.setattr(sumo.shutil, "which", lambda *args, **kwargs: None)
    with pytest.raises(ConfigError, match=r"needs the program sumo.*camnet\[sumo\]"):
        run_sumo(tmp_path / "a.sumocfg", tmp_path / "f.xml", 10.0)


@needs_sumo
def test_bologna_runs_is_repeatable_and_leaves_the_scenario_alone(shared_data: Path, tmp_path: Path) -> None:
    config = shared_data / "bologna/run.sumocfg"
    before = {p.name: p.stat().st_mtime_ns for p in config.parent.iterdir()}
    first = run_sumo(config, tmp_path / "new" / "a.xml", 20.0, seed=1)
    again = run_sumo(config, tmp_path / "b.xml.gz", 20.0, seed=1)
    assert sorted(p.name for p in tmp_path.rglob("*")) == ["a.xml", "b.xml.gz", "new"]
    assert {p.name: p.stat().st_mtime_ns for p in config.parent.iterdir()} == before
    tracks, same = read_tracks(first, "fcd"), read_tracks(again, "fcd")
    assert [t.id for t in tracks] == [t.id for t in same]
    assert all(np.array_equal(a.p_world, b.p_world) for a, b in zip(tracks, same, strict=True))
    assert len(tracks) > 30
    # a second route to heading and speed: the differences of the positions
    for track in (t for t in tracks if t.t_s.size > 3):
        step = np.diff(track.p_world[:, :2], axis=0)
        far = np.linalg.norm(step, axis=1)
        assert (
            np.median(np.abs(far - track.speed_mps[1:] * np.diff(track.t_s))) < 0.1
        )  # a lane change cuts a bend
        middle = track.heading_rad[:-1] + 0.5 * np.angle(np.exp(1j * np.diff(track.heading_rad)))
        turned = np.angle(np.exp(1j * (np.arctan2(step[:, 1], step[:, 0]) - middle)))
        assert np.median(np.abs(turned[far > 1])) < 0.1 if np.any(far > 1) else True


@needs_sumo
def test_what_sumo_refuses_is_quoted_and_leaves_nothing(tmp_path: Path) -> None:
    config = tmp_path / "in" / "a.sumocfg"
    config.parent.mkdir()
    config.write_text(
        '<sumoConfiguration><input><net-file value="none.net.xml"/></input></sumoConfiguration>'
    )
    with pytest.raises(DataError, match=r"a\.sumocfg: sumo ended with status 1: .*none\.net\.xml"):
        run_sumo(config, tmp_path / "out" / "f.xml", 10.0)
    assert os.listdir(tmp_path / "out") == []
    config.write_text("<nonsense/>")
    with pytest.raises(DataError, match="<sumoConfiguration> was expected"):
        run_sumo(config, tmp_path / "f.xml", 10.0)
    for duration, seed, step, message in [
        (-1, 0, 1, "duration_s is -1"),
        (1, -1, 1, "seed is -1"),
        (1, 0, 0, "step_s is 0"),
    ]:
        with pytest.raises(ConfigError, match=message):
            run_sumo(config, tmp_path / "f.xml", duration, seed, step)


# ------------------------------------------------------------------ busiest regions


def random_walks(count: int) -> list[Track]:
    rng = np.random.default_rng(5)
    walks = []
    for k in range(count):
        steps = rng.normal(0, 8, (30, 2)) + rng.normal(0, 4, 2)
        p = np.column_stack([np.cumsum(steps, axis=0), np.zeros(30)])
        walks.append(Track(str(k), np.arange(30.0), p))
    return walks


def passing(tracks: list[Track], low: np.ndarray, size: float) -> int:
    """Count the tracks that enter a square, by brute force on 5 cm steps."""
    count = 0
    for track in tracks:
        t = np.linspace(track.t_s[0], track.t_s[-1], 6000)
        p = np.column_stack([np.interp(t, track.t_s, track.p_world[:, k]) for k in (0, 1)])
        count += bool(np.any(np.all((p >= low) & (p <= low + size), axis=1)))
    return count


@pytest.mark.parametrize("margin", [0.0, 15.0])
def test_regions_are_counted_right_do_not_overlap_and_the_first_is_the_best(margin: float) -> None:
    tracks = random_walks(25)
    regions = busiest_regions(tracks, 20.0, 6, margin)
    assert len(regions) == 6
    for k, one in enumerate(regions):
        assert abs(one.tracks - passing(tracks, np.array(one.min_m), 20.0)) <= 1
        for other in regions[:k]:
            assert np.max(np.abs(np.subtract(one.min_m, other.min_m))) >= 20.0 + margin - 1e-6
    assert [r.tracks for r in regions] == sorted((r.tracks for r in regions), reverse=True)
    rng = np.random.default_rng(0)
    low, high = (
        np.min([t.p_world[:, :2].min(0) for t in tracks], 0),
        np.max([t.p_world[:, :2].max(0) for t in tracks], 0),
    )
    assert all(passing(tracks, rng.uniform(low - 20, high), 20.0) <= regions[0].tracks + 1 for _ in range(40))


def test_regions_at_given_centres_are_centred_there() -> None:
    tracks = random_walks(25)
    centers = np.random.default_rng(1).uniform(-100, 100, (30, 2))
    for region in busiest_regions(tracks, 20.0, 4, 5.0, centers):
        middle = (np.array(region.min_m) + region.max_m) / 2
        assert np.min(np.linalg.norm(centers - middle, axis=1)) < 1e-5
        assert abs(region.tracks - passing(tracks, np.array(region.min_m), 20.0)) <= 1


def test_visits_agree_with_a_hand_made_crossing() -> None:
    track = Track("a", np.array([0.0, 10.0, 20.0]), np.array([[0.0, 0, 0], [100, 0, 0], [0, 0, 0]]))
    (region,) = busiest_regions([track], 20.0, 1, centers_m=np.array([[50.0, 0.0]]))
    first, second = visits(track, [region], step_m=0.01)
    assert (first.enter_s, first.leave_s) == pytest.approx((4, 6), abs=0.01)
    assert (second.enter_s, second.leave_s) == pytest.approx((14, 16), abs=0.01)


def test_regions_refuse_nonsense() -> None:
    with pytest.raises(DataError, match="no track was given"):
        busiest_regions([], 20.0, 1)
    with pytest.raises(DataError, match="size_m is -1"):
        busiest_regions(random_walks(1), -1.0, 1)
    with pytest.raises(DataError, match="margin_m is nan"):
        busiest_regions(random_walks(1), 1.0, 1, float("nan"))


def test_options_reach_the_fcd_reader(tmp_path: Path) -> None:
    path = tmp_path / "f.xml"
    path.write_text(
        '<fcd-export><timestep time="0"><person id="p" x="0" y="0" angle="0" speed="1"/></timestep></fcd-export>'
    )
    (track,) = read_tracks(path, "fcd", TrackOptions(height_m=2.0))
    assert track.p_world[0, 2] == 2.0


_RUN = "import sys; from camnet.importers.sumo import run_sumo; run_sumo(sys.argv[1], sys.argv[2], float(sys.argv[3]))"


def _running(words: str) -> list[str]:
    """Return the numbers of processes of SUMO that have ``words`` in their command."""
    found = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdecimal():
            with suppress(OSError):  # it is gone
                command = (entry / "cmdline").read_bytes().split(b"\0")
                if command[0].endswith(b"/sumo") and any(words.encode() in word for word in command):
                    found.append(entry.name)
    return found


@needs_sumo
@pytest.mark.skipif(sys.platform != "linux", reason="finds processes by Linux's /proc")
def test_sumo_dies_with_a_killed_run_and_the_next_removes_what_it_left(
    shared_data: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out" / "a.xml"
    command = [sys.executable, "-c", _RUN, str(shared_data / "bologna/run.sumocfg"), str(out)]
    process = subprocess.Popen([*command, "100000"])
    try:
        end = time.monotonic() + 60.0
        while not (running := _running(str(out.parent))) and time.monotonic() < end:
            time.sleep(0.05)
        assert len(running) == 1
    finally:
        process.kill()
        process.wait()
    end = time.monotonic() + 5.0
    while (running := _running(str(out.parent))) and time.monotonic() < end:
        time.sleep(0.05)
    assert running == []
    assert len(os.listdir(out.parent)) == 1  # half-written
    subprocess.run([*command, "5"], check=True)
    assert os.listdir(out.parent) == ["a.xml"]
