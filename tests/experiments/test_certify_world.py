"""Worlds and sites through the certifier and the falsifier, with a model made by hand where one is needed."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from fitted_models import fitted_model

from camnet.certification.growth import PlanarField
from camnet.cli.certify_print import print_certificate
from camnet.config.load import load_scenario
from camnet.config.models import Occluder
from camnet.errors import CertificateError, DataError
from camnet.experiments.certified import Certified
from camnet.experiments.certify_flow import (
    certify_learned,
    flow_case,
    ground_of,
    model_errors,
    true_velocity,
)
from camnet.experiments.certify_structure import structure_bounds, structure_report
from camnet.experiments.certify_world import certify_world
from camnet.experiments.falsify import falsify_world
from camnet.experiments.falsify_flow import velocities
from camnet.experiments.learned_model import LearnedModel, load_model
from camnet.experiments.target_groups import join_targets
from camnet.geometry.settings import Box
from camnet.motion.settings import RoadTarget
from camnet.report.certificate import write_certificate
from camnet.simulation.network import build_network

MOVED = "fixed_cameras.north.pose.position_m=[0, 6.6, 3.4]"


@pytest.fixture(scope="module")
def certified_world():
    scenario = load_scenario("stationary_certified")
    return scenario, fitted_model(build_network(scenario))


def test_the_shipped_layout_is_certified_and_hostile_targets_confirm_it(certified_world, tmp_path):
    scenario, model = certified_world
    done = certify_world(scenario, model, find_largest=False)
    report = done.report
    assert report["certificates"]["published"]["verdict"] == "unsatisfiable"
    assert report["certificates"]["learned"]["verdict"] == "certified"
    pairs = {(t["from"], t["to"]) for t in report["transitions"]}
    assert pairs == {("east", "north"), ("north", "west"), ("west", "south"), ("south", "east")}
    assert report["uncertified"] == []
    json.dumps(report, allow_nan=False)
    write_certificate(tmp_path, report, done.views, done.lines)
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "<title>east to north" in page
    assert (tmp_path / "map.png").stat().st_size > 10_000
    attack = falsify_world(scenario, 240, 0, model)
    assert attack["violations"] == {"sound": 0, "learned": 0}
    assert attack["closest_fraction"]["learned"] > 0.5  # not vacuous
    assert attack["lost"] == 0


def test_moving_one_camera_takes_the_certificate_away_and_targets_are_lost(certified_world):
    _, model = certified_world
    scenario = load_scenario("stationary_certified", [MOVED])
    report = certify_world(scenario, model, find_largest=False).report
    assert report["certificates"]["learned"]["verdict"] == "not certified"
    assert {"from": "east", "to": "west"} in report["uncertified"]
    attack = falsify_world(scenario, 90, 0, model)
    assert attack["violations"]["learned"] == 0
    assert attack["lost"] > 0


def test_a_model_error_that_is_too_small_is_found_out(certified_world):
    """The falsifier can fail a certificate: one whose tube rests on a fraction of the true error."""
    scenario, model = certified_world
    from camnet.experiments import falsify_flow

    case = flow_case(build_network(scenario), model, 0.03)
    honest = falsify_flow._scene(
        case, falsify_flow.flow_exits(case.fields, case.ground, case.start, 100.0)[0]
    )
    small = flow_case(build_network(scenario), model, 0.003)
    liar = falsify_flow._scene(small, honest.leave)
    attack = falsify_flow.Attack()
    mixed = falsify_flow._Scene(
        case, honest.field, honest.leave, liar.tube, liar.claim, honest.steps, honest.look
    )
    falsify_flow._judge(mixed, np.random.default_rng(0).uniform(0, 6.28, (40, 9)), True, attack)
    assert attack.violations > 0


def test_model_error_bounds_the_difference_on_a_finer_grid(certified_world):
    scenario, model = certified_world
    network = build_network(scenario)
    limits = model_errors(network, model)
    path = model.path[:, 1:3]
    rng = np.random.default_rng(1)
    points = path[rng.integers(0, len(path), 400)] + rng.uniform(-0.007, 0.007, (400, 2))
    error = np.linalg.norm(true_velocity(network, points) - model.fields()[0].velocity(points), axis=1)
    assert error.max() <= max(limits)
    assert max(limits) < 0.05


def test_compiled_velocities_agree_with_the_field(certified_world):
    _, model = certified_world
    field: PlanarField = model.fields()[0]
    x = np.random.default_rng(2).uniform(-5, 5, (50, 2))
    np.testing.assert_allclose(
        velocities(x, field.centres, field.precision, field.weights), field.velocity(x), atol=1e-6
    )


def test_models_are_saved_and_wrong_ones_refused(certified_world, tmp_path):
    scenario, model = certified_world
    model.save(tmp_path / "model.npz")
    again = load_model(tmp_path / "model.npz")
    np.testing.assert_array_equal(again.weights, model.weights)
    (tmp_path / "no.npz").write_text("x")
    with pytest.raises(DataError, match="writes learned models"):
        load_model(tmp_path / "no.npz")
    fewer = LearnedModel(model.centres, model.precision, model.weights[:2], model.path, model.gaps)
    with pytest.raises(CertificateError, match="learn it again"):
        flow_case(build_network(scenario), fewer)


def test_mobile_network_reports_every_gap_and_its_binding_constraint():
    scenario = load_scenario("quickstart", ["estimator.basis.width_m=1.0", "estimator.basis.spacing_m=0.8"])
    network = build_network(scenario)
    case = flow_case(network, fitted_model(network))
    assert len(case.agents) == 4
    report = certify_learned(case, find_largest=False)
    assert report["network"] == {"cameras": 4, "regions": 4}
    assert [(t["from"], t["to"]) for t in report["transitions"]][:1] != []
    assert all(t["learned"]["binding"] for t in report["transitions"])


def test_every_target_is_certified_and_one_without_a_model_is_not(certified_world):
    scenario, model = certified_world
    first = scenario.targets[0]
    second = first.model_copy(update={"name": "second", "v_max_mps": 0.7})
    both = scenario.model_copy(update={"targets": (first, second)})
    alone = certify_world(both, model, find_largest=False).report
    assert alone["certificates"]["learned"]["verdict"] == "not certified"
    assert "second" in alone["certificates"]["learned"]["reason"]
    assert {t["target"] for t in alone["transitions"]} == {"robot", "second"}
    assert {t["target"] for t in alone["transitions"] if "learned" not in t} == {"second"}
    assert alone["claims"]["unseen"]["verdict"] == "certified"  # it needs no model
    assert alone["uncertified"] == []
    attack = falsify_world(both, 40, 0, {"robot": model, "second": model})
    assert (attack["trials"], attack["violations"]["learned"]) == (40, 0)
    with pytest.raises(CertificateError, match="second"):
        falsify_world(both, 4, 0, model)


def test_joined_reports_are_as_good_as_the_worst():
    def part(*verdicts):
        kinds = ("published", "sound", "learned")
        report = {
            "target_class": "c",
            "certificates": {k: {"verdict": v, "reason": v} for k, v in zip(kinds, verdicts, strict=False)},
            "transitions": [{"from": "a", "to": "b"}],
            "uncertified": [],
            "constants": {},
        }
        return Certified(report, [])

    good = part("unsatisfiable", "certified", "certified")
    both = join_targets({"x": good, "y": good}).report
    assert [v["verdict"] for v in both["certificates"].values()] == [
        "unsatisfiable",
        "certified",
        "certified",
    ]
    worse = join_targets({"x": good, "y": part("unsatisfiable", "unsatisfiable", "not certified")}).report
    assert [v["verdict"] for v in worse["certificates"].values()] == [
        "unsatisfiable", "not certified", "not certified"
    ]  # fmt: skip
    assert [t["target"] for t in worse["transitions"]] == ["x", "y"]


MIXED = """
name: mixed
cameras:
  - name: cam
    intrinsics: {width_px: 640, height_px: 520, fx_px: 417.0, fy_px: 417.0, cx_px: 320.0, cy_px: 260.0}
    near_m: 0.5
    far_m: 6.0
