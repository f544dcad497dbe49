"""Scores that an evaluation keeps: a line of JSON for every finished episode, in a file for every match.

A line is ``{"digest", "seed", "score", "seal"}``: the digest of all that decides the episode, its seed, its figures
(null: it has none), and the seal of the three (`camnet.storage.seal`). A line that is damaged or half-written counts
as absent, is removed, and its episode is played again. Two scores of one episode are a conflict that nobody here can
settle, and an error. One process writes a folder at a time; its command holds the folder's lock.
"""

from __future__ import annotations

import hashlib
import json
import logging
import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from camnet import __version__
from camnet.errors import DataError
from camnet.evaluation.play import Match
from camnet.evaluation.scores import METRICS, Score
from camnet.storage.json_file import LIMIT_BYTES, parse_json
from camnet.storage.reading import read_bounded
from camnet.storage.seal import seal_of
from camnet.storage.whole_file import whole_file

__all__ = ["keep_scores", "kept_scores", "score_file"]

_LOG = logging.getLogger(__name__)
_FIELDS = {"digest", "seed", "score", "seal"}


def _digest(match: Match, back_end: str) -> str:
    agent: object = match.agent
    if match.agent.endswith(".npz"):
        agent = hashlib.sha256(Path(match.agent).read_bytes()).hexdigest()
    world: object = match.world
    if Path(match.world).is_file():
        world = hashlib.sha256(Path(match.world).read_bytes()).hexdigest()
    what = [
        __version__,
        back_end,
        agent,
        world,
        match.max_cycles,
        match.cutoff_m,
        match.overrides,
        match.options,
    ]
    return hashlib.sha256(json.dumps(what, default=str).encode()).hexdigest()[:16]


def score_file(folder: Path, match: Match) -> Path:
    """Where the scores of a match are kept."""
    name = re.sub(r"[^A-Za-z0-9_.-]+", "_", f"{match.world}-{match.agent}").strip("._")
    return folder / "episodes" / f"{name}.jsonl"


def kept_scores(folder: Path, match: Match, back_end: str, seeds: Sequence[int]) -> dict[int, Score]:
    """Return the scores of those of ``seeds`` that are there already; damaged lines are removed.

    Raises
    ------
    DataError
        The file cannot be read, or has two different scores of one episode.
    """
    path, digest = score_file(folder, match), _digest(match, back_end)
    if not path.exists():
        return {}
    lines = read_bounded(path, LIMIT_BYTES).splitlines()
    found: dict[tuple[str, int], tuple[int, Score]] = {}
    whole: list[bytes] = []
    sealed: set[tuple[str, int]] = set()
    for k, line in enumerate(lines, start=1):
        entry = _entry(line, f"{path}, line {k}")
        if entry is None:
            continue
        key, score = (entry["digest"], entry["seed"]), entry["score"]
        first, known = found.setdefault(key, (k, score))
        if known != score:
            raise DataError(
                f"{path}: lines {first} and {k} have two different scores of the episode with seed {entry['seed']}; "
                "remove the wrong one, or the file"
            )
        if entry["seal"] == seal_of([entry["digest"], entry["seed"], score]):
            whole.append(line)
            sealed.add(key)
    if len(whole) < len(lines):
        _LOG.warning(
            "%s: %d damaged lines are left out; their episodes are played again",
            path,
            len(lines) - len(whole),
        )
        with whole_file(path) as temporary:
            temporary.write_bytes(b"".join(line + b"\n" for line in whole))
    return {
        seed: {
            name: math.nan if value is None else float(value)
            for name, value in found[digest, seed][1].items()
        }
        for seed in seeds
        if (digest, seed) in sealed
    }


def _entry(line: bytes, where: str) -> dict[str, Any] | None:
    """Return a line that has the form of an entry; None for any other."""
    try:
        entry = parse_json(line, where)
    except DataError:
        return None
    if not isinstance(entry, dict) or set(entry) != _FIELDS or type(entry["seed"]) is not int:
        return None
    score = entry["score"]
    if not isinstance(score, dict) or set(score) != set(METRICS) or not isinstance(entry["digest"], str):
        return None
    if not all(value is None or type(value) in (int, float) for value in score.values()):
        return None
    return entry


def keep_scores(folder: Path, match: Match, back_end: str, scores: dict[int, Score]) -> None:
    """Add scores of finished episodes."""
    path, digest = score_file(folder, match), _digest(match, back_end)
    path.parent.mkdir(parents=True, exist_ok=True)
    lines = ["\n"] if _is_torn(path) else []
    for seed, score in scores.items():
        plain = {k: v if math.isfinite(v) else None for k, v in score.items()}
        entry = {"digest": digest, "seed": seed, "score": plain, "seal": seal_of([digest, seed, plain])}
        lines.append(json.dumps(entry, allow_nan=False) + "\n")
    with path.open("a", encoding="utf-8") as file:
        file.write("".join(lines))


def _is_torn(path: Path) -> bool:
    """Whether a file ends within a line."""
    if not path.is_file() or not path.stat().st_size:
        return False
    with path.open("rb") as file:
        file.seek(-1, 2)
        return file.read(1) != b"\n"
