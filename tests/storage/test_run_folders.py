"""Run folders, kept scores, other JSON: a change of content is refused or counts as absent, one of form is nothing."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import artefacts
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from camnet.cli.main import main
from camnet.cli.simulate_many import _finished
from camnet.errors import DataError
from camnet.evaluation.kept import keep_scores, kept_scores
from camnet.evaluation.play import Match
from camnet.report.run_data import load_run
from camnet.simulation.run_files import read_run
from camnet.storage.json_file import parse_json, read_json
from camnet.storage.marker import MARKER, read_marker, write_marker
from camnet.storage.seal import seal_of

NAMES = ("summary.json", "handoffs.json", "log.parquet", "events.parquet")


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return artefacts.run_folder(tmp_path_factory.mktemp("runs") / "seed-3", 14.0)


@pytest.fixture
def run(written: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(written, tmp_path / "seed-3"))


def refused(run: Path, name: str, match: str | None = None) -> None:
    with pytest.raises(DataError, match=match) as caught:
        read_run(run)
    assert str(run / name) in str(caught.value)


def changed_json(path: Path, change: Callable[[Any], object]) -> None:
    content = json.loads(path.read_text())
    change(content)
    path.write_text(json.dumps(content))


def places(content: Any, at: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Where every plain value of a JSON content is."""
    if isinstance(content, dict):
        return [place for k, v in content.items() for place in places(v, (*at, k))]
    if isinstance(content, list):
        return [place for k, v in enumerate(content) for place in places(v, (*at, k))]
    return [at]


def other(value: object) -> object:
    """A value of the same kind that is not the same."""
    if isinstance(value, bool):
        return not value
    if isinstance(value, int | float):
        return value + 1
    return 0.5 if value is None else f"{value}x"


def test_there_is_something_to_read(written: Path) -> None:
    files = read_run(written)
    assert len(files.handoffs) > 0
    assert len(files.columns["t_s"]) == 140
    assert load_run(written).summary == files.content["summary"]


@pytest.mark.parametrize("name", ["summary.json", "handoffs.json"])
def test_any_changed_value_is_refused(run: Path, name: str) -> None:
    path = run / name
    before = path.read_text()
    found = [p for p in places(json.loads(before)) if p[-1] != "real_time_factor"]
    rng = np.random.default_rng(0)
    for k in rng.permutation(len(found))[:80].tolist():
        *way, last = found[k]

        def change(content: Any, way: list[Any] = way, last: Any = last) -> None:
            for key in way:
                content = content[key]
            content[last] = other(content[last])

        path.write_text(before)
        changed_json(path, change)
        with pytest.raises(DataError, match=r"\.json|config|(log|events)\.parquet"):
            read_run(run)


@pytest.mark.parametrize("key", ["summary", "seed", "version", "config", "seals"])
def test_missing_and_wrong_parts_of_a_summary_are_refused(run: Path, key: str) -> None:
    path = run / "summary.json"
    before = path.read_text()
    changed_json(path, lambda content: content.pop(key))
    refused(run, "summary.json")
    for wrong in (None, [], "x", 3.5, {}):
        path.write_text(before)
        changed_json(path, lambda content, wrong=wrong: content.update({key: wrong}))
        refused(run, "summary.json")


@pytest.mark.parametrize(
    ("text", "match"),
    [
        (b"", "not valid JSON"),
        (b"\xff{}", "not valid JSON"),
        (b'{"summary": NaN}', "no number of JSON"),
        (b'{"summary": -Infinity}', "no number of JSON"),
        (b'{"summary": 1e400}', "range"),
        (b"9" * 10_000, "digits"),
        (b'{"a": ' * 5000 + b"1" + b"}" * 5000, "nested"),
        (b"[" * 100 + b"]" * 100, "nested"),
        (b'{"seed": 1, "seed": 2}', "twice"),
        (b"[]", "not the summary"),
        (b'"text"', "not the summary"),
        (b"null", "not the summary"),
    ],
)
def test_json_that_is_none_is_refused(run: Path, text: bytes, match: str) -> None:
    (run / "summary.json").write_bytes(text)
    refused(run, "summary.json", match)
    if "summary" not in match:
        with pytest.raises(DataError, match=match):
            parse_json(text, "here")


def test_large_files_are_not_read(tmp_path: Path) -> None:
    path = tmp_path / "large.json"
    with path.open("wb") as stream:
        stream.truncate(300_000_000)  # takes no room on the disk
    with pytest.raises(DataError, match="more than the limit"):
        read_json(path)


