from __future__ import annotations

import importlib.util
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

from camnet.config import Scenario, dump_scenario, load_scenario, traffic
from camnet.config.traffic import expand_traffic
from camnet.errors import DataError
from camnet.geometry.settings import Road
from camnet.importers.tracks import load_tracks, only_track
from camnet.motion.settings import TrackTarget

CITY = """\
name: town
cameras:
  - name: lens
    intrinsics: {width_px: 640, height_px: 480, fx_px: 420.0, fy_px: 420.0, cx_px: 320.0, cy_px: 240.0}
    far_m: 80
traffic:
  sumo_config: run.sumocfg
  camera: lens
  warm_up_s: 10
  duration_s: 60
  targets: 2
  regions: {count: 2, size_m: 40, margin_m: 20, within_m: 500}
controller: {min_height_m: 8}
run: {duration_s: 60}
"""
#: name: (first second, start x, start y, speed along x); all drive on one street, 3 m lanes at y = 0 and y = 3
CARS = {"early": (0, 1000.0, 0.0, 10.0), "late": (40, 1000.0, 0.0, 10.0), "other": (20, 1000.0, 3.2, 10.0)}


def fake_sumo(config: Path, out: Path, duration_s: float, seed: int, step_s: float) -> Path:
    rows = []
    for t in range(int(duration_s) + 1):
        cars = "".join(
            f'<vehicle id="{name}" x="{x + v * (t - begin)}" y="{y}" angle="90" speed="{v}"/>'
            for name, (begin, x, y, v) in CARS.items()
            if begin <= t <= begin + 45
        )
        rows.append(f'<timestep time="{t}">{cars}</timestep>')
    out.parent.mkdir(parents=True, exist_ok=True)
    out.write_bytes(b"")
    plain = out.with_name("fcd.xml")
    plain.write_text(f"<fcd-export>{''.join(rows)}</fcd-export>", encoding="utf-8")
    return plain


@pytest.fixture
def town(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Scenario:
    (tmp_path / "world.yaml").write_text(CITY, encoding="utf-8")
    (tmp_path / "run.sumocfg").write_text("<sumoConfiguration/>", encoding="utf-8")
    monkeypatch.setattr(traffic, "run_sumo", fake_sumo)
    monkeypatch.setattr(
        traffic, "_roads", lambda *_: [Road(name="street", points_m=((0.0, 0.0), (1.0, 0.0)))]
    )
    scenario = load_scenario(tmp_path)
    assert isinstance(scenario, Scenario)
    return scenario


def test_traffic_becomes_a_concrete_world(town: Scenario, tmp_path: Path):
    made = expand_traffic(town, tmp_path / "cache")
    assert made.traffic is None
    assert [len(part) for part in (made.regions, made.agents, made.targets)] == [2, 2, 2]
    assert {agent.region for agent in made.agents} == {region.name for region in made.regions}
    assert (made.controller, made.run) == (town.controller, town.run)
    (tmp_path / "made.yaml").write_text(dump_scenario(made), encoding="utf-8")
    assert load_scenario(tmp_path / "made.yaml") == made


def test_targets_keep_the_common_clock_and_park_around_their_trips(town: Scenario, tmp_path: Path):
    made = expand_traffic(town, tmp_path / "cache")
    motions = [target.motion for target in made.targets]
    assert all(isinstance(motion, TrackTarget) for motion in motions)
    tracks = {motion.id: only_track(load_tracks(motion), "x") for motion in motions}
    # "late" would be parked where "early" drives, so the two cannot both be targets
    assert set(tracks) in ({"early", "other"}, {"late", "other"})
    other = tracks["other"]
    assert other.t_s[0] == 0.0
    assert other.t_s[-1] == 60.0
    x = np.interp([0.0, 10.0, 11.0, 55.0, 60.0], other.t_s, other.p_world[:, 0])
    # the trip begins at 20 s of the simulation, 10 s after the warm-up, and ends 45 s later
    np.testing.assert_allclose(x - x[0], [0.0, 0.0, 10.0, 450.0, 450.0], atol=1e-3)


def test_a_damaged_result_is_made_again(town: Scenario, tmp_path: Path) -> None:
    first = expand_traffic(town, tmp_path / "cache")
    for name in ("tracks.csv", "made.json"):
        (kept,) = (tmp_path / "cache").glob(f"traffic-*/{name}")
        whole = kept.read_text()
        kept.write_text(whole.replace("1", "2", 3))
        assert expand_traffic(town, tmp_path / "cache") == first
        assert kept.read_text() == whole  # made again


def test_the_result_is_kept_and_depends_on_the_settings(town: Scenario, tmp_path: Path, monkeypatch):
    first = expand_traffic(town, tmp_path / "cache")
    monkeypatch.setattr(traffic, "run_sumo", None)  # a second run would fail
    assert expand_traffic(town, tmp_path / "cache") == first
    assert town.traffic is not None
    other = town.model_copy(update={"traffic": town.traffic.model_copy(update={"seed": 7})})
    with pytest.raises(TypeError):
        expand_traffic(other, tmp_path / "cache")


def test_too_little_traffic_is_an_error(town: Scenario, tmp_path: Path):
    assert town.traffic is not None
    near = town.traffic.regions.model_copy(update={"within_m": 1.0})
    lonely = town.model_copy(update={"traffic": town.traffic.model_copy(update={"regions": near})})
    with pytest.raises(DataError, match="two regions"):
        expand_traffic(lonely, tmp_path / "cache")


@pytest.mark.slow
@pytest.mark.skipif(importlib.util.find_spec("sumo") is None, reason="eclipse-sumo is not installed")
def test_the_streets_of_bologna(project_root: Path, shared_data: Path, tmp_path: Path):
    scenario = load_scenario(project_root / "configs" / "bologna.yaml", [f"data={shared_data / 'bologna'}"])
    assert isinstance(scenario, Scenario)
    made = expand_traffic(scenario, tmp_path)
    assert (len(made.regions), len(made.agents), len(made.targets)) == (4, 4, 4)
    clock = np.arange(0.0, 300.0, 0.1)
    paths = []
    for target in made.targets:
        assert isinstance(target.motion, TrackTarget)
        track = only_track(load_tracks(target.motion), target.name)
        paths.append(np.stack([np.interp(clock, track.t_s, track.p_world[:, k]) for k in (0, 1)], axis=1))
    for a, b in combinations(paths, 2):
        assert np.linalg.norm(a - b, axis=1).min() > 2.0
    assert sum(len(road.points_m) > 1 for road in made.roads) > 10
