"""Position observations of one target by several observers, from CSV.

| column | names (case is ignored) |
| --- | --- |
| time | t, time, t_s, time_s, timestamp, unix: seconds or ISO 8601 |
| observer | observer, sensor, source, camera (left out: one observer) |
| position | x, y and perhaps z, with an optional ``_m``; or lat(itude), lon(gitude) and perhaps alt(itude) |
| noise | sd; or sd_x, sd_y (sd_z); or cov_xx, cov_xy, cov_yy (cov_xz, cov_yz, cov_zz): m and m^2 |
| truth, to compare with | true_x, true_y and perhaps true_z, m |

An empty position is a missing observation. Metres stay as they are; latitudes and longitudes become metres east and
north of the first of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from camnet.errors import DataError
from camnet.importers._clock import Clock
from camnet.importers._reading import known_columns, number, quoted
from camnet.importers._table import table_rows
from camnet.importers.geodesy import Origin, enu_from_geodetic, latitude, longitude
from camnet.types import Array, IntArray

__all__ = ["Observations", "read_observations"]

_TIME = ("t", "time", "t_s", "time_s", "timestamp", "unix")
_OBSERVER = ("observer", "sensor", "source", "camera")
_AXES = (("x", "x_m"), ("y", "y_m"), ("z", "z_m"))
_GEODETIC = (("lat", "latitude"), ("lon", "longitude"), ("alt", "altitude", "alt_m"))
_COV = ("cov_xx", "cov_xy", "cov_yy", "cov_xz", "cov_yz", "cov_zz")
_CELL = {
    "cov_xx": (0, 0),
    "cov_xy": (0, 1),
    "cov_yy": (1, 1),
    "cov_xz": (0, 2),
    "cov_yz": (1, 2),
    "cov_zz": (2, 2),
}
_KNOWN = (*_TIME, *_OBSERVER, "sd", "sd_x", "sd_y", "sd_z", *_COV, "true_x", "true_y", "true_z")
#: observations nearer in time than this belong to one step, s
_SAME_S = 1e-6


@dataclass(frozen=True, eq=False)
class Observations:
    """Observations in the order of time.

    Attributes
    ----------
    times_s : (n,) distinct times, s
    step : (k,) which time each observation belongs to
    observer : (k,) which observer made it
    position, covariance : (k,3) m, (k,3,3) m^2; z is 0 where the file has none
    names : of the observers
    planar : whether there is no height
    truth : (n,3) m, NaN where unknown; None where the file has none
    origin : latitude and longitude of the origin, degrees, where the file has them
    """

    times_s: Array
    step: IntArray
    observer: IntArray
    position: Array
    covariance: Array
    names: tuple[str, ...]
    planar: bool
    truth: Array | None
    origin: tuple[float, float] | None


class _Header:
    """Which column is what."""

    def __init__(self, names: Sequence[str], where: str, sd_m: float | None) -> None:
        self.names = [name.strip().lower() for name in names]
        self.where = where
        known_columns(self.names, _KNOWN, where)
        time = self._find(_TIME)
        if time is None:
            raise DataError(
                f"{where}: no time among the columns {self.names}; name one of {', '.join(_TIME)}"
            )
        self.time, self.observer = time, self._find(_OBSERVER)
        plain, geodetic = [self._find(axis) for axis in _AXES], [self._find(axis) for axis in _GEODETIC]
        self.geodetic = plain[0] is None and geodetic[0] is not None
        self.axes = geodetic if self.geodetic else plain
        if self.axes[0] is None or self.axes[1] is None:
            raise DataError(
                f"{where}: no position among the columns {self.names}; name them x and y, or lat and lon"
            )
        self.planar = self.axes[2] is None
        self.noise = self._noise(sd_m)
        self.truth = [self._find((f"true_{axis}",)) for axis in "xyz"]

    def _find(self, accepted: Sequence[str]) -> int | None:
        found = [k for k, name in enumerate(self.names) if name in accepted]
        if len(found) > 1:
            clash = " and ".join(repr(self.names[k]) for k in found)
            raise DataError(f"{self.where}: the columns {clash} mean the same; leave all but one out")
        return found[0] if found else None

    def _noise(self, sd_m: float | None) -> dict[str, int]:
        axes = "xy" if self.planar else "xyz"
        kinds: tuple[tuple[str, ...], ...] = (
            tuple(name for name in _COV if set(name[4:]) <= set(axes)),
            tuple(f"sd_{axis}" for axis in axes),
            ("sd",),
        )
        for kind in kinds:
            there = [name for name in kind if name in self.names]
            if there and len(there) < len(kind):
                missing = next(name for name in kind if name not in there)
                raise DataError(f"{self.where}: column {missing!r} is missing beside {', '.join(there)}")
            if there:
                return {name: self.names.index(name) for name in kind}
        if sd_m is None:
            raise DataError(
                f"{self.where}: no noise among the columns {self.names}; name sd, or sd_x and sd_y, or cov_xx, cov_xy "
                "and cov_yy, or give --sd"
            )
        return {}

    def covariance(self, row: Sequence[str], where: str, sd_m: float | None) -> Array:
        """Covariance (3,3) of a row, m^2."""
        out = np.zeros((3, 3))
        values = {name: number(row[k], where, name) for name, k in self.noise.items()}
        if not values:
            values = {"sd": float(sd_m or 0.0)}
        for name, value in values.items():
            if name in _CELL:
                i, j = _CELL[name]
                out[i, j] = out[j, i] = value
            elif value <= 0.0:
                raise DataError(f"{where}: {name} is {value:g}; a standard deviation above 0 m was expected")
            else:
                for axis in range(3) if name == "sd" else ("xyz".index(name[-1]),):
                    out[axis, axis] = value**2
        if self.planar:
            out[2, :], out[:, 2] = 0.0, 0.0
            out[2, 2] = 0.5 * (out[0, 0] + out[1, 1])
        if np.linalg.eigvalsh(out)[0] <= 0.0:
            raise DataError(f"{where}: the covariance {out.tolist()} is not positive definite")
        return out


def read_observations(path: Path, sd_m: float | None = None) -> Observations:
    """Read a ``.csv`` or ``.csv.gz`` file; see the module's table for its columns.

    Parameters
    ----------
    path : file
    sd_m : standard deviation of the observations, m, where the file has none

    Raises
    ------
    DataError
        A column is missing, twice there or misspelt; a field is no number; a covariance is not positive definite;
        there are fewer than two times.
    """
    rows = table_rows(path)
    line, first = next(rows, (1, []))
    header, clock = _Header(first, f"{path}, line {line}", sd_m), Clock()
    names: dict[str, int] = {}
    found: list[tuple[float, int, list[float], Array]] = []
    truth: dict[float, list[float]] = {}
    for line, row in rows:
        where = f"{path}, line {line}"
        if len(row) != len(header.names):
            raise DataError(
                f"{where}: {len(row)} fields {quoted(','.join(row))}; the header has {len(header.names)}"
            )
        t_s = clock.seconds(row[header.time], where, header.names[header.time])
        name = "observer" if header.observer is None else row[header.observer].strip()
        if not name:
            raise DataError(
                f"{where}: {header.names[header.observer or 0]} is empty; the observer's name was expected"
            )
        slot = names.setdefault(name, len(names))
        if header.truth[0] is not None and row[header.truth[0]].strip():
            truth[t_s] = [
                number(row[k], where, header.names[k]) if k is not None else 0.0 for k in header.truth
            ]
        if any(row[k].strip() for k in header.axes if k is not None):
            found.append((t_s, slot, _place(row, header, where), header.covariance(row, where, sd_m)))
        else:
            truth.setdefault(t_s, [float("nan")] * 3)
    return _sorted(path, header, tuple(names), found, truth)


def _place(row: Sequence[str], header: _Header, where: str) -> list[float]:
    out = []
    for axis, k in enumerate(header.axes):
        if k is None:
            out.append(0.0)
        elif header.geodetic and axis < 2:
            out.append((latitude, longitude)[axis](row[k], where, header.names[k]))
        else:
            out.append(number(row[k], where, header.names[k]))
    return out


def _sorted(
    path: Path,
    header: _Header,
    names: tuple[str, ...],
    found: list[tuple[float, int, list[float], Array]],
    truth: dict[float, list[float]],
) -> Observations:
    found.sort(key=lambda row: row[0])
    every = np.array(sorted({*(row[0] for row in found), *truth}))
    times = every[np.concatenate([[True], np.diff(every) > _SAME_S])] if len(every) else every
    if len(times) < 2 or not found:
        raise DataError(
            f"{path}: {len(found)} observations at {len(times)} times; at least two times are needed"
        )
    step = np.searchsorted(times, [row[0] + _SAME_S for row in found]) - 1
    observer = np.array([row[1] for row in found])
    pairs = list(zip(step.tolist(), observer.tolist(), strict=True))
    if len(set(pairs)) < len(pairs):
        k, j = next(pair for pair in pairs if pairs.count(pair) > 1)
        raise DataError(
            f"{path}: observer {names[j]!r} has two observations at t = {times[k]:g} s; one was expected"
        )
    position = np.array([row[2] for row in found])
    origin = None
    if header.geodetic:
        origin = (float(position[0, 0]), float(position[0, 1]))
        about = Origin(*origin, float(position[0, 2]))
        position = enu_from_geodetic(position[:, 0], position[:, 1], position[:, 2], about)
        position[:, 2] = 0.0 if header.planar else position[:, 2]
    known = np.full((len(times), 3), np.nan)
    for t_s, place in truth.items():
        known[np.searchsorted(times, t_s + _SAME_S) - 1] = place
    return Observations(
        times, step, observer, position, np.array([row[3] for row in found]), names, header.planar,
        known if np.isfinite(known).any() else None, origin,
    )  # fmt: skip
