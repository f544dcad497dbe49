"""The key-frame experiment: form of its result, its page, and what a short run shows."""

import math

import numpy as np
import pytest

from camnet.errors import ConfigError
from camnet.experiments.key_frame_position import print_table, run, run_case
from camnet.experiments.key_frame_position_run import ROWS
from camnet.experiments.key_frame_setup import CASES, SetUp, WorldSettings

SHORT = SetUp(world=WorldSettings(loops=1))


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    folder = tmp_path_factory.mktemp("key_frames")
    return run(seeds=1, out_dir=folder, setup=SHORT), folder


def test_result_has_every_case_gate_and_row(result, capsys):
    content, folder = result
    assert list(content["cases"]) == list(CASES)
    for by_gate in content["cases"].values():
        assert list(by_gate) == ["3px", "10px"]
        for part in by_gate.values():
            assert list(part["rows"]) == list(ROWS)
            for cells in part["rows"].values():
                assert math.isfinite(cells["rms_m"]["mean"])
                assert cells["rms_m"]["ci95"] is None
                assert cells["max_m"] >= cells["rms_m"]["mean"]
            assert 0.0 <= part["key_frames"]["passed_share"] <= 1.0
            assert 35 < part["key_frames"]["count"] < 50
    for name in ("paths", "errors", "distances"):
        assert (folder / f"{name}_mixed_3px.png").stat().st_size > 1000
    page = (folder / "page.html").read_text()
    assert "0.63" in page
    assert "key frames" in page
    print_table(content)
    assert "published 0.58; 1.00" in capsys.readouterr().out


def test_wider_gate_lets_more_key_frames_pass(result):
    for by_gate in result[0]["cases"].values():
        frames = [by_gate[gate]["key_frames"]["passed_share"] for gate in ("3px", "10px")]
        assert frames[1] > frames[0]


def test_filter_is_below_dead_reckoning_on_gyro_errors(result):
    for case in ("gyro_scale", "mixed"):
        rows = result[0]["cases"][case]["3px"]["rows"]
        assert rows["augmented"]["rms_m"]["mean"] < 0.7 * rows["dead_reckoning"]["rms_m"]["mean"]


def test_equal_seeds_give_equal_runs(result):
    again = run_case(SHORT, "mixed", 0)["3px"]
    assert (
        again.rms("augmented_reuse")
        == result[0]["cases"]["mixed"]["3px"]["rows"]["augmented_reuse"]["rms_m"]["mean"]
    )
    assert np.all(again.error_m["dead_reckoning"][again.landmark] < 0.05)


def test_no_runs_are_refused():
    with pytest.raises(ConfigError, match="seeds: 0"):
        run(0)
