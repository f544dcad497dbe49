"""Agents x worlds x seeds: played in parallel, kept as they come, compared on common seeds.

Every finished episode is a line of ``episodes/<world>-<agent>.jsonl`` in the output folder, under a digest of all
that decides it (program version, world, agent or policy file, length, options): a stopped evaluation goes on where
it was, and more episodes or agents add to those there.
"""

from __future__ import annotations

import hashlib
import json
import multiprocessing
import re
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from camnet import __version__
from camnet.agents import estimator_of
from camnet.evaluation.play import Match, play
from camnet.evaluation.play_batch import play_together
from camnet.evaluation.scores import METRICS, Score
from camnet.evaluation.statistics import compare, interval
from camnet.types import Array

__all__ = ["Plan", "evaluate", "returns_of"]

#: seeds that one task of a worker plays: long enough to be worth a start, short enough to be kept often
_CHUNK = 5


@dataclass(frozen=True, slots=True)
class Plan:
    """What to play.

    Attributes
    ----------
    matches : every agent on every world, agents of one world together
    seeds : common to all of them
    reference : the agent that the others are compared with
    back_end : ``pybullet`` or ``batch``
    jobs : processes
    seed : of the bootstrap
    """

    matches: tuple[Match, ...]
    seeds: tuple[int, ...]
    reference: str
    back_end: str = "pybullet"
    jobs: int = 2
    seed: int = 0


def evaluate(plan: Plan, folder: Path, progress: Callable[[float], None] | None = None) -> dict[str, Any]:
    """Play what is missing, and put the tables together.

    Returns
    -------
    dict
        ``{"episodes", "reference", "worlds": [{"world", "episodes", "agents", "comparisons"}]}``; for one world its
        entry's fields stand at the top as well.
    """
    scores = _scores(plan, folder, progress)
    worlds = list(dict.fromkeys(match.world for match in plan.matches))
    tables = [_table(plan, world, scores) for world in worlds]
    content: dict[str, Any] = {
        "episodes": len(plan.seeds),
        "back_end": plan.back_end,
        "reference": plan.reference,
        "worlds": tables,
        "version": __version__,
    }
    return {**tables[0], **content} if len(tables) == 1 else content


def returns_of(plan: Plan, folder: Path, match: Match) -> Array:
    """Return of every episode that an evaluation has played and kept, in the order of its seeds."""
    kept = _kept(folder, plan, match)
    return np.array([kept[seed]["return"] for seed in plan.seeds])


def _scores(
    plan: Plan, folder: Path, progress: Callable[[float], None] | None
) -> dict[Match, dict[int, Score]]:
    """Scores of all episodes, playing those that the folder does not hold."""
    kept = {match: _kept(folder, plan, match) for match in plan.matches}
    missing = {m: [s for s in plan.seeds if s not in kept[m]] for m in plan.matches}
    tasks = [
        (m, seeds[k : k + _chunk(plan)])
        for m, seeds in missing.items()
        for k in range(0, len(seeds), _chunk(plan))
    ]
    total = len(plan.matches) * len(plan.seeds)
    finished = total - sum(len(seeds) for _, seeds in tasks)
    for match, seeds, found in _played(plan, tasks):
        for seed, score in zip(seeds, found, strict=True):
            kept[match][seed] = score
        _keep(folder, plan, match, dict(zip(seeds, found, strict=True)))
        finished += len(seeds)
        if progress is not None:
            progress(finished / total)
    return kept


