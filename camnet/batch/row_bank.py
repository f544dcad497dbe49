"""The learning estimators of one network in rows of arrays, for a loop that goes through one environment.

`RowFilter` is a `TargetFilter`; `camnet.estimation.learning_estimator.LearningEstimator` is its oracle, and what runs
where a setting asks for something that rows have not. What a sensing instant brings to all of them is one compiled call
(`camnet.batch.row_kernel`), where the loop lets it: no sight line to be asked for, and measurements without delay.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from camnet.batch.estimator import ESTIMATE, EstimatorState, allocate, build_setup
from camnet.batch.estimator_columns import FORGOTTEN, GAPS_LEARNED, OUTLIERS, TURNS, WINDOWS, T
from camnet.batch.estimator_parts import counts_of
from camnet.batch.estimator_setup import EstimatorSetup
from camnet.batch.estimator_transfer import learned_weights
from camnet.batch.row_excitation import RowExcitation
from camnet.batch.row_kernel import (
    BANK,
    CAMERA,
    ERROR,
    MISS,
    OFFERED,
    REGION_COLUMN,
    TURN,
    Bank,
    advance_row,
    perceive,
    reset_row,
    rollout_row,
)
from camnet.compiled import announce
from camnet.copies import ExactCopies
from camnet.errors import ConfigError
from camnet.estimation.observation import measured_world_pose
from camnet.estimation.propagate import TWIST_OUTPUTS
from camnet.estimation.protocol import Rollout
from camnet.sensing.pose_sensor import PoseSensor
from camnet.sensing.survey import Lookout, Survey
from camnet.simulation.filters import TargetTruth
from camnet.simulation.network import Network
from camnet.simulation.perception import Perceived
from camnet.types import Array, BoolArray, IntArray, PoseMeasurement, Snapshot, TargetEstimate

__all__ = ["RowBank", "RowFilter", "RowFilters", "rows_can"]


#: where an estimate's fields begin in a row of ``out``
_P, _Q, _V, _W, _SEEN, _LAST_SEEN, _RADIUS = (first for first, _ in ESTIMATE.values())


def rows_can(network: Network) -> bool:
    """Whether rows have all that a network's estimator settings ask for."""
    scenario = network.scenario
    if scenario.run.model is not None or scenario.sensing.latency_s > 0.0:
        return False
    try:
        _setup(network)
    except ConfigError:
        return False
    return True


class RowFilters:
    """Makes estimators ``learned`` of all targets, as new, in the same rows each time: a `loop.FilterMaker`."""

    def __init__(self) -> None:
        self._bank: RowBank | None = None

    def __call__(self, network: Network, truths: Sequence[TargetTruth]) -> list[RowFilter]:
        """Return them; those of an earlier call are of no use any more."""
        if self._bank is None:
            announce(perceive, "the environment's estimators")
            self._bank = RowBank(network, len(truths))
        else:
            self._bank.restart()
        return [RowFilter(self._bank, m) for m in range(len(truths))]


def _setup(network: Network) -> EstimatorSetup:
    scenario = network.scenario
    rate_hz, regions = scenario.sensing.rate_hz, len(network.regions)
    return build_setup(scenario.estimator, network.basis, regions, rate_hz, network.bounds, scenario.roads)


class RowBank(ExactCopies):
    """Estimators of M targets, each a row, each as new.

    Parameters
    ----------
    network : whose estimator settings, kernels, roads and regions hold
    targets : M
    """

    def __init__(self, network: Network, targets: int) -> None:
        settings = network.scenario.estimator
        self.setup, self.regions, self._stack = _setup(network), len(network.regions), settings.stack
        self.state: EstimatorState = allocate(self.setup, settings, targets)
        self.out, self.found = np.zeros((targets, REGION_COLUMN + 1)), np.zeros((targets, TURN + 1))
        self.world = np.zeros((targets, 7))
        self._seers: IntArray = np.zeros(2, dtype=np.int64)
        self._connected: tuple[Lookout, PoseSensor] | None = None
        self.pinned = BANK.pin(Bank(self.setup, self.state, self._seers, self.world, self.found, self.out))
        self.restart()

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        if self._connected is not None:  # the copies of lookout and sensor are elsewhere
            self.connect(*self._connected)

    def restart(self) -> None:
        """Make all rows as new."""
        for m in range(len(self.out)):
            reset_row(self.pinned.at, m)
        setup, state, models = self.setup, self.state, range(self.setup.rules.models)
        self.excitation = [
            [RowExcitation(setup, state, m, j, self._stack) for j in models] for m in range(len(self.out))
        ]
        self.known = [_Known() for _ in range(len(self.out))]
        self._connected = None

    def connect(self, lookout: Lookout, sensor: PoseSensor) -> None:
        """Take over looking and measuring."""
        self._connected = lookout, sensor
        self._seers[:] = lookout.at, sensor.at

    def perceive(
        self, now: Snapshot, exceptions: BoolArray, working: BoolArray, rng: np.random.Generator
    ) -> Perceived:
        """See `camnet.simulation.perception.Perceiver`."""
        if self._connected is None:
            raise ConfigError("perceive: nothing to look with; connect first")
        lookout, sensor = self._connected
        sensor.draw(rng)
        spacing_m = perceive(
            self.pinned.at,
            now.t_s,
            now.agent_p_world,
            now.camera_p_world,
            now.camera_q_world,
            now.target_p_world,
            now.target_q_world,
            exceptions,
            working,
        )
        found = self.found.tolist()
        for m, row in enumerate(found):
            self.moved(m)
            if row[OFFERED]:
                self._excite(m, now.t_s, int(row[CAMERA]))
        survey: Survey = lookout.found(spacing_m)
        known = [one.seen for one in self.known]
        return Perceived(
            survey,
            [int(row[CAMERA]) for row in found],
            [row[MISS] for row in found],
            [(row[ERROR], row[TURN]) if there else None for row, there in zip(found, known, strict=True)],
        )

    def moved(self, m: int) -> None:
        """Take note that a row has moved on."""
        known = self.known[m]
        known.estimate = None
        if not known.seen:
            known.seen = math.isfinite(self.out[m, _LAST_SEEN])

    def _excite(self, m: int, t_s: float, camera: int) -> None:
        """Take note that a measured window was offered."""
        j = 0 if self.setup.rules.models == 1 else camera
        self.excitation[m][j].offered(t_s, self.setup.rules.work.offered)

    def advance(self, m: int, t_s: float, camera: int) -> None:
        """Advance one row, with its pose in ``world`` measured by ``camera``, or without a measurement (-1)."""
        self.found[m, CAMERA] = camera
        advance_row(self.pinned.at, m, t_s)
        if self.found[m, OFFERED]:
            self._excite(m, t_s, camera)


