"""Places at which cameras may be mounted: poles, walls and roofs, with the directions that each allows (CSV)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from camnet.errors import DataError
from camnet.importers._reading import known_columns, number, quoted
from camnet.importers._table import table_rows
from camnet.importers.sumo_checks import FARTHEST_M

__all__ = ["OPTIONAL_FIELDS", "Mount", "mount_of", "read_mounts"]

_NEEDED = ("name", "x", "y", "z")
#: what may be said of a mount besides its name and place
OPTIONAL_FIELDS = ("pan_min", "pan_max", "tilt_min", "tilt_max", "cost")
_COLUMNS = (*_NEEDED, *OPTIONAL_FIELDS)


@dataclass(frozen=True, slots=True)
class Mount:
    """One place for a camera, and where it may look from there.

    Attributes
    ----------
    name : unique
    x_m, y_m, z_m : place in the world, m
    pan_deg : first and last direction of the optical axis, degrees counter-clockwise from x; the second is the larger
    tilt_deg : least and largest angle of the optical axis below the horizon, degrees
    cost : what mounting a camera there costs besides the camera
    """

    name: str
    x_m: float
    y_m: float
    z_m: float
    pan_deg: tuple[float, float] = (-180.0, 180.0)
    tilt_deg: tuple[float, float] = (0.0, 90.0)
    cost: float = 0.0


def read_mounts(path: str | Path) -> tuple[Mount, ...]:
    """Read a CSV file with the columns ``name,x,y,z`` (m) and, if wanted, ``pan_min,pan_max,tilt_min,tilt_max,cost``.

    Angles are in degrees: pan counter-clockwise from x, from ``pan_min`` up to ``pan_max``; tilt below the horizon. An
    empty field means that nothing limits the angle, or that the mount costs nothing.

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
    if not set(_NEEDED) <= set(names) or len(set(names)) < len(names):
        raise DataError(f"{where}: the columns are {names}; {', '.join(_NEEDED)}, each once, were expected")
    known_columns(names, _COLUMNS, where)
    found: dict[str, Mount] = {}
    for line, row in rows:
        where = f"{path}, line {line}"
        if len(row) != len(names):
            raise DataError(
                f"{where}: {len(row)} fields {quoted(','.join(row))}; the header has {len(names)}"
            )
        mount = mount_of(dict(zip(names, row, strict=True)), where)
        if not mount.name or mount.name in found:
            raise DataError(f"{where}: name is {mount.name!r}; a name that no other row has was expected")
        found[mount.name] = mount
    if not found:
        raise DataError(f"{path}: holds no row below its header; at least one mount was expected")
    return tuple(found.values())


def mount_of(row: Mapping[str, str], where: str) -> Mount:
    """Return the mount of one row of text fields.

    Raises
    ------
    DataError
        A value is not a number in its range; ``where`` says where it stands.
    """

    def value(field: str, default: float | None = None) -> float:
        text = row.get(field, "").strip()
        return default if default is not None and not text else number(text, where, field)

    x, y, z = (value(axis) for axis in "xyz")
    if max(abs(x), abs(y), abs(z)) > FARTHEST_M:
        raise DataError(
            f"{where}: x, y, z are {x:g}, {y:g}, {z:g}; metres of at most {FARTHEST_M:g} were expected"
        )
    pan, tilt = (
        (value("pan_min", -180.0), value("pan_max", 180.0)),
        (
            value("tilt_min", 0.0),
            value("tilt_max", 90.0),
        ),
    )
    if not pan[0] <= pan[1] <= pan[0] + 360.0:
        raise DataError(
            f"{where}: pan_min, pan_max are {pan[0]:g}, {pan[1]:g}; degrees counter-clockwise from x were expected, "
            "the second at least the first and at most 360 more (such as 135, 225)"
        )
    if not -90.0 <= tilt[0] <= tilt[1] <= 90.0:
        raise DataError(
            f"{where}: tilt_min, tilt_max are {tilt[0]:g}, {tilt[1]:g}; degrees below the horizon were expected, "
            "-90 to 90, the second at least the first"
        )
    cost = value("cost", 0.0)
    if cost < 0.0:
        raise DataError(f"{where}: cost is {cost:g}; 0 or more was expected")
    return Mount(row["name"].strip(), x, y, z, pan, tilt, cost)
