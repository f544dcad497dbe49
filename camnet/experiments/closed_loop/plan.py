"""Plans of an attack, as JSON and as vectors in [0, 1]^n that an optimiser can search.

A plan names everything that the attacker chooses: for each target its drive, the direction of the wind, and the seed of
noise and gusts. A plan and a world decide every figure of a flight.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from camnet.errors import DataError
from camnet.motion.planned import DrivePlan
from camnet.types import Array

__all__ = ["Plan", "PlanSpace"]

#: turns and speeds that a plan decides on; later ones repeat them
_TURNS, _SPEEDS = 12, 6
#: genes of a target: start, direction, offset, when and how long it stops, turns, speeds
_GENES = 5 + _TURNS + _SPEEDS
#: genes for all: wind direction, seed
_COMMON = 2
_SEEDS = 2**31


@dataclass(frozen=True, slots=True)
class Plan:
    """One attack: a drive for each target, the wind's direction (rad) and the seed of noise and gusts."""

    targets: tuple[DrivePlan, ...]
    wind_rad: float
    seed: int

    def as_dict(self) -> dict[str, Any]:
        """Return the plan as plain data for JSON."""
        return {"targets": [asdict(t) for t in self.targets], "wind_rad": self.wind_rad, "seed": self.seed}

    @classmethod
    def from_dict(cls, content: Any) -> Plan:  # noqa: ANN401 - read from a file
        """Read a plan back.

        Raises
        ------
        DataError
            Something is missing, unknown or no number.
        """
        try:
            drives = []
            for t in content["targets"]:
                lists = {k: tuple(float(x) for x in t[k]) for k in ("turns", "speeds")}
                drives.append(DrivePlan(**{**t, **lists}))
            return cls(tuple(drives), float(content["wind_rad"]), int(content["seed"]))
        except (KeyError, TypeError, ValueError) as error:
            raise DataError(
                f"plan: {error!r}: give targets, wind_rad and seed as --out writes them"
            ) from error


@dataclass(frozen=True, slots=True)
class PlanSpace:
    """All plans against a world.

    Attributes
    ----------
    targets : M
    duration_s : length of a flight, s
    stop_s : longest stop of the class, s
    pace : speed at the share 1 over the field's own, for targets on fields
    """

    targets: int
    duration_s: float
    stop_s: float = 0.0
    pace: float = 1.0

    @property
    def size(self) -> int:
        """Number of genes."""
        return _COMMON + _GENES * self.targets

    def random(self, count: int, rng: np.random.Generator) -> Array:
        """Return plans (count, n): half slow all the way, a quarter jumping between bounds, the rest free."""
        genes = rng.random((count, self.size))
        for k, row in enumerate(genes):
            speeds = self._rows(row)[:, -_SPEEDS:]
            if k % 4 in (0, 1):
                speeds[:] = 0.0
            elif k % 4 == 2:
                speeds[:] = np.round(speeds)
        return genes

    def plan(self, genes: Array) -> Plan:
        """Turn a vector (n,) into a plan."""
        row = np.clip(genes, 0.0, 1.0)
        drives = tuple(self._drive(part) for part in self._rows(row))
        return Plan(drives, float(2.0 * math.pi * row[0]), int(row[1] * (_SEEDS - 1)))

    def _rows(self, genes: Array) -> Array:
        return genes[_COMMON:].reshape(self.targets, _GENES)

    def _drive(self, part: Array) -> DrivePlan:
        start, forward, lateral, stop_at, stop = part[:5].tolist()
        turns = np.minimum(part[5 : 5 + _TURNS], 1.0 - 1e-9)
        return DrivePlan(
            start,
            forward < 0.5,
            2.0 * lateral - 1.0,
            tuple(turns.tolist()),
            tuple(part[-_SPEEDS:].tolist()),
            self.duration_s / _SPEEDS,
            stop_at * self.duration_s,
            stop * self.stop_s,
            self.pace,
        )