regions:
  - {name: east, shape: {type: box, min_m: [2.2, -2.0, 0.0], max_m: [6.2, 2.0, 3.8]}}
  - name: west
    shape:
      type: extruded_polygon
      vertices_m: [[-6.0, -2.0], [-2.2, -2.0], [-2.2, 2.0], [-6.0, 2.0], [-5.7, 0.0]]
      z_m: [0.0, 3.8]
agents:
  - {name: a0, region: east, camera: cam, start_m: [4.2, 0.0, 2.5]}
  - {name: a1, region: west, camera: cam, start_m: [-4.2, 0.0, 2.5]}
fixed_cameras:
  - {name: north, camera: cam, pose: {position_m: [0.0, 4.2, 3.4], quaternion_wxyz: [0, 1, 0, 0]}}
  - {name: south, camera: cam, pose: {position_m: [0.0, -4.2, 3.4], quaternion_wxyz: [0, 1, 0, 0]}}
roads:
  - name: loop
    closed: true
    points_m: [[4.2, 0.0], [3.88, 1.61], [2.97, 2.97], [1.61, 3.88], [0.0, 4.2], [-1.61, 3.88], [-2.97, 2.97],
               [-3.88, 1.61], [-4.2, 0.0], [-3.88, -1.61], [-2.97, -2.97], [-1.61, -3.88], [0.0, -4.2],
               [1.61, -3.88], [2.97, -2.97], [3.88, -1.61]]
