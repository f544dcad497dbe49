"""Play many episodes of one agent on one world at once with the batch back end, and score them."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from camnet.agents import estimator_of, network_contexts
from camnet.agents.together import build_together
from camnet.batch.state import ESTIMATE
from camnet.env.batch_handoff import BatchHandoff, BatchStep, batch_filter
from camnet.errors import ConfigError
from camnet.evaluation.play import Match
from camnet.evaluation.score_rows import RecorderRows
from camnet.evaluation.scores import Score

__all__ = ["can_play_together", "play_together"]


def can_play_together(match: Match) -> bool:
    """Whether the batch back end has everything that a match asks for."""
    try:
        env = _open(match, 1, 1, light=True)
        env.close()
        batch_filter(estimator_of(match.agent), env.network)
    except ConfigError:
        return False
    return True


def play_together(
    match: Match, seeds: Sequence[int], threads: int = 1, progress: Callable[[float], None] | None = None
) -> list[Score]:
    """Play one episode for every seed, side by side; the scores are those of each alone.

    Parameters
    ----------
    threads : for the physics; the agents' rules run in this thread
    progress : called with the share of the episodes' length that is over
    """
    env = _open(match, len(seeds), threads)
    try:
        return _play(match, env, seeds, progress)
    finally:
        env.close()


def _open(match: Match, environments: int, threads: int, light: bool = False) -> BatchHandoff:
    """Open the environments; ``light`` ones, with a simple estimator, tell whether the world can be had at all."""
    return BatchHandoff(
        match.world,
        environments=environments,
        overrides=match.overrides,
        filter_name="ekf" if light else estimator_of(match.agent),
        threads=threads,
        auto_reset=False,
        max_cycles=match.max_cycles,
        **match.env_options,
    )


def _play(
    match: Match, env: BatchHandoff, seeds: Sequence[int], progress: Callable[[float], None] | None
) -> list[Score]:
    observations = env.reset(seeds)
    known = network_contexts(env.network, env.layout, env.settings.gaze_max_rad)
    team = build_together(match.agent, known, seeds)
    recorder = RecorderRows(len(seeds), env.network.n_targets, match.cutoff_m)
    scores: dict[int, Score] = {}
    live = np.arange(len(seeds))
    for cycle in range(match.max_cycles):
        step = env.step(team(observations, env.alive))
        _take_down(recorder, env, step, live)
        ended = [e for e in step.finished if e not in scores]
        scores |= {e: recorder.score(e, step.finished[e]) for e in ended}
        if len(scores) == len(seeds):
            break
        if ended:
            live = np.array([e for e in live.tolist() if e not in scores])
        observations = step.last
        if step.finished:  # others go on: the ended ones idle in an episode that nobody scores
            again = list(step.finished)
            observations = env.reset([seeds[e] for e in again], environments=again)
        if progress is not None:
            progress((cycle + 1) / match.max_cycles)
    return [scores[e] for e in range(len(seeds))]


def _take_down(recorder: RecorderRows, env: BatchHandoff, step: BatchStep, live: np.ndarray) -> None:
    estimate = env.simulation.gather("estimate")[live]
    recorder.add(
        live,
        step.rewards[live],
        env.simulation.gather("target")[live, :, 0:3],
        estimate[:, :, ESTIMATE["p"]],
        np.isfinite(estimate[:, :, ESTIMATE["last_seen"]]),
        env.simulation.gather("visible")[live].any(axis=1),
    )
