"""The simulate command end to end: folder, figures, log, determinism, interruption."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from camnet.cli import simulate
from camnet.cli.main import main

FILES = {"summary.json", "handoffs.json", "log.parquet", "events.parquet", ".camnet.json"}


def run(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str, str]:
    capsys.readouterr()
    status = main(list(arguments))
    out, err = capsys.readouterr()
    return status, out, err


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A short run with every picture."""
    folder = tmp_path_factory.mktemp("run") / "quickstart"
    assert (
        main(["simulate", "quickstart", "--duration", "6", "--out", str(folder), "--seed", "3", "--quiet"])
        == 0
    )
    return folder


def test_a_run_leaves_everything_and_nothing_else(finished: Path) -> None:
    expected = FILES | {"map.png", "estimates.png", "video.mp4", "report.html"}
    assert {p.name for p in finished.iterdir()} == expected
    assert [p.name for p in finished.parent.iterdir()] == ["quickstart"]


def test_the_summary_has_what_others_rely_on(finished: Path) -> None:
    content = json.loads((finished / "summary.json").read_text())
    assert content["seed"] == 3
    assert content["config"]["name"] == "quickstart"
    summary = content["summary"]
    assert {"attempted", "completed"} <= set(summary["handoffs"])
    assert {"mean", "p95"} == set(summary["reacquisition_delay_s"])
    rows = {"learned": summary, **summary["baselines"]}
    assert set(rows) == {"learned", "printed", "ekf", "ideal"}
    for row in rows.values():
        assert (
            {"seen", "unseen", "unseen_first_lap"}
            == set(row["position_rmse_m"])
            == set(row["orientation_rmse_deg"])
        )
    assert {"published", "sound", "violations"} <= set(summary["dwell"])
    assert {"max_error", "bound_exceeded", "disturbance_max"} <= set(summary["controller"])
    assert summary["real_time_factor"] > 0


def test_the_log_says_what_the_summary_says(finished: Path) -> None:
    log = pd.read_parquet(finished / "log.parquet")
    summary = json.loads((finished / "summary.json").read_text())["summary"]
    assert len(log) == 60
    assert (log["robot.seen_by"] >= 0).mean() == pytest.approx(summary["time_in_view"], abs=0.03)
    seen = log[(log["robot.seen_by"] >= 0) & (log["t_s"] > 1.0)]
    error = ((seen["robot.learned.p_x_m"] - seen["robot.p_x_m"]) ** 2).mean() ** 0.5
    assert error < 0.03


def test_the_page_holds_its_pictures(finished: Path) -> None:
    page = (finished / "report.html").read_text()
    assert page.count("data:image/png;base64,") == 2
    assert "data:video/mp4;base64," in page
    assert "http" not in page.split("</style>")[1].split("<pre>")[0]


def test_report_draws_again(finished: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = (finished / "map.png").read_bytes()
    (finished / "map.png").unlink()
    status, _, _ = run(capsys, "report", str(finished), "--no-video", "--quiet")
    assert status == 0
    assert (finished / "map.png").read_bytes() == before


def test_json_is_one_object_on_standard_output(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "camnet.cli.main", "simulate", "quickstart", "--duration", "1", "--json"]
    done = subprocess.run(
        [*command, "--no-report", "--out", str(tmp_path / "run")], capture_output=True, text=True, check=True
    )
    assert set(json.loads(done.stdout)) == {"summary", "seed", "version", "config"}


def test_one_seed_gives_one_log_also_across_processes(tmp_path: Path) -> None:
    options = ["--duration", "9", "--seed", "5", "--no-report", "--quiet"]
    assert main(["simulate", "quickstart", *options, "--out", str(tmp_path / "here")]) == 0
    command = [sys.executable, "-m", "camnet.cli.main", "simulate", "quickstart", *options]
    environment = {**os.environ, "PYTHONHASHSEED": "17"}
    subprocess.run(
        [*command, "--out", str(tmp_path / "there")], check=True, capture_output=True, env=environment
    )
    assert (
        main(
            [
                "simulate",
                "quickstart",
                *options[:2],
                "--seed",
                "6",
                *options[4:],
                "--out",
                str(tmp_path / "other"),
            ]
        )
        == 0
    )
    here, there, other = (
        (tmp_path / name / "log.parquet").read_bytes() for name in ("here", "there", "other")
    )
    assert here == there
    assert here != other


def test_an_interrupted_run_is_valid_and_marked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    @contextmanager
    def impatient(total: float, words: str, unit: str, quiet: bool) -> Iterator[Any]:
        def advance(done: float) -> None:
            if done > 2.0:
                signal.raise_signal(signal.SIGINT)  # what Ctrl-C does

        yield advance

    monkeypatch.setattr(simulate, "progress_bar", impatient)
    arguments = ["simulate", "quickstart", "--duration", "300", "--no-report", "--out", str(tmp_path / "run")]
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # shells have background jobs ignore it
    try:
        assert main(arguments) == 0
    finally:
        signal.signal(signal.SIGINT, before)
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())["summary"]
    assert summary["interrupted"] is True
    assert 2.0 < summary["simulated_s"] < 3.0
    log = pd.read_parquet(tmp_path / "run" / "log.parquet")
    assert log["t_s"].iloc[-1] <= summary["simulated_s"]


def test_a_taken_folder_is_kept_unless_camnet_wrote_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "mine.txt").write_text("keep me")
    arguments = [
        "simulate",
        "quickstart",
        "--duration",
        "1",
        "--no-report",
        "--quiet",
        "--out",
        str(tmp_path),
    ]
    status, _, err = run(capsys, *arguments)
    assert status == 2
    assert "not empty" in err
    assert run(capsys, *arguments, "--force")[0] == 2
    assert (tmp_path / "mine.txt").read_text() == "keep me"
    (tmp_path / "mine.txt").unlink()
    for extra in ([], ["--force"]):
        assert run(capsys, *arguments, *extra)[0] == 0
        assert {p.name for p in tmp_path.iterdir()} == FILES
