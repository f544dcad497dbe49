"""Compile everything that the commands and the environment need, once and visibly, before the first real run.

Every workload is a small real use: what it calls is compiled and kept (`camnet.compiled`). Nothing here lists kernels,
so nothing can be forgotten in a list; a test runs the commands afterwards and counts what is still compiled: nothing.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any

import numpy as np
from numba.core import event as _event

from camnet.agents import AGENTS
from camnet.compiled import store
from camnet.config.load import load_scenario
from camnet.config.models import Scenario
from camnet.env import handoff_v0
from camnet.env.batch_handoff import BatchHandoff
from camnet.env.presets import PRESETS
from camnet.evaluation.play import Match, play
from camnet.evaluation.play_batch import can_play_together, play_together
from camnet.experiments.certify_world import certify_world
from camnet.experiments.learned_model import learn_models
from camnet.simulation.filters import FILTERS
from camnet.simulation.run import run_network
from camnet.worlds import describe, names

__all__ = ["GROUPS", "Done", "Workload", "warm_up", "workloads"]

#: numba has no types for its inside
event: Any = _event
#: what can be asked for, in the order of compilation
GROUPS = ("quickstart", "simulate", "environment", "evaluate", "train", "certify")
#: code that was not used for so long goes
_KEPT_DAYS = 60.0
_SEED = 1


@dataclass(frozen=True, slots=True)
class Workload:
    """One small use of one part."""

    group: str
    name: str
    run: Callable[[], object]


@dataclass(frozen=True, slots=True)
class Done:
    """What a workload took: functions compiled for it, and wall time in s."""

    group: str
    name: str
    compiled: int
    wall_s: float

    def as_dict(self) -> dict[str, Any]:
        """Return the fields."""
        return asdict(self)


def workloads(groups: Sequence[str] = GROUPS) -> list[Workload]:
    """Return the workloads of some groups, in the order of `GROUPS`."""
    makers = {
        "quickstart": _quickstart,
        "simulate": _simulations,
        "environment": _environments,
        "evaluate": _evaluations,
        "train": _trainings,
        "certify": _certificates,
    }
    return [
        Workload(group, name, run) for group in GROUPS if group in groups for name, run in makers[group]()
    ]


def warm_up(
    groups: Sequence[str] = GROUPS, progress: Callable[[int, int, str], None] | None = None
) -> Iterator[Done]:
    """Run workloads one after another; yields what each took.

    Parameters
    ----------
    groups : some of `GROUPS`
    progress : called with workloads done, their number, and what is at work

    Raises
    ------
    KeyboardInterrupt
        It was interrupted; what was compiled until then is kept.
    """
    store.sweep()
    store.prune(_KEPT_DAYS)
    todo = workloads(groups)
    for k, workload in enumerate(todo):
        start = time.perf_counter()
        with _watched(partial(_tell_function, progress, k, len(todo), workload.name)) as count:
            _tell(progress, k, len(todo), workload.name)
            workload.run()
        yield Done(workload.group, workload.name, count[0], time.perf_counter() - start)
    _tell(progress, len(todo), len(todo), "")


def _tell(progress: Callable[[int, int, str], None] | None, done: int, total: int, words: str) -> None:
    if progress is not None:
        progress(done, total, words)


def _tell_function(
    progress: Callable[[int, int, str], None] | None, done: int, total: int, workload: str, function: str
) -> None:
    _tell(progress, done, total, f"{workload}: {function}")


@contextmanager
def _watched(begin: Callable[[str], None]) -> Iterator[list[int]]:
    """Count compilations, and call ``begin`` with the name of every function before it is compiled."""
    count = [0]

    class Listener(event.Listener):  # type: ignore[misc]
        def on_start(self, event: Any) -> None:  # noqa: ANN401
            count[0] += 1
            begin(event.data["dispatcher"].py_func.__name__)

        def on_end(self, event: Any) -> None:  # noqa: ANN401
            pass

    with event.install_listener("numba:compile", Listener()):
        yield count


def _simulate(world: str, seconds: float, filters: tuple[str, ...] | None = None) -> None:
    scenario = load_scenario(world)
    assert isinstance(scenario, Scenario)
    run = scenario.run.model_copy(update={"duration_s": seconds})
    if run_network(scenario.model_copy(update={"run": run}), _SEED, filters).interrupted:
        raise KeyboardInterrupt


def _quickstart() -> Iterator[tuple[str, Callable[[], object]]]:
    # long enough that the target is lost and met again, and every part of a run has had its turn
    yield "simulate quickstart", partial(_simulate, "quickstart", 30.0)


def _simulations() -> Iterator[tuple[str, Callable[[], object]]]:
    others = [name for name in names() if name != "quickstart" and describe(name).kind != "recorded"]
    for name in others:
        yield f"simulate {name}", partial(_simulate, name, 20.0)
    yield "simulate all estimators", partial(_simulate, "quickstart", 30.0, FILTERS)


def _environments() -> Iterator[tuple[str, Callable[[], object]]]:
    for agent in AGENTS:
        yield f"environment {agent}", partial(_play, Match(agent, "quickstart", 400))
    for preset in PRESETS:
        yield f"environment {preset}", partial(_act, preset)
    for mode in ("velocity", "assign"):
        yield f"environment {mode}", partial(_act, "quickstart", action_mode=mode)
    yield "environment dictionary", partial(_act, "quickstart", observation_form="dict")


def _play(match: Match) -> None:
    for _ in play(match, [_SEED]):
        pass


def _act(world: str, **options: Any) -> None:  # noqa: ANN401 - fields of EnvSettings
    """Act at random for a while."""
    env = handoff_v0.parallel_env(world=world, max_cycles=100, **options)
    try:
        env.reset(seed=_SEED)
        for agent in env.possible_agents:
            env.action_space(agent).seed(_SEED)
        while env.agents:
            env.step({agent: env.action_space(agent).sample() for agent in env.agents})
    finally:
        env.close()


def _evaluations() -> Iterator[tuple[str, Callable[[], object]]]:
    for world in PRESETS:
        for agent in AGENTS:
            match = Match(agent, world, 200)
            if can_play_together(match):
                yield f"evaluate {agent} on {world}", partial(play_together, match, [_SEED, 2])


def _trainings() -> Iterator[tuple[str, Callable[[], object]]]:
    for name in ("learned", "frozen", "ekf", "oracle"):
        yield f"train on {name}", partial(_step, name)


def _step(name: str) -> None:
    """Step environments that start episodes by themselves, on two threads."""
    env = BatchHandoff("quickstart", environments=32, filter_name=name, threads=2, max_cycles=150)
    try:
        env.reset(seed=_SEED)
        action = np.zeros((32, env.n_agents, 5))
        for _ in range(300):
            env.step(action)
    finally:
        env.close()


def _certificates() -> Iterator[tuple[str, Callable[[], object]]]:
    for name in ("quickstart", "stationary_certified", "mobile_certified", "patrol"):
        yield f"certify {name}", partial(_certify, name)
    # a lap and a bit, so that the target comes back to a view
    yield "certify mobile_certified --learn", partial(_certify, "mobile_certified", 80.0)


def _certify(world: str, learn_s: float | None = None) -> None:
    scenario = load_scenario(world)
    assert isinstance(scenario, Scenario)
    model = None if learn_s is None else learn_models(scenario, learn_s, _SEED)
    certify_world(scenario, model)
