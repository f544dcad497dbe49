"""The table of events against the log's rows, which are written elsewhere; units and meanings in both files."""

from __future__ import annotations

import importlib.util
import json
import re
import shutil
from pathlib import Path

import artefacts
import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from camnet.errors import DataError
from camnet.simulation.events import KINDS
from camnet.simulation.run_files import read_run

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return artefacts.run_folder(tmp_path_factory.mktemp("runs") / "seed-3", 14.0)


def test_sightings_and_losses_are_where_the_log_changes(run: Path) -> None:
    log, events = pd.read_parquet(run / "log.parquet"), pd.read_parquet(run / "events.parquet")
    times, seen = log["t_s"].to_numpy(), log["robot.seen_by"].to_numpy() >= 0
    changes = np.flatnonzero(np.diff(seen.astype(int)))
    kinds = [("sighting" if seen[k + 1] else "loss") for k in changes]
    assert kinds
    own = events[
        events["event"].isin(["sighting", "loss"]) & (events["t_s"] > 0) & (events["t_s"] <= times[-1])
    ]
    assert own["event"].tolist() == kinds
    for k, t_s in zip(changes, own["t_s"], strict=True):
        assert times[k] < t_s <= times[k + 1] + 1e-9
    # each lasts as long as it is from the event before
    assert own["duration_s"].to_numpy()[1:] == pytest.approx(np.diff(own["t_s"]))


def test_handoffs_and_collisions_are_those_of_the_run(run: Path) -> None:
    files = read_run(run)
    assert files.events is not None
    handoffs = [e for e in files.events if e["event"] == "handoff"]
    assert [e["completed"] for e in handoffs] == [h["completed"] for h in files.handoffs]
    assert [(e["from"], e["with"]) for e in handoffs] == [(h["from"], h["to"]) for h in files.handoffs]
    assert handoffs
    assert sum(e["event"] == "collision" for e in files.events) == files.content["summary"]["collisions"]
    assert {e["event"] for e in files.events} <= set(KINDS)
    assert [e["t_s"] for e in files.events] == sorted(e["t_s"] for e in files.events)


@pytest.mark.parametrize("name", ["log", "events"])
def test_every_column_has_unit_and_meaning_in_the_file(run: Path, name: str) -> None:
    schema = pq.read_schema(run / f"{name}.parquet")
    described = json.loads(schema.metadata[b"camnet.columns"])
    assert list(described) == schema.names
    for field in schema:
        unit, words = field.metadata[b"unit"].decode(), field.metadata[b"description"].decode()
        assert described[field.name] == {"unit": unit, "description": words}
        assert len(words) > 8
        ending = re.search(r"_(mps|s|m)$", field.name)
        assert unit == ({"mps": "m/s"}.get(ending[1], ending[1]) if ending else "1"), field.name


def test_a_run_without_a_table_of_events_is_read(run: Path, tmp_path: Path) -> None:
    old = Path(shutil.copytree(run, tmp_path / "old"))
    (old / "events.parquet").unlink()
    with pytest.raises(DataError, match=r"events\.parquet: cannot be read"):
        read_run(old)
    content = json.loads((old / "summary.json").read_text())
    del content["seals"]["events"]
    (old / "summary.json").write_text(json.dumps(content))
    assert read_run(old).events is None


def test_a_changed_event_is_refused(run: Path, tmp_path: Path) -> None:
    changed = Path(shutil.copytree(run, tmp_path / "changed"))
    table = pq.read_table(changed / "events.parquet")
    rows = table.to_pylist()
    for value, words in ((rows[0]["t_s"] + 0.1, "seal"), (float("nan"), "finite")):
        rows[0]["t_s"] = value
        pq.write_table(pa.Table.from_pylist(rows, schema=table.schema), changed / "events.parquet")
        with pytest.raises(DataError, match=rf"events\.parquet.*{words}"):
            read_run(changed)
    pq.write_table(table.drop_columns(["from"]), changed / "events.parquet")
    with pytest.raises(DataError, match=r"events\.parquet: its columns"):
        read_run(changed)


def test_the_dictionary_in_the_docs_is_that_of_the_program() -> None:
    spec = importlib.util.spec_from_file_location("log_dictionary", ROOT / "scripts/log_dictionary.py")
    assert spec is not None
    assert spec.loader is not None
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    assert (ROOT / "docs/log.md").read_text() == script.page(), "run scripts/log_dictionary.py"
