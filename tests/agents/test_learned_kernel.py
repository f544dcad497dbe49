"""The compiled rule is the readable one, for any observation."""

from __future__ import annotations

import numpy as np
import pytest

from camnet.agents import contexts
from camnet.agents.learned import Learned
from camnet.config.load import load_scenario
from camnet.config.models import Scenario
from camnet.env import handoff_v0


def _round_regions() -> Scenario:
    """Return the quickstart world with two targets and its first two regions round."""
    scenario = load_scenario("quickstart")
    assert isinstance(scenario, Scenario)
    content = scenario.model_dump()
    for region in content["regions"][:2]:
        low, high = np.array(region["shape"]["min_m"]), np.array(region["shape"]["max_m"])
        middle, half = 0.5 * (low + high), 0.5 * (high - low)
        region["shape"] = {
            "type": "cylinder",
            "center_m": middle[:2].tolist(),
            "radius_m": float(half[:2].min()),
            "z_m": [low[2], high[2]],
        }
    content["targets"] = [content["targets"][0], {**content["targets"][0], "name": "second"}]
    return Scenario.model_validate(content)


@pytest.fixture(scope="module")
def policies() -> list[Learned]:
    env = handoff_v0.parallel_env(world=_round_regions(), filter_name="ekf")
    known = list(contexts(env).values())
    env.close()
    assert known[0].layout.n_targets == 2
    return [Learned(context) for context in known]


def test_compiled_rule_is_the_readable_one(policies: list[Learned]) -> None:
    rng = np.random.default_rng(5)
    layout = policies[0]._context.layout
    roles = set()
    for _ in range(300):
        flat = rng.uniform(-1.2, 1.2, layout.size).astype(np.float32)
        for m in range(2):
            for name in ("seen_by_me", "seen", "inside"):
                flat[layout.slices[f"target_{m}.{name}"]] = rng.integers(2) * (rng.random() < 0.3)
            flat[layout.slices[f"target_{m}.coming"]] = rng.choice([0.0, 0.5, 1.0])
            for name in ("radius", "entry_radius", "entry_time"):
                flat[layout.slices[f"target_{m}.{name}"]] = rng.uniform(0.0, 1.5)
        for policy in policies:
            assert policy._facts is not None
            action = policy(flat)
            assert action.dtype == np.float32
            np.testing.assert_allclose(action, policy.readable(flat), atol=1e-6)
            roles.add(tuple((action[3:] != 0).tolist()))
    assert len(roles) > 1
