"""What becomes of agents' own poses in a run: errors in outages, beside what certificates say of them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from camnet.sensing.own_pose_settings import ErrorBounds
from camnet.simulation.network import Network
from camnet.simulation.own_pose import OwnPoses, OwnResiduals

__all__ = ["MARKS_S", "OutageMonitor", "OutageRecord"]

#: the error is noted so long into an outage, s
MARKS_S = (10.0, 30.0, 60.0)
_SAME_S = 1e-6


@dataclass(slots=True)
class OutageRecord:
    """One outage of one agent: its times, s, errors of its position, m, and whether they passed what was certified.

    ``marks`` are errors at `MARKS_S` into it; ``bound_m`` is e(T), ``likely_m`` its 95 % version, for the time that it
    lasted. ``began`` are the errors that it began with, as shares of the bounds that were stated of them.
    """

    agent: str
    begin_s: float
    end_s: float
    marks: dict[str, float]
    began: dict[str, float]
    end_m: float = 0.0
    largest_m: float = 0.0
    passed: bool = False
    bound_m: float = 0.0
    likely_m: float = 0.0

    @property
    def premise_broken(self) -> bool:
        """Whether it began with an error beyond what was stated."""
        return max(self.began.values()) > 1.0

    def as_dict(self) -> dict[str, Any]:
        """Return the record as plain data."""
        return {
            "agent": self.agent,
            "begin_s": self.begin_s,
            "end_s": self.end_s,
            "error_m": {**self.marks, "end": self.end_m, "largest": self.largest_m},
            "bound_m": self.bound_m,
            "likely_m": self.likely_m,
            "began_as_share_of_stated": self.began,
            "premise_broken": self.premise_broken,
            "violated": self.passed,
            "likely_violated": self.largest_m > self.likely_m,
        }


def stated_shares(residuals: OwnResiduals, stated: ErrorBounds) -> dict[str, float]:
    """Return errors as shares of what was stated of them (0 of 0 is 0)."""
    return {
        name: 0.0 if error == 0.0 else abs(error) / max(getattr(stated, name), 1e-12)
        for name, error in residuals._asdict().items()
    }


class OutageMonitor:
    """Follows all outages of a network's agents; fed at every sensing instant."""

    def __init__(self, network: Network) -> None:
        self._network = network
        self._names = [agent.name for agent in network.scenario.agents]
        self._open: dict[int, OutageRecord] = {}
        self.records: list[OutageRecord] = []

    def watch(self, t_s: float, own: OwnPoses) -> None:
        """Note the errors at ``t_s``; an error beyond e(t) at any time is a violation."""
        for j in own.agents:
            if not own.lost[j]:
                self._open.pop(j, None)
                continue
            record = self._open.get(j)
            if record is None:
                began = stated_shares(own.residuals(j), self._network.outages[j].bounds)
                record = OutageRecord(self._names[j], float(own.lost_since_s[j]), t_s, {}, began)
                self._open[j] = record
                self.records.append(record)
            self._note(record, j, t_s, float(own.error_m[j]))

    def _note(self, record: OutageRecord, j: int, t_s: float, error_m: float) -> None:
        bounds, since = self._network.outages[j], t_s - record.begin_s
        record.end_s, record.end_m = t_s, error_m
        record.largest_m = max(record.largest_m, error_m)
        record.bound_m, record.likely_m = bounds.error_m(since), bounds.likely_error_m(since)
        record.passed = record.passed or error_m > record.bound_m
        for mark in MARKS_S:
            # the last instant before a mark stands for it
            if since <= mark + _SAME_S and math.isclose(since, mark, abs_tol=1.5 * self._sensing_s):
                record.marks[f"{mark:g}"] = error_m

    @property
    def _sensing_s(self) -> float:
        return 1.0 / self._network.scenario.sensing.rate_hz

    def summary(self) -> dict[str, Any]:
        """Figures of the run, ready for JSON."""
        return {
            "outages": [r.as_dict() for r in self.records],
            "violations": sum(r.passed for r in self.records),
            "premises_broken": sum(r.premise_broken for r in self.records),
            "likely_violations": sum(r.largest_m > r.likely_m for r in self.records),
            "budgets": {
                self._names[j]: {
                    "outage_s": self._network.outage_s(j),
                    "bound_m": self._network.own_error_m(j),
                    "likely_m": b.likely_error_m(self._network.outage_s(j)),
                }
                for j, b in self._network.outages.items()
            },
        }
