"""``certify --model-error conformal``: calibrated on the gaps of simulated flights, it covers gaps of other flights."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from fitted_models import fitted_model

from camnet.cli.main import main
from camnet.config.load import load_scenario
from camnet.experiments.closed_loop.flight_batch import fly_together
from camnet.experiments.closed_loop.plan import PlanSpace
from camnet.simulation.network import build_network

#: most of the gaps' errors are above this, so that e_v is above 0, m
E0_M = 0.005
SETTINGS = [f"certificate.initial_error_m={E0_M}", "run.duration_s=240"]


@pytest.fixture(scope="module")
def flown():
    """Return the gaps (n, 5) of 16 flights from their third lap on, and the network."""
    network = build_network(load_scenario("stationary_certified", SETTINGS))
    space = PlanSpace(1, 240.0)
    plans = [space.plan(genes) for genes in space.random(16, np.random.default_rng(8))]
    rows = []
    for log in fly_together(network, plans, "learned"):
        later = float(log.t_s[np.argmax(log.lap[:, 0] > 2)])
        rows += [(g.from_camera, -1, g.lost_s, g.seen_s, g.error_m) for g in log.gaps if g.lost_s >= later]
    return np.random.default_rng(9).permutation(np.array(rows)), network


def certified_error(gaps, network, confidence, folder, capsys):
    """Return e_v that the command calibrates on ``gaps``: the later half of a model's gaps counts."""
    replace(fitted_model(network), gaps=np.concatenate([gaps, gaps])).save(folder / "model.npz")
    words = ["--set", SETTINGS[0], "--model", str(folder / "model.npz"), "--model-error", "conformal"]
    command = [
        "certify",
        "stationary_certified",
        *words,
        "--confidence",
        str(confidence),
        "--json",
        "--quiet",
    ]
    assert main(command) == 0
    report = json.loads(capsys.readouterr().out)
    assert {t["learned"]["model_error_source"] for t in report["transitions"]} == {"statistical"}
    return report["constants"]["model_error_mps"]


@pytest.mark.parametrize("confidence", [0.95, 0.5])
def test_the_calibrated_error_covers_new_gaps(flown, tmp_path, capsys, confidence):
    """The command's figure is that of the split; over many splits as many of the other gaps keep it as it says."""
    gaps, network = flown
    half = len(gaps) // 2
    assert half >= 40
    e_v = certified_error(gaps[:half], network, confidence, tmp_path, capsys)
    growth = np.maximum(gaps[:, 4] - E0_M, 0.0) / (gaps[:, 3] - gaps[:, 2])
    rank = math.ceil((half + 1) * confidence)
    assert e_v == pytest.approx(np.sort(growth[:half])[rank - 1], abs=1e-12)
    assert 0.0 < e_v < 0.03
    rng, kept = np.random.default_rng(10), []
    for _ in range(400):
        mixed = rng.permutation(growth)
        kept.append(np.mean(mixed[half:] <= np.sort(mixed[:half])[rank - 1]))
    assert confidence - 0.01 <= np.mean(kept) <= confidence + 2.0 / half + 0.01


def test_too_few_gaps_are_refused(flown, tmp_path, capsys):
    gaps, network = flown
    replace(fitted_model(network), gaps=gaps[:20]).save(tmp_path / "model.npz")
    words = ["--model", str(tmp_path / "model.npz"), "--model-error", "conformal", "--confidence", "0.95"]
    assert main(["certify", "stationary_certified", *words, "--quiet"]) == 2
    assert "19" in capsys.readouterr().err
