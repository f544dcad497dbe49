"""Read a run folder back: settings, figures, handoffs and the log."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from camnet.errors import DataError
from camnet.simulation.network import Network, build_network
from camnet.simulation.run_files import read_run
from camnet.types import Array, BoolArray

__all__ = ["RunData", "load_run", "spans"]


@dataclass(frozen=True, eq=False)
class RunData:
    """One run.

    Attributes
    ----------
    folder : where it lies
    network : the scenario with its geometry built
    summary : content of ``summary.json``
    handoffs : content of ``handoffs.json``
    columns : the log, name -> (rows,)
    events : the table of events; None: the run is from before there was one
    """

    folder: Path
    network: Network
    summary: dict[str, Any]
    handoffs: list[dict[str, Any]]
    columns: Mapping[str, Array]
    events: list[dict[str, Any]] | None

    @property
    def t_s(self) -> Array:
        """Times of the log's rows, (rows,), s."""
        return self.columns["t_s"]

    def vector(self, who: str, what: str = "p", unit: str = "m") -> Array:
        """Return the logged vector of ``who``, (rows, 3)."""
        return np.stack([self.columns[f"{who}.{what}_{axis}_{unit}"] for axis in "xyz"], axis=1)

    def quaternion(self, who: str, what: str = "q") -> Array:
        """Return the logged quaternion of ``who``, (rows, 4), scalar first."""
        return np.stack([self.columns[f"{who}.{what}_{axis}"] for axis in "wxyz"], axis=1)

    @property
    def targets(self) -> tuple[str, ...]:
        """Names of the targets."""
        return tuple(target.name for target in self.network.scenario.targets)

    @property
    def agents(self) -> tuple[str, ...]:
        """Names of the agents."""
        return tuple(agent.name for agent in self.network.scenario.agents)

    @property
    def filters(self) -> tuple[str, ...]:
        """Names of the estimators in the log, the driving one first."""
        prefix, suffix = f"{self.targets[0]}.", ".radius_m"
        return tuple(
            c[len(prefix) : -len(suffix)] for c in self.columns if c.startswith(prefix) and c.endswith(suffix)
        )


def load_run(folder: Path) -> RunData:
    """Read a run folder.

    Raises
    ------
    DataError
        The folder is not that of a run; the message names the file that is missing or broken.
    """
    if not folder.is_dir():
        raise DataError(f"{folder}: is no folder; the folder of a run was expected")
    files = read_run(folder)
    network = build_network(files.scenario)
    return RunData(folder, network, files.content["summary"], files.handoffs, files.columns, files.events)


def spans(t_s: Array, mask: BoolArray) -> list[tuple[float, float]]:
    """Intervals (start, end) of ``t_s`` in which ``mask`` holds."""
    edges = np.diff(np.concatenate([[0], mask.astype(int), [0]]))
    starts, ends = np.flatnonzero(edges == 1).tolist(), (np.flatnonzero(edges == -1) - 1).tolist()
    return [(float(t_s[a]), float(t_s[min(b + 1, len(t_s) - 1)])) for a, b in zip(starts, ends, strict=True)]
