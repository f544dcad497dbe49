"""Certificates of targets on roads: by hand, from detectors, and against drivers who mean to be lost."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from camnet.certification.transitions import RoadTargetClass
from camnet.config.load import load_scenario
from camnet.errors import DataError
from camnet.experiments.certify_site import certify_road_cameras
from camnet.experiments.certify_world import certify_world
from camnet.experiments.falsify import falsify_world
from camnet.experiments.target_groups import target_groups
from camnet.importers.sumo_detectors import read_detectors, read_sensor_table
from camnet.simulation.network import build_network


def test_road_world_by_hand_and_hostile_drivers():
    scenario = load_scenario("patrol")
    report = certify_world(scenario, model_error_mps=0.05).report
    assert report["claims"]["unseen"]["verdict"] == "certified"
    # at every junction the model knows one way, and the vehicle may take another
    assert report["certificates"]["learned"]["verdict"] == "not certified"
    # views of 8 tan(31 deg) = 4.8 m to each side, less the extent; 40 m of road between the corners
    entry = next(t for t in report["transitions"] if (t["from"], t["to"]) == ("north_west", "north_east"))
    assert entry["gap_m"] == pytest.approx(40 - 2 * (4.8 - 0.3), abs=0.5)
    shorter = certify_world(scenario, off_max_s=30.0).report
    assert shorter["claims"]["unseen"]["verdict"] == "not certified"
    attack = falsify_world(scenario, 400, 0, model_error_mps=0.05)
    assert attack["violations"] == {"unseen": 0, "sound": 0, "learned": 0}
    assert attack["closest_fraction"]["learned"] is None  # claims nothing across junctions
    assert attack["closest_fraction"]["unseen"] == pytest.approx(1.0, abs=1e-6)


def test_equal_road_targets_are_one_class_and_others_are_not():
    scenario = load_scenario("patrol")
    van = scenario.targets[0]
    twin = van.model_copy(update={"name": "twin", "motion": van.motion.model_copy(update={"road": "south"})})
    slow = van.model_copy(
        update={"name": "slow", "motion": van.motion.model_copy(update={"speed_mps": (0.3, 0.5)})}
    )
    names = [g.name for g in target_groups(scenario.model_copy(update={"targets": (van, twin, slow)}), None)]
    assert names == ["vehicle, twin", "slow"]
    report = certify_world(scenario.model_copy(update={"targets": (van, twin, slow)})).report
    assert report["claims"]["unseen"]["verdict"] == "not certified"  # 0.3 m/s needs longer than 60 s
    assert {t["target"] for t in report["uncertified"]} == {"slow"}


def test_a_wrong_longest_way_is_found_out():
    from dataclasses import replace

    from camnet.experiments.falsify import _road_case
    from camnet.experiments.falsify_road import attack_roads

    network = build_network(load_scenario("patrol"))
    case = _road_case(network, [network.description.targets[0].motion], None)
    wrong = replace(case, gaps=replace(case.gaps, longest_m=case.gaps.longest_m - 0.5))
    sound, _ = attack_roads(wrong, 200, np.random.default_rng(0))
    assert sound.violations > 0


LANE = '<lane id="e_0" index="0" shape="0.0,0.0 100.0,0.0 100.0,50.0"/>'
NET = f'<net><edge id="e" from="a" to="b">{LANE}</edge></net>'


def test_detectors_lie_on_their_lanes(tmp_path: Path):
    (tmp_path / "net.xml").write_text(NET)
    add = tmp_path / "d.add.xml"
    add.write_text(
        '<additional><e1Detector id="d" lane="e_0" pos="120"/><e1Detector id="near" lane="e_0" pos="121"/>'
        '<e1Detector id="back" lane="e_0" pos="-140"/></additional>'
    )
    found = read_detectors(add, tmp_path / "net.xml")
    assert [(s.name, s.x_m, s.y_m) for s in found] == [("d", 100.0, 20.0), ("back", 10.0, 0.0)]
    add.write_text('<additional><e1Detector id="d" lane="x_0" pos="1"/></additional>')
    with pytest.raises(DataError, match="lane 'x_0'"):
        read_detectors(add, tmp_path / "net.xml")
    table = tmp_path / "c.csv"
    table.write_text("name,x,y,cost\na,1,2,3\n")
    assert read_sensor_table(table)[0].cost == 3.0
    table.write_text("name,x\na,1\n")
    with pytest.raises(DataError, match="name, x, y, each once"):
        read_sensor_table(table)


def test_city_with_its_detectors(shared_data):
    pytest.importorskip("sumolib")
    folder = shared_data / "bologna"
    done = certify_road_cameras(
        folder / "joined_buslanes.net.xml",
        folder / "joined_detectors.add.xml",
        RoadTargetClass(5.0, 14.0, 1.0),
        footprint_m=30.0,
        off_max_s=60.0,
        on_min_s=0.0,
    )
    assert done.report["network"]["cameras"] > 40
    assert done.report["claims"]["unseen"]["verdict"] == "not certified"
    assert any(t["unseen"]["verdict"] == "certified" for t in done.report["transitions"])
    json.dumps(done.report, allow_nan=False)
