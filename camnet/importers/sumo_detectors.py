"""Positions of a city's road sensors: induction loops of a SUMO ``.add.xml``, or rows of a CSV file.

Loops of one place lie on several lanes; sensors closer together than ``merge_m`` are one place.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from camnet.errors import DataError
from camnet.importers._reading import Place, number, parse_xml, text_lines
from camnet.types import Array

__all__ = ["Sensor", "read_detectors", "read_sensor_table"]

_LOOPS = ("e1Detector", "inductionLoop")


@dataclass(frozen=True, slots=True)
class Sensor:
    """One place: name, x and y in the network's metres; footprint's side (m) and cost where the file states them."""

    name: str
    x_m: float
    y_m: float
    footprint_m: float | None = None
    cost: float | None = None


def read_detectors(path: str | Path, network: str | Path, merge_m: float = 10.0) -> tuple[Sensor, ...]:
    """Read the induction loops of an additional file and place them on the lanes of its network.

    Raises
    ------
    DataError
        There is no loop, a position is not a number, or a lane is not in the network.
    """
    path = Path(path)
    lanes = _lane_shapes(Path(network))
    found: list[Sensor] = []

    def start(name: str, attributes: dict[str, str], place: Place) -> None:
        if name in _LOOPS:
            lane = attributes.get("lane", "")
            if lane not in lanes:
                raise DataError(
                    f"{place}: lane {lane!r} of detector {attributes.get('id')!r} is not in {network}"
                )
            at = number(attributes.get("pos", ""), place, "pos")
            x, y = _along(lanes[lane], at)
            if all(np.hypot(x - s.x_m, y - s.y_m) > merge_m for s in found):
                found.append(Sensor(attributes.get("id", f"detector {len(found)}"), x, y))

    parse_xml(path, "additional", start)
    if not found:
        raise DataError(f"{path}: holds no {' or '.join(_LOOPS)}")
    return tuple(found)


def read_sensor_table(path: str | Path) -> tuple[Sensor, ...]:
    """Read a CSV file with the columns ``name``, ``x``, ``y`` and, if wanted, ``footprint`` (m) and ``cost``.

    Raises
    ------
    DataError
        A column is missing or a value is not a number.
    """
    path = Path(path)
    numbered = list(text_lines(path))
    rows = list(csv.DictReader(text for _, text in numbered))
    if not rows or not {"name", "x", "y"} <= set(rows[0]):
        raise DataError(f"{path}: needs a header with name, x, y and at least one row")
    out = []
    for k, row in enumerate(rows):
        where = f"{path}, line {numbered[min(k + 1, len(numbered) - 1)][0]}"
        side, cost = row.get("footprint"), row.get("cost")
        out.append(
            Sensor(
                str(row["name"]),
                number(str(row["x"]), where, "x"),
                number(str(row["y"]), where, "y"),
                number(side, where, "footprint") if side else None,
                number(cost, where, "cost") if cost else None,
            )
        )
    return tuple(out)


def _lane_shapes(network: Path) -> dict[str, Array]:
    """Return the centre line (n, 2) of every lane, m."""
    lanes: dict[str, Array] = {}

    def start(name: str, attributes: dict[str, str], place: Place) -> None:
        if name == "lane" and "shape" in attributes:
            points = [pair.split(",")[:2] for pair in attributes["shape"].split()]
            lanes[attributes.get("id", "")] = np.array(
                [[number(c, place, "shape") for c in pair] for pair in points]
            )

    parse_xml(network, "net", start)
    return lanes


def _along(line: Array, s_m: float) -> tuple[float, float]:
    """Return the point of a line at an arc length; negative ones count from its end."""
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    at = s_m if s_m >= 0.0 else length[-1] + s_m
    return float(np.interp(at, length, line[:, 0])), float(np.interp(at, length, line[:, 1]))
