"""Policies, one per file: a policy sees observations, never the truth and never the physics engine.

Import as ``camnet.agents``; the top-level name ``agents`` belongs to other packages.
`make_policies` builds one policy for every agent of an environment by name, `make_team` what acts for all of them at
once; `AGENTS` lists the names and `estimator_of` says which estimator an environment needs for each.
"""

from __future__ import annotations

if __name__ != "camnet.agents":
    raise ImportError("import this package as camnet.agents")

from camnet.agents.policy import AgentContext, Policy, contexts, network_contexts
from camnet.agents.policy_file import load_policy, save_policy
from camnet.agents.roster import AGENTS, Team, build_policies, build_team, estimator_of
from camnet.env.handoff_v0 import HandoffEnv

__all__ = [
    "AGENTS",
    "AgentContext",
    "Policy",
    "Team",
    "build_team",
    "contexts",
    "estimator_of",
    "load_policy",
    "make_policies",
    "make_team",
    "network_contexts",
    "save_policy",
]


def make_policies(name: str, env: HandoffEnv, seed: int = 0) -> dict[str, Policy]:
    """Build the policy ``name`` for every agent of ``env``.

    Raises
    ------
    ConfigError
        There is no such policy; the known names are listed.
    """
    return build_policies(name, contexts(env), seed)


def make_team(name: str, env: HandoffEnv, seed: int = 0) -> Team:
    """Build what acts for all agents of ``env``: a built-in agent, or a policy file by its name.

    Raises
    ------
    ConfigError, DataError
        There is no such agent, or its policy file cannot be read.
    """
    return build_team(name, contexts(env), seed)
