"""Small inputs that certified something false, and what is right: verdict, exit status and figure of each.

The network with eight robots needs a learned model: ``tests/experiments/test_certify_world.py``.
"""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import yaml

from camnet.cli.main import main

DATA = Path(__file__).parent / "data"


def certify(capsys, *words):
    """Run ``camnet certify``; return the exit status and the report."""
    status = main(["certify", *map(str, words), "--json", "--quiet"])
    return status, json.loads(capsys.readouterr().out)


def refused(capsys, *words):
    """Run ``camnet certify`` on bad input; return what it says."""
    assert main(["certify", *map(str, words), "--quiet"]) == 2
    return capsys.readouterr().err


def test_cameras_far_from_every_road_are_named_and_not_certified(capsys, shared_data):
    pytest.importorskip("sumolib")
    network = shared_data / "regressions" / "grid3.net.xml"
    status, report = certify(capsys, "--roads", network, "--cameras", DATA / "far.csv", "--off-max", 60)
    assert status == 1
    assert report["claims"]["unseen"]["verdict"] == "not certified"
    assert report["promise"]["nobody_sees"] == ["any road"]
    assert [c["name"] for c in report["promise"]["blind_cameras"]] == ["a", "b"]
    for words in (*report["warnings"], report["promise"]["reasons"][0]):
        assert "longitudes and latitudes?" in words
        assert "centimetres" in words  # 50,000 / 100 and 60,000 / 100 stand on the site


def test_a_camera_that_looks_away_certifies_nothing(capsys):
    status, report = certify(capsys, DATA / "blind.yaml")
    assert (status, report["promise"]["verdict"]) == (1, "not certified")
    assert report["promise"]["nobody_sees"] == ["guard"]
    assert report["promise"]["bounded"] is False
    (camera,) = report["promise"]["blind_cameras"]
    assert camera["name"] == "a"
    assert "looks away" in camera["reason"]
    assert all(part["verdict"] != "certified" for part in report["claims"]["estimate"].values())


def test_views_of_another_loop_certify_nothing(capsys):
    status, report = certify(capsys, DATA / "two.yaml")
    assert status == 1
    assert report["promise"]["nobody_sees"] == ["car"]
    assert report["transitions"] == []  # the loop that is seen is none of the car's ways
    assert [c["name"] for c in report["promise"]["blind_cameras"]] == ["a", "b"]


@pytest.mark.parametrize("name", ["depot", "depot_off_wall"])
def test_the_depot_agrees_with_rays_along_its_path(capsys, rays, name):
    world = yaml.safe_load((DATA / f"{name}.yaml").read_text())
    hidden = rays.longest_hidden(world)
    status, report = certify(capsys, DATA / f"{name}.yaml")
    promise = report["promise"]
    assert (status, promise["verdict"]) == (0, "certified")
    assert promise["unseen_max_m"] == pytest.approx(hidden, abs=0.2)
    assert promise["unseen_max_s"] == pytest.approx(hidden / 0.8, abs=0.25)
    assert promise["blind_cameras"] == []
    status, report = certify(capsys, DATA / f"{name}.yaml", "--unseen-max-m", hidden - 0.2)
    assert (status, report["promise"]["verdict"]) == (1, "not certified")


def test_regions_larger_than_a_footprint_are_not_certified(capsys):
    status, report = certify(capsys, DATA / "big_regions.yaml")
    assert (status, report["claims"]["unseen"]["verdict"]) == (1, "not certified")
    reasons = " ".join(report["promise"]["reasons"])
    assert "from west to east: from the worst corner of its region the agent needs" in reasons
    assert report["promise"]["unseen_max_s"] is None
    assert report["promise"]["targets_served"] == 1
    assert all(t["unseen"]["verdict"] == "not certified" for t in report["transitions"])
    # with a model that is nearly exact the agents are late all the same
    status, report = certify(capsys, DATA / "big_regions.yaml", "--model-error", 0.001)
    assert status == 1
    assert "worst corner" in " ".join(report["promise"]["reasons"])


