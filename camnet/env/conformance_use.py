"""Checks of how an environment is used, beside what it returns: copies, calls out of order, options, dropping.

| check | what |
| --- | --- |
| `check_copies` | `copy.deepcopy` and `pickle` in mid-episode: copies go on like the original and do not move it |
| `check_misuse` | a step before a reset and after closing, an unknown agent, a missing action, NaN: an error each |
| `check_options` | a reset refuses options that it does not know |
| `check_release` | an environment that is dropped without closing frees its physics client |
"""

from __future__ import annotations

import copy
import gc
import pickle
from collections.abc import Callable
from typing import Any

import numpy as np
from gymnasium import spaces
from pettingzoo import ParallelEnv

from camnet.env.conformance_batch import ConformanceError
from camnet.errors import ConfigError
from camnet.world.pybullet import open_clients

__all__ = ["check_copies", "check_misuse", "check_options", "check_release", "drawn_action"]

MakeEnv = Callable[[], ParallelEnv[str, Any, Any]]

_UNKNOWN_OPTION = "no_option_of_any_environment"


def drawn_action(env: ParallelEnv[str, Any, Any], name: str, rng: np.random.Generator) -> Any:  # noqa: ANN401
    """Return a random action of one agent.

    Raises
    ------
    ConformanceError
        The action space is neither a Box nor Discrete.
    """
    space: Any = env.action_space(name)
    if isinstance(space, spaces.Box):
        return rng.uniform(space.low, space.high).astype(space.dtype)
    if isinstance(space, spaces.Discrete):
        return np.int64(space.start + rng.integers(space.n))
    raise ConformanceError(f"action space of {name} is {space}; a Box or Discrete was expected")


def _steps(env: ParallelEnv[str, Any, Any], count: int, seed: int) -> list[Any]:
    """Play at most so many random steps and return what came."""
    rng, told = np.random.default_rng(seed), []
    for _ in range(count):
        if not env.agents:
            break
        told.append(env.step({name: drawn_action(env, name, rng) for name in env.agents})[:4])
    return told


def _same(one: Any, other: Any) -> bool:  # noqa: ANN401 - whatever environments return
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(_same(one[key], other[key]) for key in one)
    if isinstance(one, list | tuple):
        return len(one) == len(other) and all(_same(a, b) for a, b in zip(one, other, strict=True))
    return bool(np.array_equal(np.asarray(one), np.asarray(other)))


def check_copies(make_env: MakeEnv, seed: int = 0, steps: int = 10) -> None:
    """Copy in mid-episode; copy and original go on alike, bit for bit, as long as nothing touches.

    Raises
    ------
    ConformanceError
        They do not.
    """
    env = make_env()
    env.reset(seed=seed)
    _steps(env, 5, seed)
    copies = {
        "copy.deepcopy": copy.deepcopy(env),
        "pickle": pickle.loads(pickle.dumps(env)),
    }
    first = _steps(copies["copy.deepcopy"], steps, seed + 1)
    told = {"the original, beside its copy": _steps(env, steps, seed + 1)}
    told["pickle"] = _steps(copies["pickle"], steps, seed + 1)
    for one in (env, *copies.values()):
        one.close()
    for name, steps_told in told.items():
        if not _same(first, steps_told):
            raise ConformanceError(f"{name}: goes on otherwise than copy.deepcopy under the same actions")


def check_misuse(make_env: MakeEnv, seed: int = 0) -> None:
    """Misuse is an error that is raised on purpose, and closing twice is harmless.

    Raises
    ------
    ConformanceError
        Something is accepted, or raises what no one can understand.
    """
    env, rng = make_env(), np.random.default_rng(seed)
    actions = {name: drawn_action(env, name, rng) for name in env.possible_agents}
    _refused("step before reset", lambda: env.step(actions))
    _refused("state before reset", env.state)
    env.reset(seed=seed)
    first = env.possible_agents[0]
    nan = np.full(np.shape(actions[first]), np.nan)
    _refused(
        "an action for nobody", lambda: env.step({**actions, "no_agent_of_any_environment": actions[first]})
    )
    _refused("no actions", lambda: env.step({}))
    _refused("an action that is NaN", lambda: env.step({**actions, first: nan}))
    _refused("an action in words", lambda: env.step({**actions, first: "forward"}))
    _refused("the action space of nobody", lambda: env.action_space("no_agent_of_any_environment"))
    _refused("seed -1", lambda: env.reset(seed=-1))
    env.close()
    env.close()
    _refused("step after close", lambda: env.step(actions))
    _refused("reset after close", lambda: env.reset(seed=seed))


def check_options(make_env: MakeEnv) -> None:
    """Refuse options of a reset that are not known.

    Raises
    ------
    ConformanceError
        They are accepted, or the error does not name them.
    """
    env = make_env()
    _refused("an unknown option", lambda: env.reset(options={_UNKNOWN_OPTION: 1}), _UNKNOWN_OPTION)
    env.close()


def check_release(make_env: MakeEnv, seed: int = 0) -> None:
    """Free the physics client of an environment that nobody holds any more.

    Raises
    ------
    ConformanceError
        It stays open.
    """
    before = open_clients()
    env = make_env()
    env.reset(seed=seed)
    del env
    gc.collect()
    if open_clients() > before:
        raise ConformanceError("an environment was dropped, and its physics client is still open")


def _refused(what: str, call: Callable[[], Any], word: str = "") -> None:
    try:
        call()
    except ConfigError as error:
        if word not in str(error):
            raise ConformanceError(f"{what}: the error does not name {word!r}: {error}") from error
        return
    except Exception as error:
        raise ConformanceError(
            f"{what}: raises {type(error).__name__}: {error}; ConfigError was expected"
        ) from error
    raise ConformanceError(f"{what} is accepted; an error was expected")
