"""Checks for handoff environments beyond PettingZoo's own, for people who write worlds or wrappers.

>>> from camnet.env import conformance, handoff_v0
>>> conformance.check_all(lambda: handoff_v0.parallel_env(world="quickstart", max_cycles=50))

PettingZoo's `parallel_seed_test` stops after one step and its `parallel_api_test` accepts observations outside their
space; these do not.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from typing import Any

import numpy as np
from pettingzoo import ParallelEnv
from pettingzoo.test import parallel_api_test

__all__ = ["ConformanceError", "check_all", "check_containment", "check_repeatable", "episode_digest"]

MakeEnv = Callable[[], ParallelEnv[str, Any, Any]]


class ConformanceError(AssertionError):
    """The environment breaks a rule; the message says which, where and with what value."""


def check_all(make_env: MakeEnv, episodes: int = 2, seed: int = 0) -> None:
    """Run PettingZoo's parallel API test and every check of this module."""
    env = make_env()
    parallel_api_test(env, num_cycles=20)
    env.close()
    check_containment(make_env, episodes, seed)
    check_repeatable(make_env, seed)


def check_containment(make_env: MakeEnv, episodes: int = 2, seed: int = 0) -> None:
    """Play whole random episodes: spaces, types, finiteness, keys and cached spaces are right at every step.

    Raises
    ------
    ConformanceError
        At the first violation.
    """
    env = make_env()
    for episode in range(episodes):
        observations, infos = env.reset(seed=seed + episode)
        rng = np.random.default_rng(seed + episode)
        _same_keys("observations of reset", observations, env.agents)
        _same_keys("infos of reset", infos, env.agents)
        _check_observations(env, observations, step=0)
        step = 0
        while env.agents:
            step += 1
            before = list(env.agents)
            results = env.step({name: _sample(env, name, rng) for name in env.agents})
            for what, content in zip(
                ("observations", "rewards", "terminations", "truncations", "infos"), results, strict=True
            ):
                _same_keys(f"{what} of step {step}", content, before)
            _check_observations(env, results[0], step)
            _check_outcome(env, results, step)
    env.close()


def check_repeatable(make_env: MakeEnv, seed: int = 0) -> None:
    """One seed gives one episode, whole, in two instances and again in one that has been used before.

    Raises
    ------
    ConformanceError
        If any number differs anywhere.
    """
    first, second = make_env(), make_env()
    digests = [episode_digest(first, seed), episode_digest(second, seed), episode_digest(second, seed)]
    other = episode_digest(first, seed + 1)
    first.close()
    second.close()
    if len(set(digests)) != 1:
        raise ConformanceError(f"seed {seed}: episodes differ between instances or after a reset: {digests}")
    if other == digests[0]:
        raise ConformanceError(f"seeds {seed} and {seed + 1} give the same episode: the seed is not used")


def episode_digest(env: ParallelEnv[str, Any, Any], seed: int, actions_seed: int = 0) -> str:
    """Digest of everything that one whole episode under random actions returns, bit for bit."""
    digest = hashlib.sha256()
    observations, _ = env.reset(seed=seed)
    rng = np.random.default_rng(actions_seed)
    while env.agents:
        for name in sorted(observations):
            digest.update(np.ascontiguousarray(observations[name]).tobytes())
        observations, rewards, *ends, _ = env.step({name: _sample(env, name, rng) for name in env.agents})
        digest.update(repr((sorted(rewards.items()), [sorted(end.items()) for end in ends])).encode())
        digest.update(np.ascontiguousarray(env.state()).tobytes())
    return digest.hexdigest()


def _sample(env: ParallelEnv[str, Any, Any], name: str, rng: np.random.Generator) -> Any:  # noqa: ANN401
    space: Any = env.action_space(name)
    if hasattr(space, "low"):
        return rng.uniform(space.low, space.high).astype(space.dtype)
    return int(rng.integers(space.n))


def _same_keys(what: str, content: dict[str, Any], agents: list[str]) -> None:
    if set(content) != set(agents):
        raise ConformanceError(f"{what}: given for {sorted(content)}, live agents are {sorted(agents)}")


def _check_observations(env: ParallelEnv[str, Any, Any], observations: dict[str, Any], step: int) -> None:
    for name, observation in observations.items():
        space = env.observation_space(name)
        if env.observation_space(name) is not space or env.action_space(name) is not env.action_space(name):
            raise ConformanceError(f"spaces of {name} are made anew on every call; they must be cached")
        if not space.contains(observation):
            raise ConformanceError(f"step {step}: observation of {name} is not in {space}: {observation!r}")


def _check_outcome(env: ParallelEnv[str, Any, Any], results: tuple[dict[str, Any], ...], step: int) -> None:
    _, rewards, terminations, truncations, _ = results
    for name, reward in rewards.items():
        if not np.isfinite(reward):
            raise ConformanceError(f"step {step}: reward of {name} is {reward}")
        ended = terminations[name] or truncations[name]
        if ended == (name in env.agents):
            raise ConformanceError(
                f"step {step}: {name} ended is {ended}, yet among the live agents is {not ended}"
            )
    state = env.state()
    if not env.state_space.contains(state):
        raise ConformanceError(f"step {step}: the state is not in its space: {state!r}")
