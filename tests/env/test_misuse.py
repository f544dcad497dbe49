"""Every misuse is one clear error, in every form, and moves nothing."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from camnet.env import handoff_v0
from camnet.env.batch_handoff import BatchHandoff
from camnet.env.batch_vector import BatchVectorEnv
from camnet.env.single import SingleAgentEnv
from camnet.errors import ConfigError


def batch() -> BatchHandoff:
    return BatchHandoff("quickstart", 2, filter_name="ekf", threads=1)


FORMS: dict[str, Callable[[], Any]] = {
    "parallel": handoff_v0.parallel_env,
    "raw": handoff_v0.raw_env,
    "agent by agent": handoff_v0.env,
    "single": SingleAgentEnv,
    "batch": batch,
    "vector": lambda: BatchVectorEnv(batch()),
}

#: actions of one agent that are none: what is wrong, and the action
FAULTS: dict[str, tuple[str, Any]] = {
    "NaN": ("not all finite", np.array([0.0, np.nan, 0.0, 0.0, 0.0])),
    "infinite": ("not all finite", np.full(5, np.inf)),
    "beyond its bounds": (r"as large as 1\.5", np.array([0.0, 0.0, -1.5, 0.0, 0.0])),
    "whole numbers": ("type int64", np.zeros(5, dtype=np.int64)),
    "words": ("type <U5", np.array(["right"] * 5)),
    "too short": ("shape", np.zeros(4)),
    "a matrix": ("shape", np.zeros((1, 5))),
    "objects": ("type object", np.full(5, None)),
}


def act(env: Any, action: Any) -> Any:
    """Let every agent of any form take ``action``."""
    if hasattr(env, "agent_selection"):
        return env.step(action)
    if isinstance(env, handoff_v0.HandoffEnv):
        return env.step(dict.fromkeys(env.agents or env.possible_agents, action))
    if isinstance(env, SingleAgentEnv):
        return env.step(action)
    return env.step(np.broadcast_to(action, (2, 4, *np.shape(action))))


def place(env: Any) -> Any:
    inner = getattr(env, "unwrapped", env)
    inner = getattr(inner, "network_env", getattr(inner, "env", inner))
    simulation = inner.simulation
    return simulation.gather("cameras") if isinstance(inner, BatchHandoff) else simulation.snapshot.step


@pytest.fixture(scope="module", params=FORMS)
def env(request: pytest.FixtureRequest) -> Any:
    env = FORMS[request.param]()
    env.reset(seed=1)
    yield env
    env.close()


@pytest.mark.parametrize("fault", FAULTS)
def test_what_is_no_action(env: Any, fault: str) -> None:
    words, action = FAULTS[fault]
    before = place(env)
    with pytest.raises(ConfigError, match=f"(?s)action.*expected; given: {words}"):
        act(env, action)
    np.testing.assert_array_equal(place(env), before)


def test_what_single_precision_rounds_is_on_the_bounds(env: Any) -> None:
    act(env, np.full(5, np.nextafter(np.float32(1.0), np.float32(2.0))))


@pytest.mark.parametrize("seed", [-1, 0.5, "one", True, np.float64(3.0), np.int64(-2)])
def test_what_is_no_seed(env: Any, seed: Any) -> None:
    with pytest.raises(ConfigError, match=r"seed = .*whole number from 0 on"):
        env.reset(seed=seed)


def test_seeds_of_numpy(env: Any) -> None:
    for seed in (np.int64(4), np.uint8(4), np.int32(4)):
        env.reset(seed=seed)


def test_unknown_options_are_named(env: Any) -> None:
    if isinstance(env, BatchHandoff):
        pytest.skip("this form's reset has no options")
    with pytest.raises(ConfigError, match=r"reset option.* 'gravity'"):
        env.reset(seed=1, options={"gravity": 3.0})


@pytest.mark.parametrize("form", FORMS)
def test_calls_out_of_order(form: str) -> None:
    env, action = FORMS[form](), np.zeros(5, dtype=np.float32)
    calls: list[Callable[[], Any]] = [lambda: act(env, action)]
    if form == "agent by agent" or form == "raw":
        calls = [lambda: env.step(action)]
    if not form.startswith(("batch", "vector")):
        calls.append(env.render)
    if form in ("parallel", "raw", "agent by agent"):
        calls.append(env.state)
    for call in calls:
        with pytest.raises(ConfigError, match=r"not reset|not begun"):
            call()
    env.reset(seed=1)
    env.close()
    env.close()
    for call in [*calls, lambda: env.reset(seed=1)]:
        with pytest.raises(ConfigError, match="closed"):
            call()


def test_who_is_no_agent_and_who_is_missing() -> None:
    env = handoff_v0.parallel_env()
    env.reset(seed=1)
    action = np.zeros(5, dtype=np.float32)
    for ask in (env.action_space, env.observation_space):
        with pytest.raises(ConfigError, match="'camera_9': no such agent; there are camera_0"):
            ask("camera_9")
    with pytest.raises(ConfigError, match="'camera_9' is no agent; the agents are camera_0"):
        env.step({**dict.fromkeys(env.agents, action), "camera_9": action})
    with pytest.raises(ConfigError, match=r"none given for \['camera_3'\]"):
        env.step(dict.fromkeys(env.agents[:3], action))
    for wrong in ([action] * 4, None, "forward"):
        with pytest.raises(ConfigError, match="a dictionary from agents' names to actions"):
            env.step(wrong)  # type: ignore[arg-type]
    assert env.simulation.snapshot.step == 0
    env.close()


@pytest.mark.parametrize("wrong", [1.0, "0", np.array([0]), 4, -1, None, [1, [2]]])
def test_what_is_no_assignment(wrong: Any) -> None:
    env = handoff_v0.parallel_env(action_mode="assign")
    env.reset(seed=1)
    with pytest.raises(ConfigError, match=r"a whole number in 0\.\.3"):
        env.step({**dict.fromkeys(env.agents, np.int64(0)), "camera_2": wrong})
    env.close()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"environments": 0}, "environments = 0: a whole number from 1 on"),
        ({"environments": 2.5}, r"environments = 2\.5"),
        ({"threads": -1}, "threads = -1"),
    ],
)
def test_counts_of_a_batch(options: dict[str, Any], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        BatchHandoff("quickstart", filter_name="ekf", **options)


def test_rows_of_a_batch_that_are_not_there() -> None:
    env = batch()
    for rows in ([2], [-1], [0, 0], ["a"], [0.0]):
        with pytest.raises(ConfigError, match="environments = "):
            env.reset(environments=rows)  # type: ignore[arg-type]
    with pytest.raises(ConfigError, match="seed = -3"):
        env.reset([1, -3])
    env.close()
