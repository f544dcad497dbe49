"""Checks for handoff environments beyond PettingZoo's own, for people who write worlds or wrappers.

>>> from camnet.env import conformance, handoff_v0
>>> conformance.check_all(lambda: handoff_v0.parallel_env(world="quickstart", max_cycles=50))

PettingZoo's `parallel_seed_test` stops after one step and its `parallel_api_test` accepts observations outside their
space; these do not. `camnet.env.strategies` makes random environments to run them on.

| check | what |
| --- | --- |
| `check_pettingzoo` | PettingZoo's API tests of the parallel form and of its AEC conversion, silent |
| `check_containment` | whole random episodes: spaces, types, finiteness, keys; agents that ended stay away |
| `check_repeatable` | a seed gives one episode, bit for bit, in two instances and after another episode |
| `check_copies`, `check_misuse`, `check_options`, `check_release` | how it is used: see `camnet.env.conformance_use` |
| `check_batch` | the same for the batch form: see `camnet.env.conformance_batch` |
"""

from __future__ import annotations

import contextlib
import hashlib
import io
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pettingzoo import ParallelEnv
from pettingzoo.test import api_test, parallel_api_test
from pettingzoo.utils.conversions import parallel_to_aec

from camnet.env.conformance_batch import ConformanceError, check_batch
from camnet.env.conformance_use import (
    check_copies,
    check_misuse,
    check_options,
    check_release,
    drawn_action,
)

__all__ = [
    "ConformanceError",
    "check_all",
    "check_batch",
    "check_containment",
    "check_copies",
    "check_misuse",
    "check_options",
    "check_pettingzoo",
    "check_release",
    "check_repeatable",
    "episode_digest",
]

MakeEnv = Callable[[], ParallelEnv[str, Any, Any]]


_RETURNED = ("observations", "rewards", "terminations", "truncations", "infos")


def check_all(make_env: MakeEnv, episodes: int = 2, seed: int = 0) -> None:
    """Run every check of this module."""
    check_pettingzoo(make_env)
    check_containment(make_env, episodes, seed)
    check_repeatable(make_env, seed)
    check_copies(make_env, seed)
    check_misuse(make_env, seed)
    check_options(make_env)
    check_release(make_env, seed)


def check_pettingzoo(make_env: MakeEnv, cycles: int = 20) -> None:
    """Run PettingZoo's API tests on the parallel form and on its conversion; nothing is printed."""
    with contextlib.redirect_stdout(io.StringIO()):
        env = make_env()
        parallel_api_test(env, num_cycles=cycles)
        env.close()
        converted = parallel_to_aec(make_env())
        api_test(converted, num_cycles=cycles)
        converted.close()


def check_containment(make_env: MakeEnv, episodes: int = 2, seed: int = 0) -> None:
    """Play whole random episodes: spaces, types, finiteness, keys and cached spaces are right at every step.

    Raises
    ------
    ConformanceError
        At the first violation.
    """
    env = make_env()
    for episode in range(episodes):
        _check_episode(env, seed + episode)
    env.close()


def _check_episode(env: ParallelEnv[str, Any, Any], seed: int) -> None:
    observations, infos = env.reset(seed=seed)
    if set(env.agents) != set(env.possible_agents):
        raise ConformanceError(f"after reset {env.agents} are live, of {env.possible_agents}")
    rng, step, gone = np.random.default_rng(seed), 0, set[str]()
    _same_keys("observations of reset", observations, env.agents)
    _same_keys("infos of reset", infos, env.agents)
    _check_observations(env, observations, step=0)
    while env.agents:
        step += 1
        before = list(env.agents)
        results = env.step({name: drawn_action(env, name, rng) for name in env.agents})
        for what, content in zip(_RETURNED, results, strict=True):
            _same_keys(f"{what} of step {step}", content, before)
        _check_observations(env, results[0], step)
        _check_outcome(env, results, step)
        if gone & set(env.agents):
            raise ConformanceError(f"step {step}: {sorted(gone & set(env.agents))} had ended and are back")
        gone |= set(before) - set(env.agents)
    if any(env.step({})):
        raise ConformanceError(
            "a step after the end returns something; five empty dictionaries were expected"
        )


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
    observations, infos = env.reset(seed=seed)
    rng = np.random.default_rng(actions_seed)
    while env.agents:
        for name in sorted(observations):
            for part in _parts(observations[name]):
                digest.update(np.ascontiguousarray(part).tobytes())
        observations, rewards, *ends, infos = env.step(
            {name: drawn_action(env, name, rng) for name in env.agents}
        )
        digest.update(repr((sorted(rewards.items()), [sorted(end.items()) for end in ends])).encode())
        digest.update(np.ascontiguousarray(env.state()).tobytes())
    digest.update(repr(sorted(infos.items())).encode())
    return digest.hexdigest()


def _parts(observation: Any) -> Iterator[NDArray[Any]]:  # noqa: ANN401 - whatever an environment returns
    """Arrays of an observation, of which a dictionary holds several."""
    if isinstance(observation, dict):
        for key in sorted(observation):
            yield from _parts(observation[key])
    else:
        yield np.asarray(observation)


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
        if any(part.dtype != np.float32 for part in _parts(observation)):  # a space accepts what can be cast
            raise ConformanceError(f"step {step}: observation of {name} holds numbers that are not float32")


def _check_outcome(env: ParallelEnv[str, Any, Any], results: tuple[dict[str, Any], ...], step: int) -> None:
    _, rewards, terminations, truncations, infos = results
    for name, reward in rewards.items():
        if not isinstance(reward, float) or not np.isfinite(reward):
            raise ConformanceError(
                f"step {step}: reward of {name} is {reward!r}; a finite float was expected"
            )
        for what, end in (("termination", terminations[name]), ("truncation", truncations[name])):
            if type(end) is not bool:
                raise ConformanceError(
                    f"step {step}: {what} of {name} is {end!r}; True or False was expected"
                )
        ended = terminations[name] or truncations[name]
        if ended == (name in env.agents):
            raise ConformanceError(
                f"step {step}: {name} ended is {ended}, yet among the live agents is {not ended}"
            )
        _check_mask(env, name, infos[name].get("action_mask"), step)
    state = env.state()
    if not env.state_space.contains(state):
        raise ConformanceError(f"step {step}: the state is not in its space: {state!r}")


def _check_mask(env: ParallelEnv[str, Any, Any], name: str, mask: Any, step: int) -> None:  # noqa: ANN401
    if mask is None:
        return
    space: Any = env.action_space(name)
    if mask.dtype != np.int8 or mask.shape != (space.n,) or not mask.any():
        raise ConformanceError(f"step {step}: action mask of {name} is {mask!r} for {space}")
