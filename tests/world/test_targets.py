"""Targets that are followed ahead, and such as cannot be."""

from __future__ import annotations

import numpy as np
import pytest
from rounding import assert_rounded_alike

from camnet.config.load import load_scenario
from camnet.motion.replay import ReplayMotion, TrackPath
from camnet.motion.track import Track
from camnet.simulation.network import build_network
from camnet.world.targets import Targets


@pytest.mark.parametrize("world", ["quickstart", "patrol", "pursuit"])
def test_targets_are_where_their_laws_step_them(world: str) -> None:
    network = build_network(load_scenario(world, ()))
    motions = [target.motion for target in network.description.targets]
    names = [target.name for target in network.description.targets]
    dt_s = 1.0 / 60.0
    targets = Targets(names, motions, dt_s)
    targets.reset([np.random.default_rng(k) for k in range(len(motions))])
    rngs = [np.random.default_rng(k) for k in range(len(motions))]
    states = [motion.reset(rng) for motion, rng in zip(motions, rngs, strict=True)]
    for step in range(200):
        t_s = step * dt_s
        states = [m.step(s, t_s, dt_s, g) for m, s, g in zip(motions, states, rngs, strict=True)]
        now = targets.advance(t_s, step)
    expected = [np.concatenate([s.p_world, s.q_world, s.v_world, s.w_body]) for s in states]
    assert_rounded_alike(now, np.array(expected), scale=10.0, steps=200)


def test_a_recorded_track_is_followed() -> None:
    t_s = np.arange(6.0)
    track = Track("walker", t_s, np.column_stack([t_s, np.sin(t_s), np.zeros(6)]))
    motion = ReplayMotion(TrackPath.of(track), 0.0, 0.05, 5.0, 3.0)
    targets = Targets(["walker"], [motion], 0.1)
    targets.reset([np.random.default_rng(0)])
    for step in range(30):
        now = targets.advance(0.1 * step, step)
    assert now[0, :3] == pytest.approx(motion.path.at(3.0)[0], abs=1e-12)
