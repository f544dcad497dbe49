"""Whether a task has anything to observe: actions of one episode, replayed blindly in others, must not solve it.

The return of an episode is put on a scale from 0, every entry missed and nothing seen, to 1, everything seen at once
(`camnet.evaluation` has the same scale, with a blind team's own return for 0).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from pettingzoo import ParallelEnv

from camnet.env.conformance_batch import ConformanceError
from camnet.env.infos import EPISODE
from camnet.env.settings import RewardSettings

__all__ = ["check_replay", "replay_scores"]

MakeEnv = Callable[[], ParallelEnv[str, Any, Any]]
Team = Callable[[Mapping[str, Any]], dict[str, Any]]
#: replayed actions may reach this share of what the team itself reaches
_SHARE = 0.5


def _scaled(total: float, figures: Mapping[str, Any], weights: RewardSettings) -> float:
    """Return of an episode between 0 (all missed) and 1 (all seen)."""
    least = -weights.lost * figures["entries"]
    most = weights.in_view * figures["duration_s"] * figures["time_inside"]
    most += weights.reacquired * figures["entries"]
    return float((total - least) / max(most - least, 1e-9))


def _play(
    env: ParallelEnv[str, Any, Any], seed: int, act: Callable[[int, Mapping[str, Any]], dict[str, Any]]
) -> float:
    observations, _ = env.reset(seed=seed)
    total, cycle, infos = 0.0, 0, {}
    while env.agents:
        live = {name: observations[name] for name in env.agents}
        observations, rewards, _, _, infos = env.step(act(cycle, live))
        total, cycle = total + float(next(iter(rewards.values()))), cycle + 1
    settings = getattr(env.unwrapped, "settings", None)
    weights = settings.reward if settings is not None else RewardSettings()
    return _scaled(total, next(iter(infos.values()))[EPISODE], weights)


def _unrecorded(team: Team) -> Callable[[int, Mapping[str, Any]], dict[str, Any]]:
    return lambda cycle, seen: team(seen)


def replay_scores(
    make_env: MakeEnv,
    make_team: Callable[[ParallelEnv[str, Any, Any]], Team],
    seed: int = 0,
    others: Sequence[int] = (101, 102, 103, 104),
) -> tuple[float, float]:
    """Return the mean scores of a team on the seeds ``others``, and of its actions of ``seed`` replayed there.

    Parameters
    ----------
    make_env : makes the environment, with ``info_form="nested"``
    make_team : builds what acts, from the environment; called anew for every episode
    seed, others : the episode that is recorded, and those that are played

    Returns
    -------
    tuple
        own and replayed score, each 0 for a team that sees nothing and at most 1
    """
    env = make_env()
    try:
        taken: list[dict[str, Any]] = []

        def record(cycle: int, seen: Mapping[str, Any]) -> dict[str, Any]:
            taken.append(team(seen))
            return taken[-1]

        env.reset(seed=seed)
        team = make_team(env)
        _play(env, seed, record)
        replayed = [_play(env, other, lambda k, seen: taken[min(k, len(taken) - 1)]) for other in others]
        own = [_play(env, other, _unrecorded(make_team(env))) for other in others]
        return float(np.mean(own)), float(np.mean(replayed))
    finally:
        env.close()


def check_replay(
    make_env: MakeEnv,
    make_team: Callable[[ParallelEnv[str, Any, Any]], Team],
    seed: int = 0,
    others: Sequence[int] = (101, 102, 103, 104),
) -> None:
    """Raise ConformanceError where replayed actions reach half of what the team itself reaches."""
    own, replayed = replay_scores(make_env, make_team, seed, others)
    if own <= 0.0:
        raise ConformanceError(f"replay: the team itself scores {own:.3f}: give one that sees something")
    if replayed >= _SHARE * own:
        raise ConformanceError(
            f"replay: actions of seed {seed} replayed on others score {replayed:.3f}, the team itself {own:.3f}: "
            "episodes are too much alike; let starts, speeds or ways be drawn"
        )