def test_overlapping_views_have_no_gap_and_satisfy_theorem_31(capsys):
    status, report = certify(capsys, DATA / "overlap.yaml", "--require", "unseen,published")
    assert status == 0
    assert report["promise"]["unseen_max_m"] == pytest.approx(0.0, abs=1e-3)
    assert report["promise"]["longest"] is None
    published = report["claims"]["estimate"]["published"]
    assert published["verdict"] == "certified"
    assert "0.485 m" in published["reason"]
    assert report["claims"]["estimate"]["sound"]["verdict"] != "certified"
    status, _ = certify(capsys, DATA / "overlap.yaml", "--require", "sound")
    assert status == 1


def test_what_is_allowed_proves_nothing_about_the_estimate(capsys):
    status, report = certify(capsys, "patrol", "--off-max", 1_000_000)
    assert (status, report["claims"]["unseen"]["verdict"]) == (0, "certified")
    assert report["promise"]["unseen_max_s"] == pytest.approx(38.8, abs=0.1)
    assert report["claims"]["estimate"]["sound"]["verdict"] == "refused"
    assert "estimator.gap.prior = 'road'" in report["claims"]["estimate"]["sound"]["reason"]
    assert certify(capsys, "patrol", "--off-max", 1_000_000, "--require", "sound")[0] == 1
    within = (
        "estimator.gap.prior=none",
        "estimator.gap.learn_across=false",
        "estimator.stack.forgetting=false",
    )
    settings = [part for one in within for part in ("--set", one)]
    _, report = certify(capsys, "patrol", "--off-max", 1_000_000, *settings)
    assert report["claims"]["estimate"]["sound"]["verdict"] == "unsatisfiable"
    assert "180 degrees" in report["claims"]["estimate"]["sound"]["reason"]


def test_no_model_knows_the_way_over_a_junction(capsys):
    status, report = certify(capsys, "patrol", "--model-error", 0.05, "--require", "learned")
    assert status == 1
    assert report["claims"]["estimate"]["learned"]["verdict"] == "not certified"
    assert "junction" in report["claims"]["estimate"]["learned"]["reason"]


def test_options_are_applied_or_refused_by_name(capsys):
    before = certify(capsys, "patrol")[1]["promise"]
    status, report = certify(capsys, "patrol", "--v-lo", 0.01, "--v-max", 30, "--on-min", 100)
    assert status == 1
    assert "0.01 to 30 m/s" in report["promise"]["target_class"]
    slow = certify(capsys, "patrol", "--v-lo", 0.01)[1]["promise"]
    assert slow["unseen_max_s"] == pytest.approx(before["unseen_max_m"] / 0.01, rel=0.01)
    assert all(
        t["unseen"]["binding"] == "time in view" or t["unseen"]["margin_s"] < 0 for t in report["transitions"]
    )
    wider = certify(capsys, "patrol", "--extent", 1.0)[1]["promise"]
    assert wider["unseen_max_m"] > before["unseen_max_m"] + 0.5
    assert "--extent 5" in refused(capsys, "patrol", "--extent", 5)
    assert "--v-lo 0.1" in refused(capsys, "stationary_loop", "--v-lo", 0.1)
    assert "--model-error" in refused(capsys, "stationary_loop", "--model-error", 0.1)
    for words in (
        ("--range", 5),
        ("--footprint", 5),
        ("--image", "10x10"),
        ("--duration", 5),
        ("--fix-error", 1),
    ):
        assert words[0] in refused(capsys, "patrol", *words)


def test_premises_that_contradict_each_other_are_refused(capsys):
    words = ("weight_bound=0.001", "sigma_bar=1", "eps_bar=1e-6", "v_lo=1e-4")
    sets = [w for word in words for w in ("--set", f"certificate.{word}")]
    status, report = certify(capsys, "stationary_loop", *sets, "--require", "sound")
    sound = report["claims"]["estimate"]["sound"]
    assert (status, sound["verdict"]) == (1, "refused")
    assert "W_bar sigma_bar + eps_bar" in sound["reason"]
    assert "v_max" in sound["reason"]
    assert all(t["sound"]["verdict"] != "certified" for t in report["transitions"])


def test_a_world_without_targets_promises_nothing(capsys, tmp_path):
    world = yaml.safe_load((DATA / "blind.yaml").read_text())
    world["targets"] = []
    (tmp_path / "world.yaml").write_text(yaml.safe_dump(world))
    assert "give at least one target" in refused(capsys, tmp_path / "world.yaml")
