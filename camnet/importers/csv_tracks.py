"""Tracks from CSV: one fix a row, columns known by their names.

| column | names (case is ignored) |
| --- | --- |
| identity | id, logger, track, track_id, name, vehicle, agent, person, ped, pedestrian |
| time | t, time, t_s, time_s, timestamp, unix, time_unix, time_unix_s, unix_s: seconds or ISO 8601 |
| position | lat(itude) and lon(gitude) with an optional ``_deg``, or x/east and y/north with an optional ``_m`` |
| height | alt/altitude/ele/elevation (with latitudes) or z/up (with metres) with an optional ``_m`` |

A file without an identity column is one track, named after the file. Fields are parted by commas, semicolons or tabs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from camnet.errors import DataError
from camnet.importers._clock import Clock
from camnet.importers._reading import known_columns, number, quoted
from camnet.importers._table import table_rows
from camnet.importers.fixes import Fixes, TrackOptions, tracks_from_fixes
from camnet.importers.geodesy import latitude, longitude
from camnet.motion.track import Track

__all__ = ["read_csv_tracks"]

_IDENTITY = ("id", "logger", "track", "track_id", "name", "vehicle", "agent", "person", "ped", "pedestrian")
_TIME = ("t", "time", "t_s", "time_s", "timestamp", "unix", "time_unix", "time_unix_s", "unix_s")
_LATITUDE = ("lat", "latitude", "lat_deg", "latitude_deg")
_LONGITUDE = ("lon", "lng", "long", "longitude", "lon_deg", "lng_deg", "longitude_deg")
_ALTITUDE = ("alt", "altitude", "ele", "elevation", "alt_m", "altitude_m", "ele_m", "elevation_m")
_X = ("x", "x_m", "east", "east_m")
_Y = ("y", "y_m", "north", "north_m")
_Z = ("z", "z_m", "up", "up_m")


@dataclass(frozen=True, slots=True)
class _Columns:
    """Indices of the columns that matter; ``x`` is a longitude and ``y`` a latitude if ``geodetic``."""

    names: list[str]
    identity: int | None
    time: int
    x: int
    y: int
    z: int | None
    geodetic: bool


def read_csv_tracks(path: Path, options: TrackOptions) -> tuple[Track, ...]:
    """Read every track of a ``.csv`` or ``.csv.gz`` file; see the table above for its columns.

    Raises
    ------
    DataError
        A column is missing or twice there; a row has another number of fields; a field is not a number, not
        finite, or no latitude or longitude; times of several kinds; there are latitudes but no origin.
    """
    rows = table_rows(path)
    line, header = next(rows, (1, []))
    columns = _columns(header, f"{path}, line {line}")
    fixes: dict[str, Fixes] = {}
    clock = Clock()
    unnamed = path.name.partition(".")[0]
    for line, row in rows:
        where = f"{path}, line {line}"
        if len(row) != len(columns.names):
            raise DataError(
                f"{where}: {len(row)} fields {quoted(','.join(row))}; the header has {len(columns.names)}"
            )
        identity = unnamed if columns.identity is None else row[columns.identity].strip()
        if not identity or '"' in identity:
            raise DataError(
                f"{where}: the identity is {quoted(identity)}; a name without quotes was expected"
            )
        fixes.setdefault(identity, Fixes()).add(*_fix(row, columns, where, options.height_m, clock))
    return tracks_from_fixes(fixes, str(path), options, columns.geodetic)


def _fix(
    row: list[str], columns: _Columns, where: str, height_m: float, clock: Clock
) -> tuple[float, float, float, float]:
    names, ix, iy, iz = columns.names, columns.x, columns.y, columns.z
    t_s = clock.seconds(row[columns.time], where, names[columns.time])
    z = height_m if iz is None else number(row[iz], where, names[iz])
    if columns.geodetic:
        return t_s, longitude(row[ix], where, names[ix]), latitude(row[iy], where, names[iy]), z
    return t_s, number(row[ix], where, names[ix]), number(row[iy], where, names[iy]), z


def _columns(header: Sequence[str], where: str) -> _Columns:
    names = [name.strip().lower() for name in header]
    time = _find(names, _TIME, where)
    if time is None:
        raise DataError(f"{where}: no time among the columns {names}; name one of {', '.join(_TIME)}")
    identity = _find(names, _IDENTITY, where)
    if identity is None:  # rows of different targets must not become one track by a slip of the pen
        known_columns(names, _IDENTITY, where)
    lat, lon = _find(names, _LATITUDE, where), _find(names, _LONGITUDE, where)
    if lat is not None and lon is not None:
        return _Columns(names, identity, time, lon, lat, _find(names, _ALTITUDE, where), geodetic=True)
    x, y = _find(names, _X, where), _find(names, _Y, where)
    if x is not None and y is not None:
        return _Columns(names, identity, time, x, y, _find(names, _Z, where), geodetic=False)
    raise DataError(f"{where}: no position among the columns {names}; name them lat and lon, or x and y")


def _find(names: list[str], accepted: Sequence[str], where: str) -> int | None:
    found = [index for index, name in enumerate(names) if name in accepted]
    if len(found) > 1:
        clash = " and ".join(repr(names[index]) for index in found)
        raise DataError(f"{where}: the columns {clash} mean the same; rename all but one")
    return found[0] if found else None
