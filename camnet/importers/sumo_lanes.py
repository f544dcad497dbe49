"""SUMO networks lane by lane: every lane's line, the turning paths on junctions, and which lanes lead where.

Vehicles drive on lanes, 5 to 15 m beside the line between two junctions, and cross a junction on the *internal* lane
of their turn. Certificates need these lines: what sees the street's middle need not see the vehicle.

Only lanes that road vehicles may use are read (``MOTOR_CLASSES``); footpaths, cycle tracks, rails and waterways are
left out.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from camnet.errors import ConfigError, DataError
from camnet.importers.sumo_checks import FARTHEST_M, check_network
from camnet.types import Array

__all__ = ["MOTOR_CLASSES", "Lane", "LaneEdge", "LaneNetwork", "Turn", "read_lane_network"]

#: SUMO's vehicle classes that drive on roads
MOTOR_CLASSES = (
    "passenger", "private", "taxi", "bus", "coach", "delivery", "truck", "trailer", "motorcycle", "moped",
    "evehicle", "emergency", "authority", "army", "vip", "hov", "custom1", "custom2",
)  # fmt: skip
_INSTALL = "install the extra: pip install 'camnet[sumo]'"
#: internal lanes that one turn may be made of
_MOST_PARTS = 8


@dataclass(frozen=True, eq=False, slots=True)
class Lane:
    """One lane.

    Attributes
    ----------
    points : (n, 3) its line in the network's frame, m
    width_m : its width
    speed_mps : its speed limit
    """

    points: Array
    width_m: float
    speed_mps: float


@dataclass(frozen=True, eq=False, slots=True)
class LaneEdge:
    """One direction of one street between two junctions, with its lanes from right to left."""

    id: str
    start: str
    end: str
    lanes: tuple[Lane, ...]


@dataclass(frozen=True, eq=False, slots=True)
class Turn:
    """The path over a junction from one lane to another.

    Attributes
    ----------
    source, target : numbers of the edges that it joins
    lane : its line over the junction; None where the two lanes touch
    """

    source: int
    target: int
    lane: Lane | None


@dataclass(frozen=True, eq=False, slots=True)
class LaneNetwork:
    """Edges, turns and the places of junctions: name -> (x, y), m."""

    edges: tuple[LaneEdge, ...]
    turns: tuple[Turn, ...]
    junctions: dict[str, tuple[float, float]]


def read_lane_network(path: str | Path, classes: Iterable[str] = MOTOR_CLASSES) -> LaneNetwork:
    """Read the lanes of a ``.net.xml`` (``.gz`` allowed) that any of the vehicle ``classes`` may use.

    Raises
    ------
    ConfigError
        ``sumolib`` is not installed.
    DataError
        The file is not a SUMO network, breaks a rule of `camnet.importers.sumo_checks`, or has no such lane.
    """
    try:
        import sumolib
    except ImportError:
        raise ConfigError(f"{path}: reading a SUMO network needs sumolib; {_INSTALL}") from None
    path = Path(path)
    check_network(path)
    try:
        net = sumolib.net.readNet(str(path), withInternal=True)
    except Exception as error:  # sumolib lets anything through: KeyError, ValueError, AttributeError, ...
        raise DataError(f"{path}: not a SUMO network that sumolib can read ({error!r})") from None
    return _Reader(path, tuple(classes)).network(net)


class _Reader:
    """Turns sumolib's objects into ours; every number is checked."""

    def __init__(self, path: Path, classes: tuple[str, ...]) -> None:
        self._path, self._classes = path, classes

    def network(self, net: Any) -> LaneNetwork:  # noqa: ANN401 (sumolib has no types)
        roads = [e for e in net.getEdges(withInternal=False) if e.getFunction() in ("", "normal")]
        open_lanes = {e.getID(): [k for k in e.getLanes() if self._allowed(k)] for e in roads}
        used = [e for e in roads if open_lanes[e.getID()]]
        if not used:
            raise DataError(f"{self._path}: has no lane that road vehicles may use")
        number = {e.getID(): i for i, e in enumerate(used)}
        edges = tuple(
            LaneEdge(
                e.getID(),
                e.getFromNode().getID(),
                e.getToNode().getID(),
                tuple(self._lane(k) for k in open_lanes[e.getID()]),
            )
            for e in used
        )
        turns = tuple(
            Turn(number[e.getID()], number[c.getToLane().getEdge().getID()], self._path_of(net, c))
            for e in used
            for lane in open_lanes[e.getID()]
            for c in lane.getOutgoing()
            if c.getToLane().getEdge().getID() in number and self._allowed(c.getToLane())
        )
        ends = {name for edge in edges for name in (edge.start, edge.end)}
        junctions = {n.getID(): self._place(n) for n in net.getNodes() if n.getID() in ends}
        return LaneNetwork(edges, turns, junctions)

    def _allowed(self, lane: Any) -> bool:  # noqa: ANN401 (sumolib has no types)
        return any(lane.allows(name) for name in self._classes)

    def _lane(self, lane: Any) -> Lane:  # noqa: ANN401 (sumolib has no types)
        where = f"{self._path}: lane {lane.getID()!r}"
        points = np.array(lane.getShape3D(), dtype=np.float64)
        if points.ndim != 2 or len(points) < 2 or not (np.abs(points) < FARTHEST_M).all():
            raise DataError(
                f"{where}: its shape is {lane.getShape3D()!r}; two or more finite points were expected"
            )
        points.setflags(write=False)
        width, speed = float(lane.getWidth()), float(lane.getSpeed())
        for name, value in (("width", width), ("speed", speed)):
            if not 0.0 < value < 1e4:
                raise DataError(f"{where}: its {name} is {value}; a positive number was expected")
        return Lane(points, width, speed)

    def _place(self, node: Any) -> tuple[float, float]:  # noqa: ANN401 (sumolib has no types)
        x, y = (float(c) for c in node.getCoord()[:2])
        if not (abs(x) < FARTHEST_M and abs(y) < FARTHEST_M):
            raise DataError(
                f"{self._path}: junction {node.getID()!r} is at ({x}, {y}); finite metres were expected"
            )
        return x, y

    def _path_of(self, net: Any, connection: Any) -> Lane | None:  # noqa: ANN401 (sumolib has no types)
        """Join the internal lanes of one turn; without any, the straight line between the two lanes' ends."""
        parts: list[Lane] = []
        via = connection.getViaLaneID()
        while via:
            inner = net.getLane(via)
            parts.append(self._lane(inner))
            onward = [
                c for c in inner.getOutgoing() if c.getToLane().getEdge() is connection.getToLane().getEdge()
            ]
            via = onward[0].getViaLaneID() if onward else ""
            if len(parts) > _MOST_PARTS:
                raise DataError(f"{self._path}: the turn over {inner.getID()!r} leads in a circle")
        ends = [
            np.array(connection.getFromLane().getShape3D()[-1]),
            np.array(connection.getToLane().getShape3D()[0]),
        ]
        line = np.concatenate([ends[:1], *(p.points for p in parts), ends[1:]])
        moved = np.linalg.norm(np.diff(line, axis=0), axis=1) > 1e-6
        points = line[np.r_[True, moved]]
        if len(points) < 2:
            return None
        limits = parts or [self._lane(connection.getToLane())]
        points.setflags(write=False)
        return Lane(points, min(p.width_m for p in limits), min(p.speed_mps for p in limits))
