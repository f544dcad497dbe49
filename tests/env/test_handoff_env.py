"""The environment keeps PettingZoo's conventions, and stricter ones."""

from __future__ import annotations

import subprocess
import sys
import warnings
from typing import Any

import numpy as np
import pettingzoo
import pytest
from pettingzoo.test import (
    api_test,
    max_cycles_test,
    parallel_api_test,
    parallel_seed_test,
    render_test,
    seed_test,
)
from pettingzoo.test.state_test import state_test

from camnet.env import conformance, handoff_v0
from camnet.env.layout import ObservationLayout
from camnet.errors import ConfigError


@pytest.fixture(autouse=True)
def _warnings_are_errors() -> Any:
    with warnings.catch_warnings():
        warnings.simplefilter("error", UserWarning)
        yield


def short(**options: Any) -> handoff_v0.HandoffEnv:
    return handoff_v0.parallel_env(**{"max_cycles": 25, **options})


def test_pettingzoo_api_parallel_and_aec() -> None:
    parallel_api_test(handoff_v0.parallel_env(), 40)
    api_test(handoff_v0.env(), 40)


def test_pettingzoo_seeds() -> None:
    seed_test(handoff_v0.env, 10)
    parallel_seed_test(handoff_v0.parallel_env, 10)


def test_pettingzoo_state_and_cycles() -> None:
    state_test(handoff_v0.env(), handoff_v0.parallel_env())
    max_cycles_test(handoff_v0)


def test_pettingzoo_render(display: str) -> None:
    render_test(handoff_v0.env)


def test_whole_episodes_stay_in_their_spaces_and_repeat() -> None:
    conformance.check_containment(short, episodes=2, seed=3)
    conformance.check_repeatable(short, seed=5)


def test_a_fresh_process_plays_the_same_episode() -> None:
    code = (
        "from camnet.env import conformance, handoff_v0\n"
        "print(conformance.episode_digest(handoff_v0.parallel_env(max_cycles=25), 7))"
    )
    fresh = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert fresh.stdout.strip() == conformance.episode_digest(short(), 7)


def test_the_checks_find_an_observation_outside_its_space() -> None:
    env = short()
    true_step = env.step

    def broken(actions: dict[str, Any]) -> Any:
        observations, *rest = true_step(actions)
        observations["camera_0"] = observations["camera_0"] + 100.0
        return observations, *rest

    env.step = broken  # type: ignore[method-assign]
    with pytest.raises(conformance.ConformanceError, match="camera_0 is not in"):
        conformance.check_containment(lambda: env)


def test_the_checks_find_a_seed_that_is_not_used() -> None:
    def make() -> Any:
        env = short(max_cycles=5)
        true_reset = env.reset
        env.reset = lambda seed=None, options=None: true_reset(seed=0)  # type: ignore[method-assign]
        return env

    with pytest.raises(conformance.ConformanceError, match="seed is not used"):
        conformance.check_repeatable(make)


def test_registered_with_pettingzoo() -> None:
    env = pettingzoo.make("parallel", "camnet/Handoff-Quickstart-v0", max_cycles=3)
    assert env.metadata["name"] == "handoff_v0"
    env.close()


def test_layout_encodes_and_decodes() -> None:
    layout = ObservationLayout(2, 1)
    values = {"own.position": np.array([0.5, -0.5, 1.0]), "target_1.coming": 0.5, "neighbour_0.present": 1.0}
    back = layout.decode(layout.encode(values))
    for name, value in values.items():
        np.testing.assert_allclose(back[name], value)
    assert back["target_0.known"] == 0.0
    assert sum(field.size for field in layout.fields) == layout.size
    assert layout.space().contains(layout.encode({"target_0.position": np.full(3, 1e9)}))


def test_the_reward_never_exceeds_its_stated_bound() -> None:
    env = short(max_cycles=60)
    env.reset(seed=2)
    total = 0.0
    while env.agents:
        _, rewards, *_ = env.step({name: np.zeros(5, dtype=np.float32) for name in env.agents})
        total += rewards["camera_0"]
    handoffs = env.simulation.trackers[0].attempted
    assert total <= 6.0 * env.settings.reward.in_view + env.settings.reward.reacquired * handoffs + 1e-9
    assert total > 0.0  # the robot starts in view of a resting camera


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"render_mode": "video"}, "render_mode = 'video'"),
        ({"max_cycle": 3}, "unknown option 'max_cycle'"),
        ({"max_cycles": -1}, "max_cycles"),
        ({"world": "nowhere"}, "nowhere"),
        ({"world": "stationary_loop"}, "at least one agent"),
    ],
)
def test_bad_options_are_named(options: dict[str, Any], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        handoff_v0.parallel_env(**options)


def test_bad_actions_are_named() -> None:
    env = short()
    env.reset(seed=0)
    with pytest.raises(ConfigError, match="none given for"):
        env.step({})
    with pytest.raises(ConfigError, match="5 finite numbers"):
        env.step({name: np.full(5, np.nan) for name in env.agents})
