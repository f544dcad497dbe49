"""Copies of every form go on like the original and share nothing; dropped environments free their client."""

from __future__ import annotations

import copy
import gc
import pickle
from collections.abc import Callable
from typing import Any

import cloudpickle
import numpy as np
import pybullet as pb
import pytest

from camnet.agents import make_team
from camnet.copies import ExactCopies
from camnet.env import handoff_v0
from camnet.env.batch_handoff import BatchHandoff
from camnet.env.batch_vector import BatchVectorEnv
from camnet.env.single import SingleAgentEnv
from camnet.errors import ConfigError
from camnet.world.pybullet import open_clients


def repickled(env: Any) -> Any:
    return pickle.loads(pickle.dumps(env))


def cloud_repickled(env: Any) -> Any:
    return cloudpickle.loads(cloudpickle.dumps(env))


WAYS: list[Callable[[Any], Any]] = [copy.deepcopy, repickled, cloud_repickled]


def drawn(space: Any, rng: np.random.Generator) -> Any:
    return (
        rng.uniform(space.low, space.high).astype(space.dtype)
        if hasattr(space, "low")
        else np.int64(rng.integers(space.n))
    )


def play(env: Any, steps: int, seed: int) -> list[str]:
    """Everything that some steps of any form return, as text with all digits."""
    rng, told = np.random.default_rng(seed), []
    with np.printoptions(threshold=10**6, floatmode="unique"):
        for _ in range(steps):
            if hasattr(env, "agent_selection"):
                env.step(drawn(env.action_space(env.agent_selection), rng))
                told.append(repr(env.last()))
            elif isinstance(env, handoff_v0.HandoffEnv):
                told.append(repr(env.step({a: drawn(env.action_space(a), rng) for a in env.agents})))
                told.append(repr(env.state()))
            elif isinstance(env, BatchHandoff):
                told.append(repr(env.step(rng.uniform(-1, 1, (env.environments, env.n_agents, 5)))))
            else:
                told.append(repr(env.step(drawn(env.action_space, rng))))
    return told


def batch(**options: Any) -> BatchHandoff:
    return BatchHandoff("quickstart", 3, threads=2, **{"filter_name": "ekf", **options})


FORMS: dict[str, Callable[[], Any]] = {
    "parallel": lambda: handoff_v0.parallel_env(max_cycles=500),
    "velocity": lambda: handoff_v0.parallel_env(action_mode="velocity"),
    "assign, late, failing": lambda: handoff_v0.parallel_env(
        action_mode="assign", message_delay_s=0.3, message_loss=0.2, failures={"rate_per_s": 0.01}
    ),
    "oracle, two targets": lambda: handoff_v0.parallel_env(world="loop_8", filter_name="oracle"),
    "late measurements": lambda: handoff_v0.parallel_env(overrides=["sensing.latency_s=0.2"]),
    "kinematic": lambda: handoff_v0.parallel_env(overrides=["physics.actuation=kinematic"]),
    "agent by agent": handoff_v0.env,
    "single": lambda: SingleAgentEnv(agent="camera_1"),
    "single among others": lambda: SingleAgentEnv(others=lambda env: make_team("nearest", env)),
    "batch": batch,
    "batch, learned, failing": lambda: batch(filter_name="learned", failures={"rate_per_s": 0.05}),
    "vector": lambda: BatchVectorEnv(batch(max_cycles=12)),
}


@pytest.mark.parametrize("form", FORMS)
def test_copies_in_mid_episode_go_on_bit_for_bit(form: str) -> None:
    env = FORMS[form]()
    env.reset(seed=3)
    play(env, 8, 1)
    copies = [way(env) for way in WAYS]
    told = play(copies[0], 20, 2)
    assert play(env, 20, 2) == told  # what the copy did has not moved the original
    assert play(copies[1], 20, 2) == told
    env.close()
    assert play(copies[2], 20, 2) == told  # nor does it need it
    for one in copies:
        one.close()


@pytest.mark.parametrize("form", FORMS)
def test_copies_before_a_reset_and_after_closing(form: str) -> None:
    env = FORMS[form]()
    fresh = copy.deepcopy(env)
    env.reset(seed=4)
    fresh.reset(seed=4)
    assert play(fresh, 3, 2) == play(env, 3, 2)
    for one in (fresh, env):
        one.close()
        one.close()
    with pytest.raises(ConfigError, match="closed"):
        repickled(env).reset(seed=1)


