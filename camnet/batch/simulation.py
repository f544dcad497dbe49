"""Many environments side by side: groups of them on threads, each environment by itself.

An environment's numbers depend on its seed and its actions alone: not on the others, the groups or the threads.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import accumulate
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from camnet.batch import frozen, frozen_motion, kalman, learning, oracle
from camnet.batch.estimator import allocate as allocate_estimator
from camnet.batch.estimator import build_setup
from camnet.batch.estimator import reset as reset_estimator
from camnet.batch.frozen_model import FrozenModel, frozen_state, reset_frozen, tabulate, warm_up
from camnet.batch.lane_layout import BLOCK
from camnet.batch.loop import DIVERGED
from camnet.batch.metrics import episode_of
from camnet.batch.network import MODELS, Model, Shown, pack_network
from camnet.batch.observe import NEIGHBOUR_FIELDS, OWN_FIELDS, TARGET_FIELDS
from camnet.batch.state import STATES, State, allocate, restart
from camnet.compiled import announce
from camnet.copies import ExactCopies
from camnet.errors import ConfigError, SimulationError
from camnet.geometry.pinned import call_compiled
from camnet.motion.protocol import TargetMotion
from camnet.simulation.network import Network
from camnet.types import Array, BoolArray, IntArray

__all__ = ["FILTERS", "BatchSimulation"]

#: what the agents may know comes from one of these
FILTERS = ("learned", "frozen", "ekf", "oracle")
#: environments that one call of the compiled loop takes, at most
_MOST = 1024
#: share of what is left that a thread takes next: half of what falls to it
_SHARE = 0.5


class _Estimators(Protocol):
    """Estimators of one group of environments."""

    def reset(self, state: State, e: int) -> None:
        """Forget everything about one environment."""

    def decide(self, *arguments: Any) -> None:  # noqa: ANN401 - the compiled driver's
        """Run environments through one decision."""


class _Kalman:
    def __init__(self, network: Network, model: Model, environments: int) -> None:
        self.rows = kalman.allocate_kalman(network.scenario.estimator.ekf, environments, network.n_targets)
        self.decide, self.pins = kalman.decide, kalman.KALMANS

    def reset(self, state: State, e: int) -> None:
        kalman.reset_kalman(self.rows, e)


class _Oracle:
    def __init__(self, network: Network, model: Model, environments: int) -> None:
        self.rows = oracle.allocate_oracle(model, environments)
        self.decide, self.pins = oracle.decide, oracle.ORACLES

    def reset(self, state: State, e: int) -> None:
        oracle.reset_oracle(self.rows, state, e)


class _Learning:
    def __init__(self, network: Network, model: Model, environments: int, duration_s: float) -> None:
        s, self._targets = network.scenario, network.n_targets
        setup = build_setup(
            s.estimator, network.basis, len(network.regions), s.sensing.rate_hz, network.bounds, s.roads
        )
        rows = allocate_estimator(setup, s.estimator, environments * self._targets, duration_s)
        self.rows = learning.Learning(setup, rows)
        self.decide, self.pins = learning.decide, learning.LEARNING

    def reset(self, state: State, e: int) -> None:
        for m in range(self._targets):
            reset_estimator(self.rows.setup, self.rows.rows, e * self._targets + m)


class _Frozen:
    def __init__(
        self, network: Network, held: FrozenModel, tables: tuple[Array, Array], environments: int
    ) -> None:
        self._held = held
        self.rows = frozen_state(network, held, *tables, environments)
        self.decide, self.pins = frozen.decide, frozen_motion.FROZEN

    def reset(self, state: State, e: int) -> None:
        reset_frozen(self.rows, self._held, e)


class _Group:
    """Environments ``first`` to ``first + count``, their state and their estimators."""

    def __init__(self, model: Model, first: int, count: int, estimators: Any) -> None:  # noqa: ANN401
        self.first, self.count = first, count
        self.model, self.state, self.estimators = model, allocate(model, count), estimators
        self.all = np.arange(count)
        self.pins = (MODELS.pin(model), STATES.pin(self.state), estimators.pins.pin(estimators.rows))


def _group_sizes(environments: int, threads: int) -> list[int]:
    """Environments in each group: for threads ever fewer, so that all are done at about the same time; whole blocks."""
    if threads == 1:
        return [min(_MOST, environments - first) for first in range(0, environments, _MOST)]
    sizes, left, least = [], environments, min(BLOCK, math.ceil(environments / threads))
    while left:
        sizes.append(min(_MOST, left, least * max(1, round(_SHARE * left / threads / least))))
        left -= sizes[-1]
    return sizes


class BatchSimulation(ExactCopies):
    """E environments of one network; copies go on like the original, on threads of their own.

    Parameters
    ----------
    network : the network, the same in all environments
    shown : how it is shown and rewarded
    environments : E
    filter_name : one of `FILTERS`
    held : the model of ``frozen`` (default: a warm-up, see `camnet.batch.frozen_model.warm_up`)
    threads : how many threads work (default: as many as there are processors to run on)
    duration_s : longest episode, s; bounds the memory of the learning estimators

    Raises
    ------
    ConfigError
        The network has something that this back end has not, or a parameter makes no sense.
    """

    def __init__(
        self,
        network: Network,
        shown: Shown,
        environments: int,
        filter_name: str = "frozen",
        held: FrozenModel | None = None,
        threads: int | None = None,
        duration_s: float = np.inf,
    ) -> None:
        if environments < 1:
            raise ConfigError(f"environments = {environments}: at least one is needed")
        if filter_name not in FILTERS:
            raise ConfigError(f"filter_name = {filter_name!r}: the batch back end has {', '.join(FILTERS)}")
        self.network, self.environments, self.filter_name = network, environments, filter_name
        self.model = pack_network(network, shown)
        self._sources = [network.own_poses[j] for j in sorted(network.own_poses)]
        if self._sources and filter_name != "ekf":
            raise ConfigError(
                f"filter_name = {filter_name!r}: where agents may lose their poses the batch back end has 'ekf'"
            )
        self.threads = max(1, threads or len(os.sched_getaffinity(0)))
        make = self._maker(held, duration_s)
        sizes = _group_sizes(environments, self.threads)
        self.groups = [
            _Group(self.model, last - count, count, make(count))
            for last, count in zip(accumulate(sizes), sizes, strict=True)
        ]
        self._pool = self._workers()
        self.observation_size = (
            OWN_FIELDS + TARGET_FIELDS * network.n_targets + NEIGHBOUR_FIELDS * self.model.neighbours
        )
        self.observations = np.zeros(
            (environments, network.n_agents, self.observation_size), dtype=np.float32
        )
        self.outcome = np.zeros((environments, 5))
        announce(self.groups[0].estimators.decide, f"the batch back end with estimator {filter_name!r}")

    def _workers(self) -> ThreadPoolExecutor | None:
        alone = self.threads == 1 or len(self.groups) == 1
        return None if alone else ThreadPoolExecutor(self.threads - 1)

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_pool": None}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._pool = self._workers()

    def _maker(self, held: FrozenModel | None, duration_s: float) -> Callable[[int], Any]:
        network, model = self.network, self.model
        if self.filter_name == "ekf":
            return lambda count: _Kalman(network, model, count)
        if self.filter_name == "oracle":
            return lambda count: _Oracle(network, model, count)
        if self.filter_name == "learned":
            return lambda count: _Learning(network, model, count, duration_s)
        chosen = held if held is not None else warm_up(network)
        tables = tabulate(chosen, network.bounds)
        return lambda count: _Frozen(network, chosen, tables, count)

    def reset(
        self,
        chosen: IntArray,
        seeds: Sequence[int],
        motions: Sequence[Sequence[TargetMotion]] | None = None,
        winds: Array | None = None,
    ) -> None:
        """Start the ``chosen`` environments anew, each by its seed, and show what is seen there.

        ``motions`` are the targets' in each of them, of the same laws as the network's; ``winds`` (K, 3) in m/s.
        """
        own = [target.motion for target in self.network.description.targets]
        place = {e: k for k, e in enumerate(chosen.tolist())}
        self.observations = self.observations.copy()  # whoever has the old ones may keep them
        seed_of = dict(zip(chosen.tolist(), seeds, strict=True))

        def start(group: _Group) -> None:
            rows = chosen[(chosen >= group.first) & (chosen < group.first + group.count)] - group.first
            if not rows.size:
                return
            for e in rows.tolist():
                k = place[group.first + e]
                laws = own if motions is None else motions[k]
                wind = None if winds is None else winds[k]
                seed = seed_of[group.first + e]
                restart(group.model, laws, group.state, e, seed, wind, self._sources)
                group.estimators.reset(group.state, e)
            self._decide(group, rows, True, np.zeros((group.count, 0, 5)))
            for a, j in enumerate(
                sorted(self.network.own_poses)
            ):  # references begin where agents believe to be
                group.state.motion[rows, j, :2] = group.state.own_x[rows, a, :2]

        self._each(start)

    def step(self, actions: NDArray[Any]) -> None:
        """Run all environments through one decision with ``actions`` (E, N, 5); results are in the arrays.

        ``observations`` are another array from step to step: what was handed out stays as it is.

        Raises
        ------
        SimulationError
            A body's state is not finite or has left the domain; the message names the environment.
        """
        flat = np.require(actions, np.float64, ["C", "W"])  # a copy if read-only: one compiled form
        self.observations = np.empty_like(self.observations)
        self._each(lambda g: self._decide(g, g.all, False, flat[g.first : g.first + g.count]))
        if self.outcome[:, DIVERGED].any():
            e = int(np.argmax(self.outcome[:, DIVERGED]))
            raise SimulationError(f"environment {e}: an agent diverged (not finite, too fast or too far)")

    def _decide(self, group: _Group, rows: IntArray, fresh: bool, actions: Array) -> None:
        place = slice(group.first, group.first + group.count)
        model, state, estimators = group.pins
        call_compiled(
            group.estimators.decide,
            model.at,
            state.at,
            estimators.at,
            rows,
            fresh,
            actions,
            self.observations[place],
            self.outcome[place],
        )

    def _each(self, work: Callable[[_Group], None]) -> None:
        left = iter(self.groups)

        def labour() -> None:
            for group in left:  # whoever is free takes the next
                work(group)

        others = [self._pool.submit(labour) for _ in range(self.threads - 1)] if self._pool else []
        try:
            labour()
        finally:
            for other in others:
                other.result()

    def set_working(self, alive: BoolArray) -> None:
        """Let the cameras of those agents work that ``alive`` (E, N) says; a new episode begins with all of them."""
        for group in self.groups:
            group.state.working[:, : alive.shape[1]] = alive[group.first : group.first + group.count]

    def gather(self, name: str) -> NDArray[Any]:
        """One array of `State` over all environments (a copy)."""
        return np.concatenate([getattr(group.state, name) for group in self.groups])

    def episode(self, e: int) -> dict[str, Any]:
        """Figures of the episode so far of environment ``e``: those of `RunStatistics.episode`."""
        group = next(g for g in self.groups if g.first <= e < g.first + g.count)
        return episode_of(group.state, e - group.first)

    def believed(self) -> Array:
        """Where the agents' cameras are (E, N, 3), m, as their agents believe."""
        p_world = self.gather("cameras")[:, : self.network.n_agents, :3].copy()
        p_world[:, sorted(self.network.own_poses), :2] = self.gather("own_x")[..., :2]
        return np.asarray(p_world)

    def clock(self, e: int) -> Array:
        """Counters (4,) of environment ``e``: control periods, decisions, next plan (s), return so far."""
        group = next(g for g in self.groups if g.first <= e < g.first + g.count)
        return np.asarray(group.state.clock[e - group.first])

    def close(self) -> None:
        """End the threads."""
        if self._pool is not None:
            self._pool.shutdown()
