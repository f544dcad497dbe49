"""What earlier runs left behind: folders for ``report``, and episodes to go on from."""

from __future__ import annotations

import copy
import io
import json
from collections.abc import Callable
from random import Random
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from robustness.case import Answer, Case, Nature
from robustness.stage import COMMANDS, Stage
from robustness.text import broken_text

__all__ = ["generators"]

_EITHER = frozenset({Answer.REFUSED, Answer.UNCHANGED})


def generators(stage: Stage) -> list[tuple[str, Nature, Callable[[Random], Case]]]:
    """Return kind, nature and generator of every change of a run folder and of kept episodes."""
    run = {name: content for name, content in stage.files.items() if name.startswith("run/")}
    (episodes,) = (name for name in stage.files if name.startswith("kept/episodes/") and "blind" not in name)
    found: list[tuple[str, Nature, Callable[[Random], Case]]] = []
    for change in (_summary, _summary, _log, _log, _handoffs):
        found.append(("run folder", Nature.MEANING, _of_run(change, run, Nature.MEANING)))
    found += [("run folder", Nature.BROKEN, _of_run(_run_broken, run, Nature.BROKEN))]
    found += [("run folder", Nature.HARMLESS, _of_run(_run_rewritten, run, Nature.HARMLESS))] * 2
    for change in (_episode, _episode, _conflict):
        found.append(
            ("resume", Nature.MEANING, _of_episodes(change, episodes, stage.files[episodes], Nature.MEANING))
        )
    found += [("resume", Nature.BROKEN, _of_episodes(_torn, episodes, stage.files[episodes], Nature.BROKEN))]
    found += [
        (
            "resume",
            Nature.HARMLESS,
            _of_episodes(_reordered, episodes, stage.files[episodes], Nature.HARMLESS),
        )
    ] * 2
    return found


_Run = dict[str, bytes]
_RunChange = Callable[[Random, _Run], tuple[str, dict[str, bytes | None]]]


def _of_run(change: _RunChange, run: _Run, nature: Nature) -> Callable[[Random], Case]:
    def make(rng: Random) -> Case:
        label, files = change(rng, run)
        answer = Answer.UNCHANGED if nature is Nature.HARMLESS else Answer.REFUSED
        mentions = () if nature is Nature.HARMLESS else ("summary.json", "log.parquet", "handoffs.json")
        return Case(
            "run folder", label, nature, COMMANDS["report run"], files, (), frozenset({answer}), mentions
        )

    return make


def _json(value: Any) -> bytes:
    return (json.dumps(value, indent=2) + "\n").encode()


def _summary(rng: Random, run: _Run) -> tuple[str, dict[str, bytes | None]]:
    content = json.loads(run["run/summary.json"])
    summary, config = content["summary"], content["config"]
    way = rng.choice(
        (
            "figure lost",
            "figure of another type",
            "section lost",
            "settings",
            "figure beyond sense",
            "targets",
        )
    )
    if way == "figure lost":
        del summary[
            rng.choice(
                (
                    "time_in_view",
                    "handoffs",
                    "collisions",
                    "position_rmse_m",
                    "dwell",
                    "baselines",
                    "interrupted",
                )
            )
        ]
    elif way == "figure of another type":
        summary[rng.choice(("time_in_view", "collisions", "handoffs", "position_rmse_m"))] = rng.choice(
            ("<script>", [], None, {"a": 1}, True)
        )
    elif way == "section lost":
        del content[rng.choice(("summary", "config"))]
    elif way == "settings":
        config[rng.choice(("cameras", "agents", "targets", "regions"))] = rng.choice(([], None, "x", 3))
    elif way == "figure beyond sense":
        summary["time_in_view"] = rng.choice((-1.0, 5.0, 1e300))
    else:
        config["targets"][0]["name"] = "another"
    return f"summary: {way}", {"run/summary.json": _json(content)}


def _table(run: _Run) -> dict[str, np.ndarray]:
    table = pq.read_table(io.BytesIO(run["run/log.parquet"]))
    return {name: table[name].to_numpy().copy() for name in table.column_names}


