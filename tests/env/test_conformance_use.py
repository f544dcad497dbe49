"""The checks of use pass on the environment and find what they are for."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from camnet.env import conformance, handoff_v0

_KEPT: list[Any] = []


def short(**options: Any) -> handoff_v0.HandoffEnv:
    return handoff_v0.parallel_env(**{"max_cycles": 30, **options})


class Forgetful(handoff_v0.HandoffEnv):
    """Its copies begin anew."""

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self.reset(seed=99)


class Tolerant(handoff_v0.HandoffEnv):
    """Takes whatever it gets as standing still."""

    def step(self, actions: Any) -> Any:
        return super().step(dict.fromkeys(self.agents, np.zeros(5, dtype=np.float32)))

    def reset(self, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        return super().reset(seed=seed)


def kept() -> handoff_v0.HandoffEnv:
    env = short()
    _KEPT.append(env)
    return env


@pytest.mark.parametrize("mode", ["setpoint", "assign"])
def test_the_environment_passes(mode: str) -> None:
    conformance.check_copies(lambda: short(action_mode=mode))
    conformance.check_misuse(lambda: short(action_mode=mode))
    conformance.check_options(short)
    conformance.check_release(short)


def test_faults_are_found() -> None:
    with pytest.raises(conformance.ConformanceError, match="goes on otherwise"):
        conformance.check_copies(lambda: Forgetful(max_cycles=30))
    with pytest.raises(conformance.ConformanceError, match="an action for nobody is accepted"):
        conformance.check_misuse(lambda: Tolerant(max_cycles=30))
    with pytest.raises(conformance.ConformanceError, match="an unknown option is accepted"):
        conformance.check_options(lambda: Tolerant(max_cycles=30))
    with pytest.raises(conformance.ConformanceError, match="still open"):
        conformance.check_release(kept)
    _KEPT.pop().close()
