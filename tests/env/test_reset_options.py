"""Options of reset change one episode, and faults in them are named."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from camnet.env import handoff_v0
from camnet.errors import ConfigError


def make(**options: Any) -> handoff_v0.HandoffEnv:
    return handoff_v0.parallel_env(**{"max_cycles": 3, **options})


def start(env: handoff_v0.HandoffEnv, seed: int = 1, **options: Any) -> Any:
    env.reset(seed=seed, options=options)
    return env.simulation.snapshot


def test_targets_get_slower_and_faster_and_back() -> None:
    env = make()
    speed = np.linalg.norm(start(env).target_v_world)
    assert np.linalg.norm(start(env, target_speed_scale=0.5).target_v_world) == pytest.approx(
        0.5 * speed, rel=1e-6
    )
    assert np.linalg.norm(start(env, target_speed_scale=2.0).target_v_world) == pytest.approx(
        2 * speed, rel=1e-6
    )
    assert np.linalg.norm(start(env).target_v_world) == pytest.approx(speed)
    env.close()


def test_targets_start_elsewhere() -> None:
    env = make()
    road = np.array(env.simulation.network.scenario.roads[0].points_m)
    half = start(env, target_start=0.5).target_p_world[0, :2]
    assert np.linalg.norm(road - half, axis=1).min() < 0.9
    assert half[0] < -3.0  # the loop begins in the east
    np.testing.assert_array_equal(start(env, target_start=[0.5]).target_p_world[0, :2], half)
    drawn = [start(env, seed=s, target_start="random").target_p_world[0] for s in (1, 2, 1)]
    assert np.linalg.norm(drawn[0] - drawn[1]) > 0.1
    np.testing.assert_array_equal(drawn[0], drawn[2])
    env.close()


def test_vehicles_on_streets_start_elsewhere() -> None:
    env = make(world="grid_16")
    places = start(env, target_start=(0.0, 0.25, 0.5, 0.5)).target_p_world[:, :2]
    roads = {road.name: np.array(road.points_m) for road in env.simulation.network.scenario.roads}
    for place, share, target in zip(
        places, (0.0, 0.25, 0.5, 0.5), env.simulation.network.scenario.targets, strict=True
    ):
        a, b = roads[target.motion.road]
        np.testing.assert_allclose(place, a + share * (b - a), atol=1e-9)
    env.close()


def test_noise_and_length() -> None:
    env = make()
    start(env, noise_scale=3.0)
    assert env.simulation.network.scenario.sensing.position_noise_m == pytest.approx(0.03)
    env.reset(seed=1, options={"max_cycles": 2})
    action = {name: np.zeros(5, dtype=np.float32) for name in env.agents}
    env.step(action)
    *_, truncations, _ = env.step(action)
    assert all(truncations.values())
    env.reset(seed=1)
    env.step(action)
    env.step(action)
    assert env.agents  # the next episode has its own length again
    assert env.simulation.network.scenario.sensing.position_noise_m == pytest.approx(0.01)
    env.close()


def test_messages_and_failures() -> None:
    env = make(max_cycles=20)
    env.reset(seed=1, options={"message_loss": 1.0, "failure_rate_per_s": 100.0})
    assert not env.beliefs().peers_known.any()
    *_, infos = env.step({name: np.zeros(5, dtype=np.float32) for name in env.agents})
    assert all(info["failed"] for info in infos.values())
    env.reset(seed=1)
    assert env.beliefs().peers_known.any()
    env.close()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"target_sped_scale": 2}, "'target_sped_scale': unknown; did you mean 'target_speed_scale'"),
        ({"target_speed_scale": 0}, "target_speed_scale = 0: input should be greater than 0"),
        ({"target_start": 1.5}, r"target_start = 1\.5: .*less than 1"),
        ({"target_start": "somewhere"}, "target_start = 'somewhere': input should be 'random'"),
        ({"target_start": [0.1, 0.2]}, "2 shares for 1 targets"),
        ({"noise_scale": float("nan")}, "noise_scale = nan"),
        ({"max_cycles": 0}, "max_cycles = 0"),
        ({"message_loss": 2}, "message_loss = 2"),
        ({"failure_rate_per_s": "often"}, "failure_rate_per_s = 'often'"),
    ],
)
def test_bad_options_are_named(options: dict[str, Any], words: str) -> None:
    env = make()
    with pytest.raises(ConfigError, match=words):
        env.reset(seed=1, options=options)
    env.close()


@pytest.mark.parametrize("seed", [-1, 0.5, "one", True])
def test_bad_seeds_are_named(seed: Any) -> None:
    env = make()
    with pytest.raises(ConfigError, match="seed = "):
        env.reset(seed=seed)
    env.close()