@pytest.mark.parametrize(
    ("world", "overrides"), [("quickstart", ["sensing.level=image"]), ("obstacle_course", [])]
)
def test_copies_see_the_same_pictures(world: str, overrides: list[str]) -> None:
    env = handoff_v0.parallel_env(world=world, overrides=overrides)
    env.reset(seed=1)
    play(env, 2, 1)
    seen = env.simulation.world.render(0, 64, 48)
    np.testing.assert_array_equal(copy.deepcopy(env).simulation.world.render(0, 64, 48), seen)
    env.close()


def test_copies_after_a_touch_stay_close() -> None:
    """One agent is put upon another; the copy is made while they touch."""
    env = handoff_v0.parallel_env(terminate_on_collision=False)
    env.reset(seed=1)
    world = env.simulation.world
    second = world._scene.agents[1]
    p = env.simulation.snapshot.agent_p_world
    for _ in range(3):
        env.step({name: np.zeros(5, dtype=np.float32) for name in env.agents})
    pb.resetBasePositionAndOrientation(
        second, (p[0] + [0.05, 0.0, 0.13]).tolist(), (0, 0, 0, 1), physicsClientId=world._engine.client
    )
    pb.performCollisionDetection(physicsClientId=world._engine.client)
    other = copy.deepcopy(env)
    away = 0.0
    for _ in range(100):
        actions = {name: np.zeros(5, dtype=np.float32) for name in env.agents}
        env.step(actions)
        other.step(actions)
        one, two = env.simulation.snapshot, other.simulation.snapshot
        away = max(away, float(np.abs(one.agent_p_world - two.agent_p_world).max()))
        assert one.collisions == two.collisions
    assert env.simulation.statistics.collisions
    assert away < 1e-6
    env.close()
    other.close()


def test_rendered_copies_show_the_same_picture() -> None:
    env = handoff_v0.parallel_env(render_mode="rgb_array")
    env.reset(seed=1)
    for _ in range(5):
        play(env, 2, 1)
        env.render()
    np.testing.assert_array_equal(copy.deepcopy(env).render(), env.render())
    env.close()


@pytest.mark.parametrize("make", [handoff_v0.parallel_env, handoff_v0.env, SingleAgentEnv])
def test_dropped_environments_free_their_client_at_once(make: Callable[[], Any]) -> None:
    before, enabled = open_clients(), gc.isenabled()
    gc.disable()
    try:
        env = make()
        env.reset(seed=1)
        other = copy.deepcopy(env)
        assert open_clients() == before + 2
        del env
        assert open_clients() == before + 1
        del other
        assert open_clients() == before
    finally:
        if enabled:
            gc.enable()


class Holder(ExactCopies):
    """Arrays in every relation that a copy has to keep."""

    def __init__(self) -> None:
        self.whole = np.arange(24.0).reshape(4, 6)
        self.again, self.part, self.turned = self.whole, self.whole[1:, ::2], self.whole.T
        self.fixed = np.arange(3)
        self.fixed.setflags(write=False)
        self.wide = np.broadcast_to(self.whole[0], (5, 6))
        self.large = np.zeros((600, 600))
        self.large[7, 300:400] = np.pi
        self.column_wise = np.asfortranarray(np.random.default_rng(0).random((500, 700)))
        self.empty = np.zeros((0, 3))[:, 1:]
        self.rule = lambda x: x + self.whole[0, 0]


@pytest.mark.parametrize("way", WAYS)
def test_views_layouts_and_flags_are_kept(way: Callable[[Any], Any]) -> None:
    one = Holder()
    two = way(one)
    for name, array in vars(one).items():
        if isinstance(array, np.ndarray):
            other = getattr(two, name)
            np.testing.assert_array_equal(other, array)
            assert other.dtype == array.dtype
            assert other.flags.writeable == array.flags.writeable
            assert other.strides == array.strides or not array.size
            assert not np.shares_memory(other, array)
    assert two.again is two.whole
    two.whole[1, 2] = -1.0
    assert two.part[0, 1] == two.turned[2, 1] == -1.0
    two.whole[0] = 5.0
    assert (two.wide == 5.0).all()
    assert two.rule(1.0) == 6.0
    assert one.rule(1.0) == 1.0
