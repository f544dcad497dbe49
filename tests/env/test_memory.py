"""Long use of PyBullet environments takes no more memory, and dropped ones free their client."""

from __future__ import annotations

import gc
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from camnet.env import handoff_v0
from camnet.world.pybullet import open_clients

#: growth that counts as flat
LIMIT_BYTES = 50 * 2**20
RESETS, STEPS, DROPPED = 2_000, 20_000, 100


def resident_bytes() -> int:
    gc.collect()
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE")


def play(env: Any, cycles: int, rng: np.random.Generator) -> None:
    """Act at random; start anew where an episode ends."""
    env.reset(seed=int(rng.integers(2**31)))
    for _ in range(cycles):
        if not env.agents:
            env.reset(seed=int(rng.integers(2**31)))
        actions = {}
        for name in env.agents:
            space = env.action_space(name)
            actions[name] = rng.uniform(space.low, space.high).astype(space.dtype)
        env.step(actions)


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="reads Linux's /proc")
def test_memory_stays_flat_and_no_client_is_left(record_property: Callable[[str, object], None]) -> None:
    rng, before = np.random.default_rng(1), open_clients()
    env = handoff_v0.parallel_env(max_cycles=500)
    play(env, 1_000, rng)
    for seed in range(100):
        env.reset(seed=seed)
    start = resident_bytes()
    for seed in range(RESETS):
        env.reset(seed=seed)
    after_resets = resident_bytes()
    play(env, STEPS, rng)
    after_steps = resident_bytes()
    env.close()
    for seed in range(DROPPED):
        dropped = handoff_v0.parallel_env(max_cycles=50)
        dropped.reset(seed=seed)
        del dropped  # without close
    after_dropped = resident_bytes()
    growth = [round((m - start) / 2**20, 1) for m in (after_resets, after_steps, after_dropped)]
    record_property("growth_mib", str(growth))  # shown by --junit-xml
    assert max(after_resets, after_steps, after_dropped) - start < LIMIT_BYTES, growth
    assert open_clients() == before
