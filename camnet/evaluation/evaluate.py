"""Agents x worlds x seeds: played in parallel, kept as they come, compared on common seeds.

Every finished episode is a line of ``episodes/<world>-<agent>.jsonl`` in the output folder, under a digest of all
that decides it (program version, world, agent or policy file, length, options): a stopped evaluation goes on where
it was, and more episodes or agents add to those there.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from camnet import __version__
from camnet.agents import estimator_of
from camnet.evaluation.kept import keep_scores, kept_scores
from camnet.evaluation.play import Match, play
from camnet.evaluation.play_batch import can_play_together, play_together
from camnet.evaluation.scores import METRICS, Score
from camnet.evaluation.statistics import compare, interval
from camnet.processes.place import LOCAL, Place
from camnet.types import Array

__all__ = ["Plan", "evaluate", "normalise", "returns_of"]

#: seeds that one task of a worker plays: long enough to be worth a start, short enough to be kept often
_CHUNK = {"pybullet": 5, "batch": 50}


@dataclass(frozen=True, slots=True)
class Plan:
    """What to play.

    Attributes
    ----------
    matches : every agent on every world, agents of one world together
    seeds : common to all of them
    reference : the agent that the others are compared with
    back_end : ``pybullet``, ``batch``, or ``auto``: the batch for every match that it can play, else PyBullet
    jobs : processes
    seed : of the bootstrap
    place : where episodes are played
    """

    matches: tuple[Match, ...]
    seeds: tuple[int, ...]
    reference: str
    back_end: str = "auto"
    jobs: int = 2
    seed: int = 0
    place: Place = LOCAL

    def settled(self) -> dict[Match, str]:
        """Return the back end of every match."""
        if self.back_end != "auto":
            return dict.fromkeys(self.matches, self.back_end)
        return {m: "batch" if can_play_together(m) else "pybullet" for m in self.matches}


def evaluate(plan: Plan, folder: Path, progress: Callable[[float], None] | None = None) -> dict[str, Any]:
    """Play what is missing, and put the tables together.

    Returns
    -------
    dict
        ``{"episodes", "reference", "worlds": [{"world", "episodes", "back_ends", "agents", "comparisons"}]}``; for one
        world its entry's fields stand at the top as well.
    """
    back_ends = plan.settled()
    scores = _scores(plan, back_ends, folder, progress)
    worlds = list(dict.fromkeys(match.world for match in plan.matches))
    tables = [_table(plan, world, scores, back_ends) for world in worlds]
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
    kept = kept_scores(folder, match, plan.settled()[match], plan.seeds)
    return np.array([kept[seed]["return"] for seed in plan.seeds])


def _scores(
    plan: Plan, back_ends: dict[Match, str], folder: Path, progress: Callable[[float], None] | None
) -> dict[Match, dict[int, Score]]:
    """Scores of all episodes, playing those that the folder does not hold."""
    kept = {match: kept_scores(folder, match, back_ends[match], plan.seeds) for match in plan.matches}
    tasks = []
    for match in plan.matches:
        missing, size = [s for s in plan.seeds if s not in kept[match]], _CHUNK[back_ends[match]]
        tasks += [
            _Task(match, back_ends[match], tuple(missing[k : k + size])) for k in range(0, len(missing), size)
        ]
    total = len(plan.matches) * len(plan.seeds)
    finished = total - sum(len(task.seeds) for task in tasks)
    if progress is not None:
        progress(finished / total)
    with closing(_played(plan, tasks)) as played:  # an error here ends the workers, too
        for task, found in played:
            fresh = dict(zip(task.seeds, found, strict=True))
            kept[task.match] |= fresh
            keep_scores(folder, task.match, task.back_end, fresh)
            finished += len(fresh)
            if progress is not None:
                progress(finished / total)
    return kept


@dataclass(frozen=True, slots=True)
class _Task:
    """Some episodes of a match, for one worker."""

    match: Match
    back_end: str
    seeds: tuple[int, ...]


def _played(plan: Plan, tasks: Sequence[_Task]) -> Generator[tuple[_Task, list[Score]], None, None]:
    """Yield finished tasks, in any order; results do not depend on it, every episode has a seed of its own."""
    if plan.place.shares_files and plan.jobs > 1 and len(tasks) > 1:
        _compile(tasks)
    with plan.place.workers(plan.jobs) as workers:
        for k, scores in workers.finished(_play, tasks):
            yield tasks[k], scores


def _compile(tasks: Sequence[_Task]) -> None:
    """Play a moment with every world and estimator, so that workers do not compile the same."""
    kinds = {(task.match.world, estimator_of(task.match.agent), task.back_end): task for task in tasks}
    for task in kinds.values():
        _play(_Task(replace(task.match, max_cycles=5), task.back_end, task.seeds[:1]))


def _play(task: _Task) -> list[Score]:
    if task.back_end == "batch":
        return play_together(task.match, task.seeds)
    return list(play(task.match, task.seeds))


# --- tables ------------------------------------------------------------------------------------------


def _table(
    plan: Plan, world: str, scores: dict[Match, dict[int, Score]], back_ends: dict[Match, str]
) -> dict[str, Any]:
    """Figures of all agents on one world, and each beside the reference."""
    matches = {m.agent: m for m in plan.matches if m.world == world}
    normalise(matches, scores, plan.seeds)
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
    return {
        "world": world,
        "episodes": len(plan.seeds),
        "back_ends": {agent: back_ends[match] for agent, match in matches.items()},
        "agents": agents,
        "comparisons": comparisons,
    }


def normalise(matches: dict[str, Match], scores: dict[Match, dict[int, Score]], seeds: Sequence[int]) -> None:
    """Put ``bound`` and ``normalised`` in place where a blind team played the same episodes.

    Targets do not mind the agents, so the blind team's episode tells what there was to see.
    """
    if "blind" not in matches:
        return
    blind = scores[matches["blind"]]
    for match in matches.values():
        for seed in seeds:
            least, most = blind[seed]["return"], blind[seed]["bound"]
            score = scores[match][seed]
            score["bound"] = most
            score["normalised"] = (score["return"] - least) / (most - least) if most > least else math.nan


def _column(plan: Plan, scores: dict[int, Score], name: str) -> Array:
    return np.array([scores[seed][name] for seed in plan.seeds], dtype=float)
