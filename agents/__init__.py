"""Policies, one per file: a policy sees observations, never the truth and never the physics engine.

Import as ``camnet.agents``; the top-level name ``agents`` belongs to other packages.
`make_policies` builds one policy for every agent of an environment by name; `AGENTS` lists the names.
"""

from __future__ import annotations

if __name__ != "camnet.agents":
    raise ImportError("import this package as camnet.agents")

import numpy as np

from camnet.agents.learned import Learned
from camnet.agents.nearest import Nearest
from camnet.agents.policy import AgentContext, Policy, contexts
from camnet.agents.random_walk import RandomWalk
from camnet.agents.static import Static
from camnet.env.handoff_v0 import HandoffEnv
from camnet.errors import ConfigError

__all__ = ["AGENTS", "AgentContext", "Policy", "contexts", "make_policies"]

#: names of the built-in agents; ``learned`` and ``ekf`` share a rule and differ in the environment's ``filter_name``
AGENTS = ("learned", "ekf", "nearest", "static", "random")


def make_policies(name: str, env: HandoffEnv, seed: int = 0) -> dict[str, Policy]:
    """Build the policy ``name`` for every agent of ``env``.

    Raises
    ------
    ConfigError
        There is no such policy; the known names are listed.
    """
    known = contexts(env)
    if name in ("learned", "ekf"):
        return {agent: Learned(context) for agent, context in known.items()}
    if name == "nearest":
        return {agent: Nearest(context) for agent, context in known.items()}
    if name == "static":
        return {agent: Static(context) for agent, context in known.items()}
    if name == "random":
        seeds = np.random.SeedSequence(seed).spawn(len(known))
        return {
            agent: RandomWalk(context, np.random.default_rng(child))
            for (agent, context), child in zip(known.items(), seeds, strict=True)
        }
    raise ConfigError(f"agent {name!r}: unknown; known are {', '.join(AGENTS)}")
