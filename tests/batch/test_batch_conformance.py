"""Every registered environment conforms in the batch form; the checks find what is wrong."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from camnet.env import PRESETS
from camnet.env.batch_handoff import BatchHandoff, BatchStep
from camnet.env.conformance import ConformanceError, check_batch


def maker(name: str, **options: Any) -> Callable[[int, int], BatchHandoff]:
    return lambda environments, threads: BatchHandoff(name, environments, threads=threads, **options)


@pytest.mark.parametrize("name", PRESETS)
def test_every_registered_environment_conforms(name: str) -> None:
    failures = {"failures": {"rate_per_s": 4.0}} if "Failures" in name else {}
    # where nobody is in view at the start, two seeds differ in the air alone
    air = {"overrides": ("physics.wind.gust_std_mps=0.3",)} if name.endswith("-v1") else {}
    check_batch(maker(name, filter_name="ekf", max_cycles=3, **air, **failures), cycles=5)


@pytest.mark.slow
@pytest.mark.parametrize("name", PRESETS)
@pytest.mark.parametrize("mode", ["setpoint", "assign"])
@pytest.mark.parametrize("filter_name", ["ekf", "learned", "frozen", "oracle"])
def test_every_registered_environment_conforms_over_whole_episodes(
    name: str, mode: str, filter_name: str
) -> None:
    failures = {"failures": {"rate_per_s": 0.5}} if "Failures" in name else {}
    # the truth has no noise: in still air two seeds may rightly give one episode
    air = {"overrides": ("physics.wind.gust_std_mps=0.3",)} if filter_name == "oracle" else {}
    make = maker(name, filter_name=filter_name, max_cycles=40, action_mode=mode, **air, **failures)
    check_batch(make, cycles=60)


class Broken(BatchHandoff):
    """An environment with a fault of choice."""

    fault = ""

    def step(self, actions: np.ndarray) -> BatchStep:
        step = super().step(actions)
        if self.fault == "a number beyond its bounds":
            step.observations[0, 0, 3] = 4.0
        if self.fault == "the number of environments matters":
            step.last[..., 0] = 0.1 * self.environments
        if self.fault == "an end without figures":
            step.finished.clear()
        return step


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ("a number beyond its bounds", r"own.velocity of agent 0 in environment 0 is 4.0"),
        ("the number of environments matters", "observations of one seed differ alone"),
        ("an end without figures", r"figures for \[\], ended are \[0 1 2\]"),
    ],
)
def test_the_checks_find_faults(fault: str, words: str) -> None:
    def make(environments: int, threads: int) -> Broken:
        env = Broken("quickstart", environments, threads=threads, filter_name="ekf", max_cycles=2)
        env.fault = fault
        return env

    with pytest.raises(ConformanceError, match=words):
        check_batch(make, cycles=3)
