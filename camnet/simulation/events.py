"""What happened in a run, as a table: who was sighted, lost and handed over, and who collided.

Sightings and losses are noted at every sensing instant, which is finer than the rows of the log.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from camnet.simulation.log_columns import LogColumn
from camnet.simulation.loop import NetworkSimulation
from camnet.storage.records import Field

__all__ = ["EVENT_COLUMNS", "EVENT_FIELDS", "KINDS", "EventRecorder"]

#: kind -> what it means
KINDS: Mapping[str, str] = {
    "sighting": "a camera begins to see a target that nobody saw (seen at the start: at time 0)",
    "loss": "the last camera that saw a target ceases to see it",
    "handoff": "a lost target entered another region: at the sighting there, or at the entry if there was none",
    "collision": "two bodies begin to touch",
}

#: columns of the table, in order
EVENT_COLUMNS = (
    LogColumn("t_s", "s", "simulated time"),
    LogColumn("event", "1", "sighting, loss, handoff or collision"),
    LogColumn("subject", "1", "target; of a collision, the first body"),
    LogColumn(
        "with",
        "1",
        "camera of a sighting or loss; camera of the region entered; of a collision, the other body",
    ),
    LogColumn("from", "1", "camera of the region where a target that is handed over was seen last"),
    LogColumn(
        "duration_s",
        "s",
        "sighting: unseen before; loss: seen before; handoff: from the entry to the sighting; else empty",
    ),
    LogColumn(
        "completed", "1", "handoff: whether the sighting came within handoff.grace_s of the entry; else empty"
    ),
)
_KINDS_OF_FIELDS: dict[str, type] = {"t_s": float, "duration_s": float, "completed": bool}
EVENT_FIELDS = tuple(
    Field(c.name, _KINDS_OF_FIELDS.get(c.name, str), c.unit, c.description) for c in EVENT_COLUMNS
)


class EventRecorder:
    """Notes sightings and losses of a simulation from now on.

    Parameters
    ----------
    simulation : to follow; nothing of it is changed but its list of watchers
    """

    def __init__(self, simulation: NetworkSimulation) -> None:
        n = simulation.network.n_targets
        self._rows: list[dict[str, Any]] = []
        self._seer = [-1] * n
        self._since: list[float | None] = [None] * n
        self._look(simulation)
        simulation.watchers.append(self._look)

    def _look(self, simulation: NetworkSimulation) -> None:
        for m, before in enumerate(self._seer):
            now = simulation.seen_by(m)
            if (now >= 0) != (before >= 0):
                self._note(simulation, m, "sighting" if now >= 0 else "loss", now if now >= 0 else before)
            self._seer[m] = now

    def _note(self, simulation: NetworkSimulation, m: int, kind: str, camera: int) -> None:
        t_s, since = simulation.snapshot.t_s, self._since[m]
        world = simulation.world
        row = _row(t_s, kind, world.target_names[m], world.camera_names[camera])
        self._rows.append({**row, "duration_s": None if since is None else t_s - since})
        self._since[m] = t_s

    def table(
        self, handoffs: Sequence[Mapping[str, Any]], collisions: Sequence[tuple[float, str, str]]
    ) -> list[dict[str, Any]]:
        """Return all events in order of time, with those that the run counted itself.

        Parameters
        ----------
        handoffs : as in ``handoffs.json``
        collisions : time, s, and the two bodies
        """
        rows = [*self._rows, *(_row(t, "collision", a, b) for t, a, b in collisions)]
        for h in handoffs:
            t_s = h["entered_s"] if h["seen_s"] is None else h["seen_s"]
            more = {"from": h["from"], "duration_s": h["delay_s"], "completed": h["completed"]}
            rows.append({**_row(t_s, "handoff", h["target"], h["to"]), **more})
        order = list(KINDS)
        return sorted(rows, key=lambda r: (r["t_s"], order.index(r["event"]), r["subject"], r["with"]))


def _row(t_s: float, kind: str, subject: str, other: str) -> dict[str, Any]:
    return {
        "t_s": float(t_s),
        "event": kind,
        "subject": subject,
        "with": other,
        "from": None,
        "duration_s": None,
        "completed": None,
    }
