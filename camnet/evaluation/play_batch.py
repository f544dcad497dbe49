"""Play many episodes of one agent on one world at once with the batch back end, and score them."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from camnet.agents import build_team, estimator_of, network_contexts
from camnet.batch.state import ESTIMATE
from camnet.env.batch_handoff import BatchHandoff
from camnet.evaluation.play import Match
from camnet.evaluation.scores import EpisodeRecorder, Instant, Score

__all__ = ["play_together"]


def play_together(
    match: Match, seeds: Sequence[int], threads: int = 1, progress: Callable[[float], None] | None = None
) -> list[Score]:
    """Play one episode for every seed, side by side; the scores are those of each alone.

    Parameters
    ----------
    threads : for the physics; the agents' rules run in this thread
    progress : called with the share of the episodes' length that is over
    """
    env = BatchHandoff(
        match.world,
        environments=len(seeds),
        overrides=match.overrides,
        filter_name=estimator_of(match.agent),
        threads=threads,
        auto_reset=False,
        max_cycles=match.max_cycles,
        **dict(match.options),
    )
    try:
        return _play(match, env, seeds, progress)
    finally:
        env.close()


def _play(
    match: Match, env: BatchHandoff, seeds: Sequence[int], progress: Callable[[float], None] | None
) -> list[Score]:
    observations = env.reset(seeds)
    known = network_contexts(env.network, env.layout, env.settings.gaze_max_rad)
    teams = [build_team(match.agent, known, seed) for seed in seeds]
    recorders = [EpisodeRecorder(match.cutoff_m) for _ in seeds]
    scores: list[Score | None] = [None] * len(seeds)
    names, actions = list(known), np.zeros((len(seeds), len(known), 5), dtype=np.float32)
    for cycle in range(match.max_cycles):
        live = [e for e, score in enumerate(scores) if score is None]
        for e in live:
            chosen = teams[e](dict(zip(names, observations[e], strict=True)))
            actions[e] = [chosen[name] for name in names]
        step = env.step(actions)
        instants = _instants(env)
        for e in live:
            recorders[e].add(float(step.rewards[e]), instants[e])
        for e, figures in step.finished.items():
            if scores[e] is None:
                scores[e] = recorders[e].score(figures)
        if all(score is not None for score in scores):
            break
        ended = [e for e, score in enumerate(scores) if score is not None]
        if ended:  # others go on: the ended ones idle in an episode that nobody scores
            env.reset([seeds[e] for e in step.finished], environments=list(step.finished))
        observations = env.simulation.observations
        if progress is not None:
            progress((cycle + 1) / match.max_cycles)
    return [score for score in scores if score is not None]


def _instants(env: BatchHandoff) -> list[Instant]:
    truth = env.simulation.gather("target")[:, :, 0:3]
    estimate = env.simulation.gather("estimate")
    seen = np.asarray(env.simulation.gather("visible").any(axis=1))
    known = np.asarray(np.isfinite(estimate[:, :, ESTIMATE["last_seen"]]))
    positions = estimate[:, :, ESTIMATE["p"]]
    return [Instant(truth[e], positions[e], known[e], seen[e]) for e in range(len(truth))]
