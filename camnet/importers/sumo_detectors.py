"""Positions of a city's road sensors: induction loops of a SUMO ``.add.xml``, or rows of a CSV file.

Loops of one place lie on several lanes; sensors closer together than ``merge_m`` are one place.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from camnet.errors import DataError
from camnet.importers._reading import Place, known_columns, number, parse_xml, quoted
from camnet.importers._table import table_rows
from camnet.importers.sumo_checks import FARTHEST_M, read_shape
from camnet.types import Array

__all__ = ["Sensor", "read_detectors", "read_sensor_table"]

_LOOPS = ("e1Detector", "inductionLoop")
_COLUMNS = ("name", "x", "y", "footprint", "cost")
#: stated lengths of lanes exceed those of their shapes by up to this factor, and so do positions on them
_LENGTH_SLACK = 1.5


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
        There is no loop, a name is there twice, a position is not a number or beyond its lane, or a lane is not in the
        network.
    """
    path = Path(path)
    lanes = _lane_shapes(Path(network))
    found: list[Sensor] = []
    known: set[str] = set()

    def start(name: str, attributes: dict[str, str], place: Place) -> None:
        if name in _LOOPS:
            lane = attributes.get("lane", "")
            if lane not in lanes:
                raise DataError(
                    f"{place}: lane {lane!r} of detector {attributes.get('id')!r} is not in {network}"
                )
            identity = attributes.get("id", f"detector {len(known)}")
            if identity in known:
                raise DataError(f"{place}: detector {identity!r} is there twice; names are unique")
            known.add(identity)
            at = number(attributes.get("pos", ""), place, f"pos of detector {identity!r}")
            x, y = _along(lanes[lane], at, f"{place}: pos of detector {identity!r}")
            if all(np.hypot(x - s.x_m, y - s.y_m) > merge_m for s in found):
                found.append(Sensor(identity, x, y))

    parse_xml(path, "additional", start)
    if not found:
        raise DataError(f"{path}: holds no {' or '.join(_LOOPS)}")
    return tuple(found)


def read_sensor_table(path: str | Path) -> tuple[Sensor, ...]:
    """Read a CSV file with the columns ``name``, ``x``, ``y`` and, if wanted, ``footprint`` (m) and ``cost``.

    Raises
    ------
    DataError
        A column is missing, there twice or nearly one of these, a value is not a number in its range, or a name is
        empty or there twice.
    """
    path = Path(path)
    rows = table_rows(path)
    line, header = next(rows, (1, []))
    names = [name.strip().lower() for name in header]
    where = f"{path}, line {line}"
    if not {"name", "x", "y"} <= set(names) or len(set(names)) < len(names):
        raise DataError(f"{where}: the columns are {names}; name, x, y, each once, were expected")
    known_columns(names, _COLUMNS, where)
    found: dict[str, Sensor] = {}
    for line, row in rows:
        where = f"{path}, line {line}"
        if len(row) != len(names):
            raise DataError(
                f"{where}: {len(row)} fields {quoted(','.join(row))}; the header has {len(names)}"
            )
        sensor = _sensor(dict(zip(names, row, strict=True)), where)
        if not sensor.name or sensor.name in found:
            raise DataError(f"{where}: name is {sensor.name!r}; a name that no other row has was expected")
        found[sensor.name] = sensor
    if not found:
        raise DataError(f"{path}: holds no row below its header; at least one camera was expected")
    return tuple(found.values())


def _sensor(row: dict[str, str], where: str) -> Sensor:
    x, y = (_metres(row[axis], where, axis) for axis in ("x", "y"))
    side, cost = row.get("footprint", "").strip(), row.get("cost", "").strip()
    sensor = Sensor(
        row["name"].strip(),
        x,
        y,
        _metres(side, where, "footprint") if side else None,
        number(cost, where, "cost") if cost else None,
    )
    if sensor.footprint_m is not None and sensor.footprint_m <= 0:
        raise DataError(f"{where}: footprint is {side!r}; metres above 0 were expected")
    if sensor.cost is not None and sensor.cost < 0:
        raise DataError(f"{where}: cost is {cost!r}; 0 or more was expected")
    return sensor


def _metres(text: str, where: str, field: str) -> float:
    value = number(text, where, field)
    if abs(value) > FARTHEST_M:
        raise DataError(f"{where}: {field} is {quoted(text)}; metres of at most {FARTHEST_M:g} were expected")
    return value


def _lane_shapes(network: Path) -> dict[str, Array]:
    """Return the centre line (n, 2) of every lane, m."""
    lanes: dict[str, Array] = {}

    def start(name: str, attributes: dict[str, str], place: Place) -> None:
        if name == "lane" and "shape" in attributes:
            points = read_shape(attributes["shape"], place, "shape")
            lanes[attributes.get("id", "")] = np.array(points)[:, :2]

    parse_xml(network, "net", start)
    return lanes


def _along(line: Array, s_m: float, where: str) -> tuple[float, float]:
    """Return the point of a line at an arc length; negative ones count from its end."""
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    if abs(s_m) > _LENGTH_SLACK * length[-1] + 1.0:
        raise DataError(f"{where} is {s_m:g}; its lane is {length[-1]:.4g} m long")
    at = s_m if s_m >= 0.0 else length[-1] + s_m
    return float(np.interp(at, length, line[:, 0])), float(np.interp(at, length, line[:, 1]))
