"""Every agent by name: the estimator it relies on, and how its team is built.

| name | rule | estimator |
| --- | --- | --- |
| `learned` | track, meet at the predicted entry, loiter | learning estimator, one model a target |
| `learned_shared` | the same | learning estimator, one model for all targets |
| `ekf` | the same | constant-velocity extended Kalman filter |
| `auction` | the same, each target given to one agent by auction | learning estimator |
| `planner` | fly to the pose from which most will be seen in the next seconds | learning estimator |
| `oracle` | the same, and who wins nothing minds whatever comes; cameras a little higher | the truth, now and to come |
| `nearest` | fly towards the nearest estimate | constant-velocity extended Kalman filter |
| `planner_oracle` | the planner's rule | the truth, now and to come |
| `blind` | as `static`, and `camnet evaluate` switches all cameras off | (none) |
| `static` | stay in the middle, look down | (the same) |
| `random` | any action | (the same) |
| `module:attribute` | of another package: an `AgentContext` in, a policy out | its `estimator`, else the learning one |
| a file name | what `camnet train` wrote there | the one it was trained with |
"""

from __future__ import annotations

import difflib
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from camnet.agents.auction import Auction
from camnet.agents.learned import Learned
from camnet.agents.nearest import Nearest
from camnet.agents.oracle import Oracle
from camnet.agents.planner import Planner
from camnet.agents.policy import Action, AgentContext, Policy
from camnet.agents.policy_file import load_policy
from camnet.agents.random_walk import RandomWalk
from camnet.agents.static import Static
from camnet.agents.trained import Trained
from camnet.errors import ConfigError
from camnet.plugins import is_plugin, load_plugin

__all__ = ["AGENTS", "Team", "build_policies", "build_team", "estimator_of"]

#: acts for all agents of one environment: observations by name in, actions by name out
Team = Callable[[Mapping[str, NDArray[np.float32]]], dict[str, Action]]

_SINGLE: dict[str, Callable[[AgentContext], Policy]] = {
    "learned": Learned,
    "learned_shared": Learned,
    "adate": Learned,
    "ekf": Learned,
    "nearest": Nearest,
    "static": Static,
    "blind": Static,
}
_ESTIMATOR = {
    "auction": "learned",
    "planner": "learned",
    "nearest": "ekf",
    "static": "ekf",
    "random": "ekf",
    "blind": "ekf",
    "planner_oracle": "oracle",
}

_TEAMS: dict[str, Callable[[Mapping[str, AgentContext]], Team]] = {
    "auction": Auction,
    "oracle": Oracle,
    "planner": Planner,
    "planner_oracle": Planner,
}

#: names of the built-in agents
AGENTS = (*_SINGLE, *_TEAMS, "random")


def _outside(name: str) -> Callable[[AgentContext], Policy]:
    return load_plugin(name, "agent", "a function or class of an AgentContext")


def _checked(name: str, policy: Policy) -> Policy:
    if not callable(policy):
        raise ConfigError(
            f"agent: {name!r} made {type(policy).__name__}: a policy, called with an observation, was expected"
        )
    return policy


def _is_file(name: str) -> bool:
    return name.endswith(".npz")


def estimator_of(name: str) -> str:
    """Return the estimator (`camnet.simulation.filters.FILTERS`) that an agent's observations come from.

    Raises
    ------
    ConfigError, DataError
        There is no such agent, or its policy file cannot be read.
    """
    if _is_file(name):
        return load_policy(Path(name)).header.filter_name
    if is_plugin(name):
        return str(getattr(_outside(name), "estimator", "learned"))
    if name not in AGENTS:
        close = difflib.get_close_matches(name, AGENTS, 1)
        hint = f"did you mean {close[0]!r}? " if close else ""
        raise ConfigError(
            f"agent {name!r}: unknown: {hint}known are {', '.join(AGENTS)}, policy files by name (*.npz), and "
            "module:attribute of another package"
        )
    return _ESTIMATOR.get(name, name)


def build_policies(name: str, known: Mapping[str, AgentContext], seed: int = 0) -> dict[str, Policy]:
    """Build one policy per agent; agents that act as a team (``auction``, ``oracle``, policy files) have none.

    Raises
    ------
    ConfigError
        There is no such policy.
    """
    if name == "random":
        seeds = np.random.SeedSequence(seed).spawn(len(known))
        return {
            agent: RandomWalk(context, np.random.default_rng(child))
            for (agent, context), child in zip(known.items(), seeds, strict=True)
        }
    if is_plugin(name):
        make = _outside(name)
        return {agent: _checked(name, make(context)) for agent, context in known.items()}
    if name not in _SINGLE:
        names = ", ".join((*_SINGLE, "random"))
        raise ConfigError(f"agent {name!r}: unknown as a policy of one agent; known are {names}")
    return {agent: _SINGLE[name](context) for agent, context in known.items()}


def build_team(name: str, known: Mapping[str, AgentContext], seed: int = 0) -> Team:
    """Build what acts for all agents of an environment.

    Parameters
    ----------
    name : of an agent, or of a policy file
    known : fixed facts of every agent (`camnet.agents.contexts`)
    seed : of the random agent

    Raises
    ------
    ConfigError, DataError
        There is no such agent, or its policy file cannot be read.
    """
    estimator_of(name)  # names are checked in one place
    if name in ("planner", "planner_oracle"):
        return Planner(known, seed, searches=name == "planner")
    if name in _TEAMS:
        return _TEAMS[name](known)
    if _is_file(name):
        return Trained(known, load_policy(Path(name)))
    policies = build_policies(name, known, seed)
    return lambda observations: {agent: policies[agent](seen) for agent, seen in observations.items()}
