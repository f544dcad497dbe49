"""``camnet log``: columns, CSV and events of a run; what it refuses."""

from __future__ import annotations

import csv
import io
import json
import shutil
from pathlib import Path

import artefacts
import numpy as np
import pandas as pd
import pytest

from camnet.cli.main import main


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return artefacts.run_folder(tmp_path_factory.mktemp("runs") / "seed-3", 14.0)


def shown(capsys: pytest.CaptureFixture[str], *words: str | Path, status: int = 0) -> str:
    capsys.readouterr()
    assert main(["log", *map(str, words)]) == status
    out, err = capsys.readouterr()
    return err if status else out


def test_csv_reads_back_to_the_last_bit(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = pd.read_parquet(folder / "log.parquet")
    read = pd.read_csv(io.StringIO(shown(capsys, folder, "--csv")), float_precision="round_trip")
    assert list(read.columns) == list(log.columns)
    np.testing.assert_array_equal(read.to_numpy(float), log.to_numpy())


def test_columns_and_rows_are_chosen(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ("--csv", "--only", "t_s,robot.p_?_m", "--from", "2", "--to", "6", "--every", "5")
    rows = list(csv.reader(io.StringIO(shown(capsys, folder, *words))))
    assert rows[0] == ["t_s", "robot.p_x_m", "robot.p_y_m", "robot.p_z_m"]
    np.testing.assert_allclose([float(r[0]) for r in rows[1:]], np.arange(2.0, 6.01, 0.5), atol=1e-6)


def test_every_column_is_described(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    names = shown(capsys, folder, "--columns").split()
    lines = shown(capsys, folder, "--describe").splitlines()
    assert [line.split()[0] for line in lines] == names
    assert "robot.v_x_mps" in names
    assert json.loads(shown(capsys, folder, "--json"))["columns"]["robot.v_x_mps"]["unit"] == "m/s"


def test_events_are_shown_and_written(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table = shown(capsys, folder, "--events")
    assert "robot" in table
    shown(capsys, folder, "--events", "--csv", "--out", tmp_path / "t")
    assert (tmp_path / "t/events.csv").read_text() == table
    values = json.loads(shown(capsys, folder, "--events", "--json"))["values"]
    assert len(values["event"]) == table.count("\n") - 1


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--only", "robot.p_x"), "did you mean 'robot.p_x_m'"),
        (("--from", "6", "--to", "2"), "--from must be before --to"),
        (("--columns", "--out", "x"), "add --csv"),
        (("--every", "0"), "--every"),
        (("--from", "soon"), "--from"),
        (("--csv", "--describe"), "not allowed"),
    ],
)
def test_wrong_words_are_named(
    words: tuple[str, ...], message: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert message in shown(capsys, folder, *words, status=2)


def test_many_runs_and_none_are_refused(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(folder, tmp_path / "many/seed-3")
    assert "many/seed-3" in shown(capsys, tmp_path / "many", status=2)
    assert "is no folder" in shown(capsys, tmp_path / "none", status=2)
