"""Who knows what when messages are late, lost, or out of range."""

from __future__ import annotations

from typing import Any

import numpy as np

from camnet.env import handoff_v0
from camnet.env.beliefs import Beliefs, shared_beliefs
from camnet.env.encode import BeliefEncoder
from camnet.env.messages import Messages, heard_lately, messages_are_perfect
from camnet.env.single import built_in


def make(**options: Any) -> handoff_v0.HandoffEnv:
    return handoff_v0.parallel_env(**{"max_cycles": 400, **options})


def play(env: handoff_v0.HandoffEnv, cycles: int, seed: int = 1, **options: Any) -> list[Beliefs]:
    """Fly the built-in rule; what everybody shared would have at each decision."""
    observations, _ = env.reset(seed=seed, options=options)
    act, shared = built_in(env), [shared_beliefs(env.simulation, np.inf)]
    for _ in range(cycles):
        observations, *_ = env.step(act(observations))
        shared.append(shared_beliefs(env.simulation, np.inf))
    return shared


def test_beliefs_are_written_as_the_observer_writes_the_estimates() -> None:
    env = make(world="pursuit")
    observations, _ = env.reset(seed=2)
    act = built_in(env)
    encoder = BeliefEncoder(env.simulation.network, env.observer.layout)
    for _ in range(60):
        observations, *_ = env.step(act(observations))
        expected = np.array([observations[name] for name in env.possible_agents])
        written = np.zeros_like(expected)
        first = env.observer.layout.slices["target_0.known"].start
        written[:, :first] = expected[:, :first]
        encoder.write(written, shared_beliefs(env.simulation, env.settings.communication_range_m))
        np.testing.assert_allclose(written, expected, atol=1e-6)
    env.close()


def test_perfect_messages_change_nothing() -> None:
    env = make()
    assert messages_are_perfect(env.simulation.network, env.settings)
    env.reset(seed=1)
    messages = Messages(env.simulation, env.settings, np.random.default_rng(0))
    action = {name: np.zeros(5, dtype=np.float32) for name in env.agents}
    for _ in range(30):
        heard, shared = messages.exchange(env.simulation), shared_beliefs(env.simulation, np.inf)
        for name in ("p_world", "v_world", "q_world", "radius_m", "last_seen_s", "seen", "peers_known"):
            np.testing.assert_array_equal(getattr(heard, name), getattr(shared, name), err_msg=name)
        others = shared.peers_known
        np.testing.assert_array_equal(heard.peers_p_world[others], shared.peers_p_world[others])
        assert heard.entries == shared.entries
        env.step(action)
    env.close()


def test_an_agent_that_sees_the_target_knows_at_once_and_the_others_later() -> None:
    env = make(message_delay_s=0.25)  # 3 decisions
    shared = play(env, 40)
    now = env.beliefs()
    assert env.simulation.visible[0, 0]
    np.testing.assert_array_equal(now.p_world[0], shared[40].p_world[0])
    old, age = shared[37], 0.3
    np.testing.assert_allclose(now.p_world[1], old.p_world[1] + age * old.v_world[1], atol=1e-12)
    np.testing.assert_allclose(now.radius_m[2], old.radius_m[2] + age * 0.6, atol=1e-12)
    np.testing.assert_allclose(now.peers_p_world[1, 2], old.own_p_world[2], atol=1e-12)
    env.close()


def test_when_every_message_is_lost_only_who_sees_the_target_knows_of_it() -> None:
    env = make(message_loss=1.0)
    play(env, 20)
    seen = env.simulation.visible[:, 0]
    np.testing.assert_array_equal(seen, [True, False, False, False])
    known = [env.observer.layout.decode(row)["target_0.known"][0] for row in rows(env)]
    np.testing.assert_array_equal(known, [1, 0, 0, 0])
    assert not env.beliefs().peers_known.any()
    env.close()


def rows(env: handoff_v0.HandoffEnv) -> list[Any]:
    observations, *_ = env.step({name: np.zeros(5, dtype=np.float32) for name in env.agents})
    return [observations[name] for name in env.possible_agents]


def test_messages_are_lost_at_their_rate() -> None:
    env = make(message_loss=0.3)
    observations, _ = env.reset(seed=1)
    act, fresh = built_in(env), []
    for _ in range(120):
        observations, *_ = env.step(act(observations))
        told, shared = env.beliefs(), shared_beliefs(env.simulation, np.inf)
        if env.simulation.visible[0, 0]:
            fresh += [bool(np.array_equal(told.p_world[j], shared.p_world[j])) for j in (1, 2, 3)]
    assert len(fresh) > 200
    assert abs(np.mean(fresh) - 0.7) < 4 * np.sqrt(0.21 / len(fresh))
    env.close()


def test_out_of_range_nothing_is_heard() -> None:
    env = make(communication_range_m=7.0)  # neighbours are 5.7 m apart, opposite agents 8 m
    play(env, 10)
    known = np.isfinite(env.beliefs().last_seen_s[:, 0])
    np.testing.assert_array_equal(known, [True, True, False, True])
    np.testing.assert_array_equal(env.beliefs().peers_known[0], [False, True, False, True])
    env.close()


def test_a_target_whose_keeper_fails_is_not_heard_of_until_it_is_seen_again() -> None:
    env = make(failures={"schedule_s": {"camera_0": 1.0}})
    shared = play(env, 30)
    told = env.beliefs()
    assert told.t_s == 3.0
    last = shared[9]  # the last instant at which the keeper worked
    np.testing.assert_allclose(told.p_world[1], last.p_world[1] + 2.1 * last.v_world[1], atol=1e-12)
    assert not told.peers_known[:, 0].any() or told.t_s < 3.1
    env.close()
    again = make(failures={"schedule_s": {"camera_0": 1.0}})
    play(again, 110, target_start=0.05)  # on its way out of the first region
    others = np.flatnonzero(again.simulation.visible[:, 0])
    assert others.size  # the next region's camera has found it ...
    np.testing.assert_array_equal(
        again.beliefs().p_world[(others[0] + 1) % 4], again.beliefs().p_world[others[0]]
    )
    again.close()


def test_rounding_does_not_decide_who_is_still_a_neighbour() -> None:
    now, sent = 0.1 * np.arange(22, 3000), 0.1 * np.arange(2978)
    assert (now - sent > 2.2).any()
    assert heard_lately(now - sent, 0.2).all()
    assert not heard_lately(now[1:] - sent[:-1], 0.2).any()
