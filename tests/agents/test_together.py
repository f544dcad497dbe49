"""Agents on arrays act as the same agents one by one."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from camnet.agents import AgentContext, build_team, network_contexts
from camnet.agents.features import FEATURES
from camnet.agents.policy_file import PolicyHeader, PolicyNet, save_policy
from camnet.agents.together import build_together
from camnet.config.load import load_scenario
from camnet.config.models import Scenario
from camnet.env.layout import ObservationLayout
from camnet.geometry.regions import CylinderRegion
from camnet.simulation.network import build_network

SEEDS = (3, 4, 5, 6, 7, 8)


def shown(layout: ObservationLayout, agents: int, rng: np.random.Generator) -> np.ndarray:
    """Observations anywhere in their bounds, flags whole, with targets near enough to matter."""
    low, high = np.maximum(layout.low, -2.0), np.minimum(layout.high, 2.0)
    flat = rng.uniform(low, high, (len(SEEDS), agents, layout.size))
    for name, where in layout.slices.items():
        part = name.rsplit(".", 1)[1]
        if part in ("known", "seen_by_me", "seen", "inside"):
            flat[..., where] = rng.random(flat[..., where].shape) < 0.4
        elif part == "coming":
            flat[..., where] = rng.choice([0.0, 0.5, 1.0], flat[..., where].shape)
    return flat.astype(np.float32)


def rounded(context: AgentContext) -> CylinderRegion:
    """The largest upright cylinder in an agent's region."""
    heights = [context.center[2] - context.half_size[2], context.center[2] + context.half_size[2]]
    return CylinderRegion("round", context.center[:2], float(context.half_size[:2].min()), heights)


@pytest.fixture(scope="module")
def policy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    rng, n = np.random.default_rng(1), len(FEATURES)
    header = PolicyHeader(features=FEATURES, residual_of="learned", residual_scale=0.5)
    net = PolicyNet(header, np.zeros(n), np.ones(n), (rng.normal(0, 0.3, (n, 5)),), (rng.normal(0, 0.3, 5),))
    path = tmp_path_factory.mktemp("policy") / "policy.npz"
    save_policy(path, net)
    return path


@pytest.mark.parametrize("world", ["pursuit", "grid_16", "round"])
@pytest.mark.parametrize(
    "agent", ["learned", "nearest", "static", "random", "auction", "planner", "oracle", "file"]
)
def test_agents_on_arrays_act_as_one_by_one(world: str, agent: str, policy: Path) -> None:
    scenario = load_scenario("pursuit" if world == "round" else world)
    assert isinstance(scenario, Scenario)
    network = build_network(scenario)
    layout = ObservationLayout(network.n_targets, min(2, network.n_agents - 1))
    known = network_contexts(network, layout, 1.2)
    if world == "round":
        known = {a: replace(context, region=rounded(context)) for a, context in known.items()}
    name = str(policy) if agent == "file" else agent
    together, teams = build_together(name, known, SEEDS), [build_team(name, known, seed) for seed in SEEDS]
    rng = np.random.default_rng(0)
    for _ in range(3):
        rows = shown(layout, network.n_agents, rng)
        alive = rng.random(rows.shape[:2]) < 0.8
        mine = together(rows, alive)
        assert mine.dtype == np.float32
        for e, team in enumerate(teams):
            live = {a: rows[e, j] for j, a in enumerate(known) if alive[e, j] or agent == "random"}
            theirs = team(live)
            for j, a in enumerate(known):
                if a in theirs:
                    np.testing.assert_allclose(mine[e, j], theirs[a], atol=2e-6, err_msg=f"{a} of {e}")
