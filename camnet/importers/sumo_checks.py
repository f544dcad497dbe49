"""What a SUMO network must satisfy before ``sumolib``, which checks nothing, may read it.

Numbers are finite and written as numbers, names are there once, every street has a lane of some length that its shape
agrees with, and what refers to an edge, lane or junction names one that exists. Elements that this program does not
use (signals, types, crossings) are left aside.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

from camnet.errors import DataError
from camnet.importers._reading import Place, number, parse_xml, quoted

__all__ = ["FARTHEST_M", "check_network", "read_shape"]

#: largest coordinate of a network, m: projected coordinates of any zone on Earth are smaller
FARTHEST_M = 2e7
#: a lane's stated length may differ from its shape's by this factor (rounding and clipping at junctions included)
_LENGTH_FACTOR, _LENGTH_SLACK_M = 10.0, 50.0


@dataclass(slots=True)
class _Checks:
    """Names met so far; references are resolved at the end, since elements come in any order."""

    edges: dict[str, int] = field(default_factory=dict)
    lanes: set[str] = field(default_factory=set)
    junctions: set[str] = field(default_factory=set)
    wanted: list[tuple[str, str, str, str]] = field(default_factory=list)
    edge: str = ""
    edge_place: str = ""

    def start(self, tag: str, attributes: dict[str, str], where: Place) -> None:
        """Check one element."""
        if tag == "edge":
            self._edge(attributes, where)
        elif tag == "lane":
            self._lane(attributes, where)
        elif tag == "junction":
            self._junction(attributes, where)
        elif tag == "connection":
            for name in ("from", "to"):
                self.wanted.append(
                    (str(where), f"connection {name}", "edge", _get(attributes, name, tag, where))
                )

    def end(self, tag: str, text: str, where: Place) -> None:
        """Close an edge."""
        if tag == "edge":
            if self.edges[self.edge] == 0:
                raise DataError(
                    f"{self.edge_place}: edge {self.edge!r} has no lane; at least one was expected"
                )
            self.edge = ""

    def _edge(self, attributes: dict[str, str], where: Place) -> None:
        name = _once(attributes, "edge", self.edges, where)
        self.edges[name], self.edge, self.edge_place = 0, name, str(where)
        if attributes.get("shape"):
            read_shape(attributes["shape"], where, f"shape of edge {name!r}")
        if attributes.get("function", "normal") in ("", "normal"):
            for key in ("from", "to"):
                self.wanted.append(
                    (str(where), f"{key} of edge {name!r}", "junction", _get(attributes, key, "edge", where))
                )

    def _lane(self, attributes: dict[str, str], where: Place) -> None:
        name = _once(attributes, "lane", self.lanes, where)
        self.lanes.add(name)
        if not self.edge:
            raise DataError(f"{where}: lane {name!r} stands outside of an <edge>")
        self.edges[self.edge] += 1
        for key, least in (("length", 0.0), ("speed", 0.0), ("width", 0.0)):
            if key in attributes or key != "width":
                value = number(_get(attributes, key, "lane", where), where, f"{key} of lane {name!r}")
                if not value > least:
                    raise DataError(f"{where}: {key} of lane {name!r} is {value:g}; more than 0 was expected")
        # where two streets touch, SUMO writes the path over the junction as one point, twice
        least = 1 if self.edge.startswith(":") else 2
        points = read_shape(_get(attributes, "shape", "lane", where), where, f"shape of lane {name!r}", least)
        way = sum(math.dist(a, b) for a, b in pairwise(points))
        stated = float(attributes["length"])
        slack = _LENGTH_SLACK_M
        if way > _LENGTH_FACTOR * stated + slack or stated > _LENGTH_FACTOR * way + slack:
            raise DataError(
                f"{where}: lane {name!r} is {stated:g} m long and its shape {way:.4g} m; the same was expected: "
                "are the units mixed?"
            )

    def _junction(self, attributes: dict[str, str], where: Place) -> None:
        name = _once(attributes, "junction", self.junctions, where)
        self.junctions.add(name)
        for key in ("x", "y"):
            _coordinate(_get(attributes, key, "junction", where), where, f"{key} of junction {name!r}")

    def resolve(self) -> None:
        """Check that every name that was referred to exists."""
        known = {"edge": self.edges.keys(), "junction": self.junctions}
        for where, what, kind, name in self.wanted:
            if name not in known[kind]:
                raise DataError(f"{where}: {what} is {quoted(name)}; there is no such {kind}")


def check_network(path: Path) -> None:
    """Check a ``.net.xml`` file.

    Raises
    ------
    DataError
        The first fault, with file, line, element and value.
    """
    checks = _Checks()
    parse_xml(path, "net", checks.start, checks.end)
    checks.resolve()


def read_shape(text: str, where: Place, what: str, least: int = 2) -> list[tuple[float, ...]]:
    """Read the points of a shape, (x, y) or (x, y, z), m; at least ``least`` (1 or 2) different ones."""
    points = []
    for point in text.split():
        parts = point.split(",")
        if len(parts) not in (2, 3):
            raise DataError(f"{where}: {what} has the point {quoted(point)}; x,y or x,y,z was expected")
        points.append(tuple(_coordinate(part, where, what) for part in parts))
    if len(set(points)) < least or len({len(point) for point in points}) > 1:
        wanted = "two different points were" if least > 1 else "one point was"
        raise DataError(f"{where}: {what} is {quoted(text)}; at least {wanted} expected")
    return points


def _coordinate(text: str, where: Place, what: str) -> float:
    value = number(text, where, what)
    if abs(value) > FARTHEST_M:
        raise DataError(f"{where}: {what} is {quoted(text)}; metres of at most {FARTHEST_M:g} were expected")
    return value


def _once(attributes: dict[str, str], kind: str, known: dict[str, int] | set[str], where: Place) -> str:
    name = _get(attributes, "id", kind, where)
    if not name:
        raise DataError(f"{where}: a {kind} has an empty id; a name was expected")
    if name in known:
        raise DataError(f"{where}: {kind} {name!r} is there twice; names are unique")
    return name


def _get(attributes: dict[str, str], name: str, tag: str, where: Place) -> str:
    if name not in attributes:
        raise DataError(f"{where}: <{tag}> has no attribute {name}; it has {', '.join(attributes) or 'none'}")
    return attributes[name]