def _parquet(columns: dict[str, Any], **how: Any) -> bytes:
    stream = io.BytesIO()
    pq.write_table(pa.table(columns), stream, **how)
    return stream.getvalue()


def _log(rng: Random, run: _Run) -> tuple[str, dict[str, bytes | None]]:
    columns: dict[str, Any] = _table(run)
    own = [
        c
        for c in columns
        if c.startswith(("robot.p_", "robot.q_", "camera_0.p_", "camera_1.cam_", "robot.learned.p_"))
    ]
    way = rng.choice(
        ("column lost", "not finite", "times go back", "texts", "no row", "column renamed", "rows exchanged")
    )
    name = rng.choice(own)
    if way == "column lost":
        del columns[rng.choice([name, "t_s", "robot.seen_by"])]
    elif way == "not finite":
        name = rng.choice([c for c in own if "learned" not in c] + ["t_s"])
        columns[name][rng.randrange(len(columns[name]))] = rng.choice((np.nan, np.inf))
    elif way == "times go back":
        k = rng.randrange(1, len(columns["t_s"]))
        columns["t_s"][k] = columns["t_s"][k - 1] - rng.choice((0.0, 0.5))
    elif way == "texts":
        columns[name] = [str(x) for x in columns[name]]
    elif way == "no row":
        columns = {key: value[:0] for key, value in columns.items()}
    elif way == "column renamed":
        columns = {key.replace("robot", "rover"): value for key, value in columns.items()}
    else:
        order = np.roll(np.arange(len(columns["t_s"])), 1)
        columns["t_s"] = columns["t_s"][order]
    return f"log: {way}", {"run/log.parquet": _parquet(columns)}


def _handoffs(rng: Random, run: _Run) -> tuple[str, dict[str, bytes | None]]:
    good = {"target": "robot", "from": "camera_0", "to": "camera_1", "lost_s": 0.2, "entered_s": 0.3, "seen_s": 0.4,
            "delay_s": 0.1, "completed": True}  # fmt: skip
    entry: dict[str, Any] = copy.deepcopy(good)
    key = rng.choice(sorted(good))
    way = rng.choice(("lost", "type", "unknown target", "no list"))
    if way == "lost":
        key = rng.choice(("target", "from", "to", "lost_s", "entered_s", "completed"))
        del entry[key]
    elif way == "type":
        entry[key] = rng.choice(([1], {"a": 1}, "<script>x</script>" if key.endswith("_s") else 3.5))
    elif way == "unknown target":
        entry[rng.choice(("target", "to"))] = "nobody"
    content: Any = {"handoffs": [entry]} if way == "no list" else [entry]
    return f"handoffs: {way}", {"run/handoffs.json": _json(content)}


def _run_broken(rng: Random, run: _Run) -> tuple[str, dict[str, bytes | None]]:
    name = rng.choice(("run/summary.json", "run/log.parquet", "run/handoffs.json"))
    content = run[name]
    at = rng.randrange(len(content) - 1)
    way = rng.choice(("lost", "cut", "noise", "empty", "deep", "not JSON numbers"))
    if way == "lost":
        return f"{name} lost", {name: None}
    if way == "deep":
        return "deep", {"run/summary.json": b'{"summary": ' + b"[" * 200_000}
    if way == "not JSON numbers":
        spoilt = run["run/summary.json"].replace(b'"time_in_view": 1.0', b'"time_in_view": NaN', 1)
        return way, {"run/summary.json": spoilt}
    ways = {"cut": content[:at], "noise": rng.randbytes(500), "empty": b""}
    return f"{name}: {way}", {name: ways[way]}


def _run_rewritten(rng: Random, run: _Run) -> tuple[str, dict[str, bytes | None]]:
    way = rng.choice(("JSON layout", "parquet layout", "order of columns", "other files"))
    if way == "JSON layout":
        content = json.loads(run["run/summary.json"])
        return way, {"run/summary.json": json.dumps(content, indent=rng.choice((None, 1, 7))).encode()}
    columns = _table(run)
    if way == "parquet layout":
        how = {
            "compression": rng.choice(("none", "snappy", "gzip", "zstd")),
            "row_group_size": rng.randrange(3, 50),
        }
        return way, {"run/log.parquet": _parquet(columns, **how)}
    if way == "order of columns":
        # estimators keep theirs: the first in the log is the one in charge
        first = [name for name in columns if name.startswith("camera_")]
        return way, {
            "run/log.parquet": _parquet(
                {k: columns[k] for k in [*first, *(c for c in columns if c not in first)]}
            )
        }
    return way, {"run/notes.txt": rng.randbytes(100)}