targets:
  - name: robot
    motion: {kind: vector_field, field: loop, road: loop, speed_mps: 0.4}
    start_m: [4.2, -0.6]
    start_heading_rad: 1.57
estimator:
  basis: {width_m: 1.0, spacing_m: 0.7, margin_m: 1.5}
  gap: {prior: none}
certificate: {off_max_s: 20.0, initial_error_m: 0.03, corridor_m: 0.01}
"""


def test_agents_and_fixed_cameras_in_one_network_and_a_region_that_is_not_convex(tmp_path):
    file = tmp_path / "world.yaml"
    file.write_text(MIXED)
    scenario = load_scenario(file)
    network = build_network(scenario)
    case = flow_case(network, fitted_model(network))
    assert [a is None for a in case.agents] == [False, False, True, True]
    report = certify_learned(case, find_largest=False)
    assert report["network"] == {"cameras": 4, "regions": 2}
    verdicts = {(t["from"], t["to"]): t["learned"]["verdict"] for t in report["transitions"]}
    assert verdicts == dict.fromkeys(
        [("east", "north"), ("north", "west"), ("west", "south"), ("south", "east")], "certified"
    )
    attack = falsify_world(scenario, 200, 0, fitted_model(network))
    assert (attack["violations"]["learned"], attack["lost"]) == (0, 0)
    # the same network for a vehicle on the road
    road = RoadTarget(kind="road", road="loop", speed_mps=(0.3, 0.5))
    vehicle = scenario.targets[0].model_copy(
        update={"motion": road, "start_m": None, "start_heading_rad": None}
    )
    driven = scenario.model_copy(update={"targets": (vehicle,)})
    report = certify_world(driven).report
    # what the designer allows is no proof: the estimator's analysis has no dwell time here
    assert report["certificates"]["sound"]["verdict"] == "refused"
    # and without a model nobody tells the agents where to be
    assert report["claims"]["unseen"]["verdict"] == "not certified"
    assert any("motion model" in words for words in report["promise"]["reasons"])
    assert any("footprint" in words for words in report["assumptions"])


def test_an_occluder_takes_its_shadow_from_the_certificate(certified_world):
    """A block on the road below camera "north": the ball must fit a smaller view."""
    scenario, model = certified_world
    block = Occluder(name="block", shape=Box(type="box", min_m=(-0.4, 3.2, 0.0), max_m=(0.4, 5.2, 2.2)))
    shaded = scenario.model_copy(update={"occluders": (block,)})
    bright, dark = (ground_of(build_network(s))[1] for s in (scenario, shaded))
    assert bright.name == dark.name == "north"
    assert dark.outline.area < 0.7 * bright.outline.area
    network = build_network(shaded)
    rng = np.random.default_rng(0)
    eye = network.description.cameras[1].p_world
    region = network.occluders[0]
    for x, y in rng.uniform((-2.5, 2), (2.5, 6.4), (150, 2)):
        if dark.view.depth(np.array([x, y])) < 0.0:
            continue
        ray = eye + np.linspace(0, 1, 400)[:, None] * (np.array([x, y, 0.0]) - eye)
        assert not region.contains(ray).any()  # what counts as seen is seen
    before = certify_world(scenario, model, find_largest=False).report["transitions"]
    after = certify_world(shaded, model, find_largest=False).report["transitions"]
    margin = {t["from"]: t["learned"]["margin_m"] for t in before}
    rows = [t for t in after if t["from"] == "east" and "learned" in t]
    assert rows
    assert all(t["learned"]["margin_m"] <= margin["east"] + 1e-9 for t in rows)


def test_eight_robots_are_more_than_four_agents_serve():
    """The model of one robot serves each of the eight, which are of its class; an agent follows one at a time."""
    world = Path(__file__).parents[1] / "certification" / "data" / "eight.yaml"
    scenario = load_scenario(world)
    first = scenario.targets[0]
    alone = scenario.model_copy(update={"targets": (first,)})
    model = fitted_model(build_network(alone))
    models = {target.name: model for target in scenario.targets[:2]}
    pair = scenario.model_copy(update={"targets": scenario.targets[:2]})
    report = certify_world(pair, models, find_largest=False, at_once=8).report
    promise = report["promise"]
    assert (promise["targets_at_once"], promise["targets_served"]) == (8, 1)
    assert report["claims"]["unseen"]["verdict"] == "not certified"
    assert report["claims"]["estimate"]["learned"]["verdict"] == "not certified"
    assert "8 targets at once" in promise["reasons"][-1]
    one = certify_world(alone, model, find_largest=False).report
    assert (
        one["claims"]["unseen"]["verdict"] == one["claims"]["estimate"]["learned"]["verdict"] == "certified"
    )
    assert one["promise"]["targets_served"] == 1
    assert 4.0 < one["promise"]["unseen_max_s"] < 10.0


def test_e_v_is_a_bound_only_with_a_stated_slope_of_the_law():
    cases = []
    slope = "certificate.field_slope_per_s=0.3"
    for setting in ((), (slope,), (slope, "certificate.initial_error_m=0.1")):
        network = build_network(load_scenario("stationary_certified", setting))
        cases.append(flow_case(network, fitted_model(network)).target)
    sampled, noisy, bounded = cases
    assert (sampled.source, bounded.source) == ("sampled", "deterministic")
    assert noisy.source == "sampled"  # one measurement may be off by more than e(0)
    assert sampled.model_error_mps < bounded.model_error_mps < 0.02


def test_worlds_that_state_errors_of_structure_have_its_dwell_times(capsys, tmp_path):
    world = load_scenario("quickstart", overrides=["certificate.structure.speed_error_mps=0.05"])
    done = certify_world(world, find_largest=False)
    structure = done.report["structure"]
    times = structure["dwell_times"]
    off = times["landmark_out_of_view"]
    assert set(off) == {"published", "sound", "learned"}
    # 0.24 m of room, 0.05 m/s and 0.002 rad/s at 5 m
    assert off["sound"]["seconds"] == pytest.approx(0.24 / (np.sqrt(2.0) * (0.05 + 0.002 * 5.0)))
    assert off["learned"]["seconds"] > off["sound"]["seconds"]
    target = times["target_out_of_view"]
    assert target["published"]["seconds"] is None
    assert target["repaired"]["seconds"] is None
    assert target["learned"]["seconds"] > target["sound"]["seconds"] > 1.0
    allowed = structure["allowed_off_s"]
    expected = "certified" if target["sound"]["seconds"] >= allowed else "not certified"
    assert structure["verdicts"]["sound"] == expected
    assert structure["verdicts"]["published"] == "unsatisfiable"
    assert any(words.startswith("structure:") for words in done.report["assumptions"])
    write_certificate(tmp_path, done.report, done.views, done.lines)
    assert "Dwell times of structure from motion" in (tmp_path / "report.html").read_text(encoding="utf-8")
    print_certificate({**done.report})
    assert "landmark out of view" in capsys.readouterr().out
    json.dumps(done.report, allow_nan=False)


def test_worlds_that_state_nothing_of_structure_have_none():
    assert "structure" not in certify_world(load_scenario("quickstart"), find_largest=False).report


def test_agents_that_fly_by_key_frames_have_dwell_times_of_their_own_velocity_source():
    named = "agents.camera_0.pose"
    world = load_scenario(
        "quickstart", overrides=[f"{named}.source=key_frames", f"{named}.velocity.scale=0.02"]
    )
    network = build_network(world)
    bounds = structure_bounds(network)
    assert bounds.speed_error_mps == pytest.approx(
        0.04 * world.controller.reference_v_max_mps + 0.5 * 5.0 * 0.01
    )
    better = structure_bounds(
        build_network(
            load_scenario(
                "quickstart", overrides=[f"{named}.source=key_frames", f"{named}.velocity.scale=0.0"]
            )
        )
    )
    off = [
        structure_report(n, None)["dwell_times"]["target_out_of_view"]["sound"]["seconds"] for n in (network,)
    ]
    assert better.speed_error_mps < bounds.speed_error_mps
    assert 0.5 < off[0] < 60.0
    # n sqrt(t) is never above what is added for it
    t = np.linspace(0.0, 100.0, 1001)
    assert np.all(np.sqrt(t) <= 0.5 * (1.0 + t))