@pytest.mark.parametrize("name", NAMES)
def test_files_that_are_missing_cut_or_folders_are_refused(run: Path, name: str) -> None:
    path = run / name
    content = path.read_bytes()
    for cut in (0, 10, len(content) // 2, len(content) - 3):
        path.write_bytes(content[:cut])
        refused(run, name)
    path.unlink()
    refused(run, name, "No such file")
    path.mkdir()
    refused(run, name, "no file")
    path.rmdir()
    path.symlink_to(path)
    refused(run, name, "cannot be read")


def table_of(run: Path) -> pa.Table:
    return pq.read_table(run / "log.parquet")


def written_back(run: Path, table: pa.Table, **options: Any) -> None:
    pq.write_table(table, run / "log.parquet", **options)


WRONG_COLUMNS: dict[str, Callable[[pa.ChunkedArray], Any]] = {
    "single": lambda c: c.cast(pa.float32()),
    "integers": lambda c: c.cast(pa.int64(), safe=False),
    "text": lambda c: c.cast(pa.string()),
    "nulls": lambda c: pa.array([None, *c.to_pylist()[1:]], pa.float64()),
    "nan": lambda c: pa.array([*c.to_pylist()[:-1], float("nan")], pa.float64()),
    "infinite": lambda c: pa.array([*c.to_pylist()[:-1], float("inf")], pa.float64()),
    "huge": lambda c: pa.array([*c.to_pylist()[:-1], 1e300], pa.float64()),
    "scaled": lambda c: pa.array((c.to_numpy() * 1.001 + 1e-6), pa.float64()),
    "cut": lambda c: pa.array(np.trunc(c.to_numpy()) + 0.0, pa.float64()),
}


@pytest.mark.parametrize("change", WRONG_COLUMNS)
def test_any_changed_column_is_refused(run: Path, change: str) -> None:
    table = table_of(run)
    for name in ("t_s", "robot.p_x_m", "robot.learned.p_y_m", "camera_1.cam_q_w", "robot.q_w"):
        k = table.column_names.index(name)
        written_back(run, table.set_column(k, name, WRONG_COLUMNS[change](table.column(name))))
        refused(run, "log.parquet")


def test_rows_and_columns_must_be_those_of_the_run(run: Path) -> None:
    table = table_of(run)
    for wrong in (
        table.slice(0, len(table) - 1),
        table.slice(1),
        table.slice(0, 0),
        pa.concat_tables([table, table]),
        table.take(list(reversed(range(len(table))))),
        table.drop_columns(["t_s"]),
        table.drop_columns(["robot.seen_by"]),
        table.append_column("more", table.column("t_s")),
        table.append_column("t_s", table.column("t_s")),
        table.rename_columns([n.replace("robot.p_x", "robot.p_X") for n in table.column_names]),
        pa.table({"a": [1.0, 2.0]}),
    ):
        written_back(run, wrong)
        refused(run, "log.parquet")


def test_form_changes_nothing(run: Path, written: Path) -> None:
    before = read_run(written)
    table = table_of(run)
    written_back(run, table.select(list(reversed(table.column_names))), compression="gzip", row_group_size=17)
    for name in ("summary.json", "handoffs.json"):
        content = json.loads((run / name).read_text())
        if isinstance(content, dict):
            content = dict(reversed(content.items()))
        (run / name).write_text(json.dumps(content, indent=7).replace("\n", "\r\n"))
    (run / MARKER).unlink(missing_ok=True)
    (run / "notes.txt").write_text("mine")
    after = read_run(run)
    assert after.content == before.content
    assert after.handoffs == before.handoffs
    for name, values in before.columns.items():
        np.testing.assert_array_equal(after.columns[name], values)
    table.to_pandas().to_parquet(run / "log.parquet")  # its NaN become empty cells
    np.testing.assert_array_equal(
        read_run(run).columns["robot.off_left_s"], before.columns["robot.off_left_s"]
    )


def test_the_real_time_factor_is_a_measurement_and_not_sealed(run: Path) -> None:
    changed_json(run / "summary.json", lambda c: c["summary"].update(real_time_factor=3.0))
    assert read_run(run).content["summary"]["real_time_factor"] == 3.0
    changed_json(run / "summary.json", lambda c: c["summary"].update(real_time_factor=-3.0))
    refused(run, "summary.json", "real_time_factor")


def test_report_refuses_with_status_2_and_writes_nothing(
    run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    changed_json(run / "handoffs.json", lambda c: c[0].update(completed=not c[0]["completed"]))
    before = {path.name for path in run.iterdir()}
    assert main(["report", str(run), "--no-video", "--quiet"]) == 2
    _, err = capsys.readouterr()
    assert "handoffs.json" in err
    assert len(err.strip().splitlines()) == 1
    assert {path.name for path in run.iterdir()} == before
    assert main(["report", str(run / "nowhere"), "--quiet"]) == 2


def test_damaged_seeds_count_as_absent(run: Path, caplog: pytest.LogCaptureFixture) -> None:
    files = read_run(run)
    assert _finished(run.parent, files.scenario, 3)
    assert not _finished(run.parent, files.scenario, 4)
    changed_json(run / "summary.json", lambda c: c["summary"].update(time_in_view=0.5))
    assert not _finished(run.parent, files.scenario, 3)
    assert "seed 3 is run again" in caplog.text
    shutil.rmtree(run)
    run.write_text("a file")
    assert not _finished(run.parent, files.scenario, 3)


# --- scores of an evaluation --------------------------------------------------------------------------

MATCH = Match("learned", "quickstart", 50)
SEEDS = range(1000, 1006)


def kept(folder: Path) -> dict[int, Any]:
    return kept_scores(folder, MATCH, "pybullet", SEEDS)


def test_scores_come_back(tmp_path: Path) -> None:
    artefacts.scores(tmp_path, MATCH, SEEDS)
    assert set(kept(tmp_path)) == set(SEEDS)
    assert kept_scores(tmp_path, MATCH, "batch", SEEDS) == {}
    assert kept(tmp_path / "nowhere") == {}


BAD_LINES = [
    b"",
    b"x",
    b"{}",
    b"[]",
    b"null",
    b"\xff\xfe",
    b'{"digest": "d", "seed": 1',
    b'{"digest": "d", "seed": NaN, "score": {}, "seal": ""}',
    b"[" * 50_000,
    b"9" * 50_000,
]


@pytest.mark.parametrize("bad", BAD_LINES)
def test_damaged_lines_count_as_absent_and_go(
    tmp_path: Path, bad: bytes, caplog: pytest.LogCaptureFixture
) -> None:
    path = artefacts.scores(tmp_path, MATCH, SEEDS)
    lines = path.read_bytes().splitlines()
    path.write_bytes(b"\n".join([*lines[:2], bad, *lines[3:]]))
    assert set(kept(tmp_path)) == set(SEEDS) - {1002}
    assert "played again" in caplog.text
    assert len(path.read_bytes().splitlines()) == len(SEEDS) - 1
    keep_scores(tmp_path, MATCH, "pybullet", {1002: dict.fromkeys(json.loads(lines[0])["score"], 0.0)})
    assert set(kept(tmp_path)) == set(SEEDS)


@pytest.mark.parametrize(
    "change",
    [
        lambda e: e.update(seed=1003.0),
        lambda e: e.update(seed="1002"),
        lambda e: e.update(seed=True),
        lambda e: e.update(more=1),
        lambda e: e.pop("seal"),
        lambda e: e.update(seal=0),
        lambda e: e["score"].update(more=1.0),
        lambda e: e["score"].pop("return"),
        lambda e: e["score"].update({"return": "9"}),
        lambda e: e["score"].update({"return": True}),
        lambda e: e["score"].update({"return": e["score"]["return"] + 1}),
        lambda e: e["score"].update({"return": None}),
        lambda e: e.update(score=[]),
        lambda e: e.update(digest=7),
    ],
)
def test_changed_lines_count_as_absent(tmp_path: Path, change: Callable[[dict[str, Any]], object]) -> None:
    path = artefacts.scores(tmp_path, MATCH, SEEDS)
    entries = [json.loads(line) for line in path.read_text().splitlines()]
    change(entries[2])
    path.write_text("".join(json.dumps(e) + "\n" for e in entries))
    assert set(kept(tmp_path)) == set(SEEDS) - {1002}


@pytest.mark.parametrize("end", [1, 20])
def test_a_last_line_that_was_cut_counts_as_absent(tmp_path: Path, end: int) -> None:
    path = artefacts.scores(tmp_path, MATCH, SEEDS)
    content = path.read_bytes()
    path.write_bytes(content[:-end])
    assert set(kept(tmp_path)) == set(SEEDS) if end == 1 else set(SEEDS) - {1005}
    keep_scores(
        tmp_path, MATCH, "pybullet", {1007: dict.fromkeys(json.loads(content.splitlines()[0])["score"], 1.0)}
    )
    assert 1007 in kept_scores(tmp_path, MATCH, "pybullet", range(1000, 1010))


@pytest.mark.parametrize("sealed", [False, True])
@pytest.mark.parametrize("first", [False, True])
def test_two_scores_of_one_episode_are_a_conflict(tmp_path: Path, sealed: bool, first: bool) -> None:
    path = artefacts.scores(tmp_path, MATCH, SEEDS)
    lines = path.read_text().splitlines()
    entry = json.loads(lines[2])
    entry["score"]["return"] += 1.0
    if sealed:
        entry["seal"] = seal_of([entry["digest"], entry["seed"], entry["score"]])
    path.write_text("\n".join([json.dumps(entry), *lines] if first else [*lines, json.dumps(entry)]) + "\n")
    before = path.read_bytes()
    with pytest.raises(DataError, match="two different scores of the episode with seed 1002"):
        kept(tmp_path)
    assert path.read_bytes() == before


def test_form_of_lines_changes_nothing(tmp_path: Path) -> None:
    path = artefacts.scores(tmp_path, MATCH, SEEDS)
    before = kept(tmp_path)
    entries = [dict(reversed(json.loads(line).items())) for line in path.read_text().splitlines()]
    again = [*reversed(entries), entries[0]]  # the same line twice says nothing new
    path.write_bytes(b"".join(json.dumps(e, separators=(" ,", ":  ")).encode() + b"\r\n" for e in again))
    assert kept(tmp_path) == before


# --- markers ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "text", ["", "x", "[]", "null", "{}", '{"format": "camnet folder", "version": 1}', "[" * 9999, "NaN"]
)
def test_other_things_under_the_markers_name_are_no_marker(tmp_path: Path, text: str) -> None:
    (tmp_path / MARKER).write_text(text)
    assert read_marker(tmp_path) is None
    write_marker(tmp_path, "simulate", ["a"])
    assert read_marker(tmp_path) is not None