_EpisodeChange = Callable[[Random, list[dict[str, Any]]], tuple[str, bytes, frozenset[Answer]]]


def _of_episodes(
    change: _EpisodeChange, name: str, content: bytes, nature: Nature
) -> Callable[[Random], Case]:
    def make(rng: Random) -> Case:
        entries = [json.loads(line) for line in content.decode().splitlines()]
        label, data, answers = change(rng, entries)
        return Case("resume", label, nature, COMMANDS["evaluate again"], {name: data}, (), answers)

    return make


def _lines(entries: list[Any]) -> bytes:
    return "".join(json.dumps(entry) + "\n" for entry in entries).encode()


def _episode(rng: Random, entries: list[dict[str, Any]]) -> tuple[str, bytes, frozenset[Answer]]:
    """An entry that says what no episode can: it is refused, or the episode is played again."""
    entry = rng.choice(entries)
    score = entry["score"]
    key = rng.choice(sorted(score))
    way = rng.choice(
        ("figure lost", "another type", "beyond sense", "not finite", "seed", "digest", "unknown figure")
    )
    if way == "figure lost":
        del score[key]
    elif way == "another type":
        score[key] = rng.choice(("0.5", [1.0], {"a": 1}, True))
    elif way == "beyond sense":
        key = rng.choice(("time_in_view", "collisions", "ospa_m", "control_effort_m2ps", "region_exits"))
        score[key] = rng.choice((-1.0, -1e300))
    elif way == "not finite":
        score[key] = rng.choice((float("nan"), float("inf"), 1e400))
    elif way == "seed":
        entry["seed"] = rng.choice((-1, "1000", 1000.5, None, [1000], 10**30))
    elif way == "digest":
        entry["digest"] = rng.choice(("", "0" * 16, 7, None))
    else:
        score["figure_of_another_version"] = 1.0
    return f"episode: {way}", _lines(entries), _EITHER


def _conflict(rng: Random, entries: list[dict[str, Any]]) -> tuple[str, bytes, frozenset[Answer]]:
    """One seed with two scores: nobody can say which is right."""
    other = copy.deepcopy(rng.choice(entries))
    other["score"]["return"] += rng.choice((-1.0, 1.0)) * 10.0 ** rng.uniform(-6, 2)
    entries.insert(rng.randrange(len(entries) + 1), other)
    return "seed twice with other scores", _lines(entries), frozenset({Answer.REFUSED})


def _torn(rng: Random, entries: list[dict[str, Any]]) -> tuple[str, bytes, frozenset[Answer]]:
    data = _lines(entries)
    way = rng.choice(("cut", "noise", "text", "deep"))
    ways = {
        "cut": data[: rng.randrange(len(data))],
        "noise": data + b'{"digest": "\xff\xfe", ',
        "text": broken_text(rng, data.decode())[1],
        "deep": b"[" * 100_000 + b"\n" + data,
    }
    return f"episodes: {way}", ways[way], _EITHER


def _reordered(rng: Random, entries: list[dict[str, Any]]) -> tuple[str, bytes, frozenset[Answer]]:
    rng.shuffle(entries)
    for k, entry in enumerate(entries):
        keys = list(entry)
        rng.shuffle(keys)
        entries[k] = {key: entry[key] for key in keys}
    if rng.random() < 0.5:
        entries.append(copy.deepcopy(entries[0]))  # the same once more says nothing new
    if rng.random() < 0.5:
        entries.append({**copy.deepcopy(entries[0]), "digest": "f" * 16, "seed": rng.randrange(5000)})
    data = _lines(entries)
    if rng.random() < 0.3:
        data = data.replace(b"\n", b"\n\n")
    return "rewritten", data, frozenset({Answer.UNCHANGED})
