"""Checks for handoff environments in the batch form (`camnet.env.batch_handoff`), for people who write worlds.

>>> from camnet.env import conformance
>>> from camnet.env.batch_handoff import BatchHandoff
>>> conformance.check_batch(lambda e, threads: BatchHandoff("quickstart", e, threads=threads, max_cycles=20))

| what is checked | how |
| --- | --- |
| shapes, types, containment, finiteness | at every step of random episodes |
| rows of agents that have failed | zero, never back within the episode; the episode ends with the last one |
| ends of episodes | figures for those that ended, the length as set, then the first observation of the next seed |
| one seed is one episode | bit for bit, alone or beside others, on one thread or two, in new or used environments |
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from camnet.env.batch_handoff import BatchHandoff, BatchStep

__all__ = ["ConformanceError", "check_batch"]

#: makes so many environments on so many threads
MakeBatch = Callable[[int, int], BatchHandoff]
_BESIDE = 3


class ConformanceError(AssertionError):
    """The environment breaks a rule; the message says which, where and with what value."""


def check_batch(make_env: MakeBatch, cycles: int = 40, seed: int = 0) -> None:
    """Run every check of this module; ``cycles`` should be longer than an episode.

    Parameters
    ----------
    make_env : from a number of environments and of threads to environments that start episodes by themselves

    Raises
    ------
    ConformanceError
        At the first violation.
    """
    many, one = make_env(_BESIDE, 2), make_env(1, 1)
    try:
        together = _played(many, cycles, [seed, seed + 1, seed + 2], seed)
        again = _played(many, cycles, [seed, seed + 1, seed + 2], seed)
        _check_same("after other episodes", together, again, (0, 1, 2), (0, 1, 2))
        _played(one, 2, [seed + 9], seed)
        length = _first_end(together, 1)
        alone = _played(one, length, [seed + 1], seed)
        _check_same("alone and on one thread", together[: length + 1], alone, (1,), (0,))
        if all(np.array_equal(shown[0], shown[1]) for shown, *_ in together):
            raise ConformanceError(f"seeds {seed} and {seed + 1} give one episode: the seed is not used")
        _check_next(one, seed + 1, alone)
    finally:
        many.close()
        one.close()


def _actions(env: BatchHandoff, rng: np.random.Generator) -> NDArray[Any]:
    """Random actions, the same for all environments, so that neighbours make no difference."""
    space: Any = env.action_space
    if isinstance(space, spaces.Box):
        shape = (1, env.n_agents, *space.shape)
        drawn: NDArray[Any] = rng.uniform(space.low, space.high, shape).astype(space.dtype)
    else:
        drawn = rng.integers(space.n, size=(1, env.n_agents))
    return np.repeat(drawn, env.environments, axis=0)


def _played(env: BatchHandoff, cycles: int, seeds: list[int], seed: int) -> list[tuple[NDArray[Any], ...]]:
    """Play, check every step, and return what came: observations, rewards, ends, who works."""
    rng, shown = np.random.default_rng(seed), env.reset(seeds)
    nobody = np.zeros(env.environments)
    record: list[tuple[NDArray[Any], ...]] = [(shown, nobody, nobody > 0, nobody > 0, env.alive)]
    _check_shown(env, shown, 0)
    if not env.alive.all():
        raise ConformanceError("after reset some agents do not work")
    for k in range(1, cycles + 1):
        before = env.alive
        step = env.step(_actions(env, rng))
        _check_step(env, step, before, k)
        record.append((step.last, step.rewards, step.terminated, step.truncated, step.alive))
    return record


def _check_shown(env: BatchHandoff, shown: NDArray[Any], k: int) -> None:
    shape = (env.environments, env.n_agents, env.layout.size)
    if shown.shape != shape or shown.dtype != np.float32:
        raise ConformanceError(
            f"step {k}: observations {shown.shape} {shown.dtype}; float32 of shape {shape} expected"
        )
    inside = (shown >= env.layout.low) & (shown <= env.layout.high)
    if not inside.all():  # what is not finite is not inside
        e, j, column = (int(i) for i in np.argwhere(~inside)[0])
        name = next(n for n, where in env.layout.slices.items() if where.start <= column < where.stop)
        raise ConformanceError(
            f"step {k}: {name} of agent {j} in environment {e} is {shown[e, j, column]}, out of its bounds"
        )


def _check_step(env: BatchHandoff, step: BatchStep, before: NDArray[np.bool_], k: int) -> None:
    _check_shown(env, step.observations, k)
    _check_shown(env, step.last, k)
    if step.rewards.shape != (env.environments,) or not np.isfinite(step.rewards).all():
        raise ConformanceError(f"step {k}: rewards are {step.rewards!r}; one finite number each was expected")
    if (step.terminated & step.truncated).any():
        raise ConformanceError(f"step {k}: an episode is both terminated and truncated")
    over = step.terminated | step.truncated
    if set(step.finished) != set(np.flatnonzero(over).tolist()):
        raise ConformanceError(
            f"step {k}: figures for {sorted(step.finished)}, ended are {np.flatnonzero(over)}"
        )
    for e in step.finished:
        length = step.finished[e]["length"]
        if (
            step.truncated[e] != (length == env.max_cycles and not step.terminated[e])
            or length > env.max_cycles
        ):
            raise ConformanceError(
                f"step {k}: environment {e} ended after {length} of {env.max_cycles} decisions"
            )
    _check_dead(step, before, over, k)


def _check_dead(step: BatchStep, before: NDArray[np.bool_], over: NDArray[np.bool_], k: int) -> None:
    works = before & ~step.failed
    if (step.failed & ~before).any():
        raise ConformanceError(f"step {k}: an agent failed that had failed before")
    if not np.array_equal(step.alive[~over], works[~over]):
        raise ConformanceError(f"step {k}: who works is not who worked less who failed")
    if not step.terminated[~works.any(axis=1)].all():
        raise ConformanceError(f"step {k}: nobody works, yet the episode goes on")
    if step.last[~before].any():
        raise ConformanceError(f"step {k}: an agent that had failed is shown something")
    if not step.alive[over].all():
        raise ConformanceError(f"step {k}: an episode begins with agents that do not work")


def _first_end(record: list[tuple[NDArray[Any], ...]], e: int) -> int:
    """Count the steps until the first episode of environment ``e`` is over, or all."""
    for k, (_, _, terminated, truncated, _) in enumerate(record):
        if terminated[e] or truncated[e]:
            return k
    return len(record) - 1


_PARTS = ("observations", "rewards", "terminations", "truncations", "working agents")


def _check_same(
    what: str,
    first: list[tuple[NDArray[Any], ...]],
    second: list[tuple[NDArray[Any], ...]],
    rows: tuple[int, ...],
    others: tuple[int, ...],
) -> None:
    for k, (a, b) in enumerate(zip(first, second, strict=True)):
        last = k == len(first) - 1  # who works then is of the next episode, which another seed has
        for name, mine, theirs in list(zip(_PARTS, a, b, strict=True))[: 4 if last else 5]:
            if not np.array_equal(mine[list(rows)], theirs[list(others)]):
                raise ConformanceError(f"step {k}: {name} of one seed differ {what}")


def _check_next(env: BatchHandoff, seed: int, record: list[tuple[NDArray[Any], ...]]) -> None:
    """After an end the environment shows the first observation of the next seed."""
    if not (record[-1][2][0] or record[-1][3][0]):
        return
    rng, _ = np.random.default_rng(0), env.reset([seed])
    step = None
    while step is None or not step.finished:
        step = env.step(_actions(env, rng))
    if not np.array_equal(step.observations, env.reset([seed + 1])):
        raise ConformanceError("the episode after an end is not that of the next seed")
