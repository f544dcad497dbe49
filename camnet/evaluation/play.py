"""Play episodes of one agent on one world with the PyBullet back end, and score them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from camnet.agents import estimator_of, make_team
from camnet.env import handoff_v0
from camnet.env.infos import EPISODE
from camnet.evaluation.scores import EpisodeRecorder, Instant, Score

__all__ = ["Match", "play", "play_one"]


@dataclass(frozen=True, slots=True)
class Match:
    """One agent on one world.

    Attributes
    ----------
    agent : name of an agent, or of a policy file
    world : what `camnet.env.handoff_v0.parallel_env` takes as its world
    max_cycles : length of an episode, decisions
    cutoff_m : cutoff of OSPA and GOSPA, m
    overrides : settings to change, as ``key=value``
    options : further options of the environment
    """

    agent: str
    world: str
    max_cycles: int
    cutoff_m: float = 2.0
    overrides: tuple[str, ...] = ()
    options: tuple[tuple[str, Any], ...] = ()

    def environment(self, render_mode: str | None = None) -> handoff_v0.HandoffEnv:
        """Open the environment with the estimator that the agent relies on."""
        return handoff_v0.parallel_env(
            world=self.world,
            overrides=self.overrides,
            filter_name=estimator_of(self.agent),
            max_cycles=self.max_cycles,
            render_mode=render_mode,
            **self.env_options,
        )

    @property
    def env_options(self) -> dict[str, Any]:
        """Options of the environment; a blind team's cameras are off."""
        return {**dict(self.options), **({"cameras": "off"} if self.agent == "blind" else {})}


def play(match: Match, seeds: Sequence[int], done: Callable[[int], None] | None = None) -> Iterator[Score]:
    """Play one episode for every seed and yield its score."""
    env = match.environment()
    try:
        for k, seed in enumerate(seeds, start=1):
            yield play_one(match, env, seed)
            if done is not None:
                done(k)
    finally:
        env.close()


def play_one(
    match: Match,
    env: handoff_v0.HandoffEnv,
    seed: int,
    frame: Callable[[handoff_v0.HandoffEnv], None] | None = None,
) -> Score:
    """Play one episode in an open environment; ``frame`` is called after every decision."""
    observations, infos = env.reset(seed=seed)
    team = make_team(match.agent, env, seed)
    recorder = EpisodeRecorder(match.cutoff_m)
    while env.agents:
        alive = {name: np.asarray(observations[name]) for name in env.agents}
        observations, rewards, _, _, infos = env.step(team(alive))
        recorder.add(next(iter(rewards.values())), _instant(env))
        if frame is not None:
            frame(env)
    return recorder.score(next(iter(infos.values()))[EPISODE])


def _instant(env: handoff_v0.HandoffEnv) -> Instant:
    simulation = env.simulation
    estimates = [f.estimate for f in simulation.driving]
    return Instant(
        truth=simulation.snapshot.target_p_world,
        estimates=np.array([e.p_world for e in estimates]),
        known=np.array([np.isfinite(e.last_seen_s) for e in estimates]),
        seen=np.asarray(simulation.visible.any(axis=0)),
    )