def _chunk(plan: Plan) -> int:
    return _CHUNK if plan.back_end == "pybullet" else -(-len(plan.seeds) // plan.jobs)


def _played(plan: Plan, tasks: Sequence[tuple[Match, list[int]]]) -> Any:  # noqa: ANN401 - a generator of tuples
    """Yield finished tasks, in any order; results do not depend on it, every episode has a seed of its own."""
    if plan.jobs == 1 or len(tasks) <= 1:
        for match, seeds in tasks:
            yield match, seeds, _play(plan.back_end, match, seeds)
        return
    _compile(plan.back_end, tasks)
    with ProcessPoolExecutor(plan.jobs, mp_context=multiprocessing.get_context("spawn")) as pool:
        futures: dict[Future[list[Score]], tuple[Match, list[int]]] = {
            pool.submit(_play, plan.back_end, match, seeds): (match, seeds) for match, seeds in tasks
        }
        for future in as_completed(futures):
            match, seeds = futures[future]
            yield match, seeds, future.result()


def _compile(back_end: str, tasks: Sequence[tuple[Match, list[int]]]) -> None:
    """Play a moment with every world and estimator, so that workers find all compiled: Numba's cache has no lock."""
    kinds = {(m.world, estimator_of(m.agent)): (m, seeds[:1]) for m, seeds in tasks}
    for match, seeds in kinds.values():
        _play(back_end, replace(match, max_cycles=5), seeds)


def _play(back_end: str, match: Match, seeds: Sequence[int]) -> list[Score]:
    return list(play(match, seeds)) if back_end == "pybullet" else play_together(match, seeds)


# --- what is kept ------------------------------------------------------------------------------------------


def _digest(plan: Plan, match: Match) -> str:
    agent: object = match.agent
    if match.agent.endswith(".npz"):
        agent = hashlib.sha256(Path(match.agent).read_bytes()).hexdigest()
    world: object = match.world
    if Path(match.world).is_file():
        world = hashlib.sha256(Path(match.world).read_bytes()).hexdigest()
    what = [
        __version__,
        plan.back_end,
        agent,
        world,
        match.max_cycles,
        match.cutoff_m,
        match.overrides,
        match.options,
    ]
    return hashlib.sha256(json.dumps(what, default=str).encode()).hexdigest()[:16]


def _path(folder: Path, match: Match) -> Path:
    name = re.sub(r"[^A-Za-z0-9_.-]+", "_", f"{match.world}-{match.agent}").strip("._")
    return folder / "episodes" / f"{name}.jsonl"


def _kept(folder: Path, plan: Plan, match: Match) -> dict[int, Score]:
    """Episodes that are there already; a line that a stopped run left half-written is passed over."""
    path, digest, found = _path(folder, match), _digest(plan, match), {}
    if not path.is_file():
        return {}
    for line in path.read_text(encoding="utf-8").splitlines():
        try:
            entry = json.loads(line)
            if entry["digest"] == digest:
                found[int(entry["seed"])] = {
                    k: float("nan") if v is None else v for k, v in entry["score"].items()
                }
        except (json.JSONDecodeError, KeyError, TypeError, ValueError):
            continue
    return {seed: score for seed, score in found.items() if seed in plan.seeds}


def _keep(folder: Path, plan: Plan, match: Match, scores: dict[int, Score]) -> None:
    path, digest = _path(folder, match), _digest(plan, match)
    path.parent.mkdir(parents=True, exist_ok=True)
    torn = path.is_file() and not path.read_bytes().endswith(b"\n")  # a stopped run's half line
    with path.open("a", encoding="utf-8") as file:
        file.write("\n" if torn else "")
        for seed, score in scores.items():
            plain = {k: v if np.isfinite(v) else None for k, v in score.items()}
            file.write(json.dumps({"digest": digest, "seed": seed, "score": plain}, allow_nan=False) + "\n")


# --- tables ------------------------------------------------------------------------------------------


def _table(plan: Plan, world: str, scores: dict[Match, dict[int, Score]]) -> dict[str, Any]:
    """Figures of all agents on one world, and each beside the reference."""
    matches = {m.agent: m for m in plan.matches if m.world == world}
    rng = np.random.default_rng(plan.seed)
    columns = {
        agent: {name: _column(plan, scores[match], name) for name in METRICS}
        for agent, match in matches.items()
    }
    agents = {
        agent: {name: interval(values, rng) for name, values in row.items()} for agent, row in columns.items()
    }
    ours = columns.get(plan.reference)
    comparisons = {
        agent: {
            name: compare(ours[name], row[name], rng)
            for name in ("return", "time_in_view", "position_rmse_unseen_m")
        }
        for agent, row in columns.items()
        if ours is not None and agent != plan.reference
    }
    return {"world": world, "episodes": len(plan.seeds), "agents": agents, "comparisons": comparisons}


def _column(plan: Plan, scores: dict[int, Score], name: str) -> Array:
    return np.array([scores[seed][name] for seed in plan.seeds], dtype=float)