class _Known:
    """What is known of a row: whether its target was ever seen, and the estimate, once somebody asked for it."""

    def __init__(self) -> None:
        self.seen = False
        self.estimate: TargetEstimate | None = None


class RowFilter(ExactCopies):
    """The learning estimator of one target, in a row of a bank; see ``TargetFilter``."""

    name = "learned"

    def __init__(self, bank: RowBank, m: int) -> None:
        self.bank, self._m = bank, m
        self._known = bank.known[m]
        self._out, self._pose = bank.out[m], bank.state.pose[m]
        self._path: Array = np.empty((0, 8))

    @property
    def estimate(self) -> TargetEstimate:
        """See ``TargetFilter.estimate``."""
        if self._known.estimate is None:
            out = self._out.copy()
            self._known.estimate = TargetEstimate(
                t_s=float(self._pose[T]),
                p_world=out[_P : _P + 3],
                q_world=out[_Q : _Q + 4],
                v_world=out[_V : _V + 3],
                w_body=out[_W : _W + 3],
                seen=out[_SEEN] > 0.0,
                last_seen_s=float(out[_LAST_SEEN]),
                region=int(out[REGION_COLUMN]),
                radius_m=float(out[_RADIUS]),
            )
        return self._known.estimate

    def advance(self, t_s: float, camera: int = -1) -> None:
        """Advance the row."""
        self.bank.advance(self._m, t_s, camera)
        self.bank.moved(self._m)

    def correct(self, measurement: PoseMeasurement, region: int) -> None:
        """See ``TargetFilter.correct``.

        Raises
        ------
        ConfigError, DataError
            If the region does not exist or the measurement is not finite.
        """
        if not 0 <= region < self.bank.regions:
            raise ConfigError(f"region {region}: expected 0 ... {self.bank.regions - 1}")
        p, q = measured_world_pose(measurement)
        self.bank.world[self._m, :3], self.bank.world[self._m, 3:] = p, q
        self.advance(measurement.t_s, region)

    def predict(self, t_s: float) -> None:
        """See ``TargetFilter.predict``."""
        self.advance(t_s)

    def rollout(self, horizon_s: float, dt_s: float) -> Rollout:
        """See ``TargetFilter.rollout``."""
        if not (horizon_s > 0.0 and dt_s > 0.0):
            raise ConfigError(f"rollout: horizon_s {horizon_s}, dt_s {dt_s}: both must be positive")
        count = max(1, round(horizon_s / dt_s))
        if len(self._path) != count:
            self._path = np.empty((count, 8))
        rollout_row(self.bank.pinned.at, self._m, dt_s, self._path)
        t_s = float(self._pose[T]) + dt_s * np.arange(1, count + 1, dtype=np.float64)
        path = self._path
        return Rollout(t_s, path[:, :3].copy(), path[:, 3:7].copy(), path[:, 7].copy())

    def excitation(self, region: int) -> tuple[float, float]:
        """See `camnet.estimation.protocol.Learns`."""
        one = self._excitation_of(region)
        return one.full_s, one.visited_s

    def weight_norm(self, region: int) -> float:
        """See `camnet.estimation.protocol.Learns`."""
        bank = self.bank
        j = 0 if bank.setup.rules.models == 1 else region
        return float(np.linalg.norm(learned_weights(bank.setup, bank.state, self._m)[j, :, :TWIST_OUTPUTS]))

    def _excitation_of(self, region: int) -> RowExcitation:
        models = self.bank.excitation[self._m]
        return models[0 if len(models) == 1 else region]

    def diagnostics(self) -> dict[str, float]:
        """Count of gaps learned, and for each model j what it holds; names as in `LearningEstimator.diagnostics`."""
        bank, flags = self.bank, self.bank.state.flags[self._m]
        out = {
            "gaps_learned": float(flags[GAPS_LEARNED]),
            "prior_on_roads": float(len(bank.setup.roads.segments) > 0),
        }
        for j, excitation in enumerate(bank.excitation[self._m]):
            counts = counts_of.py_func(bank.setup.rules, flags, j)
            since = min(excitation.full_s, excitation.visited_s)
            figures = {
                "stack_size": counts[WINDOWS],
                "excited": math.isfinite(since),
                "excited_s": since,
                "weight_norm": self.weight_norm(j),
                "outliers": counts[OUTLIERS],
                "changes": counts[TURNS],
                "forgotten": counts[FORGOTTEN],
            }
            out.update({f"{name}_{j}": float(value) for name, value in figures.items()})
        return out
