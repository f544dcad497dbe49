"""``camnet evaluate``: JSON, resumption, the same figures on one process and two, clear errors."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from camnet.cli.main import main
from camnet.evaluation.scores import METRICS

SHORT = ["evaluate", "--world", "quickstart", "--agents", "static,random", "--cycles", "20", "--quiet"]
SHORT += ["--back-end", "pybullet"]


def run(capsys: pytest.CaptureFixture[str], *more: str) -> dict:
    assert main([*SHORT, "--json", *more]) == 0
    return json.loads(capsys.readouterr().out)


def test_the_table_is_whole_resumed_and_independent_of_processes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    first = run(capsys, "--episodes", "2", "--jobs", "1", "--out", str(tmp_path / "a"))
    assert first["world"] == "quickstart"
    assert set(first["agents"]) == {"static", "random", "blind"}  # a blind team always plays along
    assert set(first["agents"]["static"]) == set(METRICS)
    figure = first["agents"]["static"]["return"]
    assert figure["ci95"][0] <= figure["mean"] <= figure["ci95"][1]
    other = first["agents"]["random"]["return"]["mean"]
    assert first["comparisons"]["random"]["return"]["mean"] == pytest.approx(figure["mean"] - other)
    lines = tmp_path / "a" / "episodes" / "quickstart-static.jsonl"
    kept = lines.read_text()
    with lines.open("a") as file:
        file.write('{"digest": "half a li')  # a run that was stopped while writing
    again = run(capsys, "--episodes", "2", "--jobs", "1", "--out", str(tmp_path / "a"))
    assert again == first
    assert lines.read_text().startswith(kept)
    more = run(capsys, "--episodes", "3", "--jobs", "2", "--out", str(tmp_path / "a"))
    alone = run(capsys, "--episodes", "3", "--jobs", "1", "--out", str(tmp_path / "b"))
    assert more == alone
    for name in ("result.json", "table.md", "report.html", "scores_quickstart.png"):
        assert (tmp_path / "a" / name).stat().st_size > 0


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--agents", "clever"], "'clever': unknown"),
        (["--agents", "none.npz"], "none.npz: cannot be read"),
        (["--world", "atlantis"], "atlantis"),
        (["--episodes", "0"], "--episodes: '0'"),
        (["--reference", "ekf"], "--reference 'ekf'"),
        (["--agents", "static,static"], "give different names"),
    ],
)
def test_bad_input_is_named_and_leaves_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], words: str
) -> None:
    assert main([*SHORT, *arguments, "--out", str(tmp_path / "out")]) == 2
    assert words in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
