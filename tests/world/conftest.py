"""Makes the helpers of this folder importable and closes every world that a test opens."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))


@pytest.fixture
def open_world():
    from world_parts import describe

    from camnet.world.pybullet import PyBulletWorld

    worlds = []

    def make(seed=0, description=None, **options):
        worlds.append(PyBulletWorld(description or describe(**options)))
        return worlds[-1], worlds[-1].reset(np.random.default_rng(seed))

    yield make
    for world in worlds:
        world.close()
