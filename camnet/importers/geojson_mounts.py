"""Mounts of cameras from GeoJSON (RFC 7946): points, and places along lines and outlines, with height and directions.

| geometry | mounts |
| --- | --- |
| Point | a pole, or any one place |
| LineString | along it, both ends too: a wall, a gantry, a row of lamps |
| Polygon | along its outline: the edge of a roof |
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from camnet.errors import DataError
from camnet.importers._reading import known_columns
from camnet.importers.geodesy import Origin, enu_from_geodetic
from camnet.importers.geojson_areas import check_degrees, read_geojson
from camnet.importers.mounts import OPTIONAL_FIELDS, Mount, mount_of

__all__ = ["read_geojson_mounts"]

#: between places along lines and outlines, unless told, m
_SPACING_M = 2.0
#: most mounts, and most points of a line
_MOST = 10_000


def read_geojson_mounts(path: Path, origin: Origin | None) -> tuple[Mount, ...]:
    """Read a collection of points with the property ``name`` and, if wanted, those of ``read_mounts``'s columns.

    Parameters
    ----------
    path : features; ``height`` is the mount's height above the ground of the site, m, else a point's third
        coordinate: metres above the origin's altitude too. Along lines and outlines places are ``spacing`` apart (m, at
        most; 2 unless told), named with a number behind the feature's name
    origin : of the site's local frame, for longitudes and latitudes; None: coordinates are the site's metres

    Raises
    ------
    DataError
        The file is no collection of such features, one has no height or name, a name is there twice, or a value is no
        number in its range.
    """
    content = read_geojson(path)
    features = content.get("features")
    if content["type"] != "FeatureCollection" or not isinstance(features, list) or not features:
        raise DataError(f"{path}: a FeatureCollection of points, lines or polygons was expected")
    found: dict[str, Mount] = {}
    for k, feature in enumerate(features):
        where = f"{path}, feature {k + 1}"
        for mount in _mounts(feature, where, origin):
            if not mount.name or mount.name in found:
                raise DataError(
                    f"{where}: name is {mount.name!r}; a name that no other feature has was expected"
                )
            found[mount.name] = mount
            if len(found) > _MOST:
                raise DataError(f"{where}: more than {_MOST:,} mounts: give a larger spacing")
    return tuple(found.values())


def _mounts(feature: object, where: str, origin: Origin | None) -> Iterator[Mount]:
    if not isinstance(feature, dict) or not isinstance(feature.get("geometry"), dict):
        raise DataError(f"{where}: is no feature with a geometry")
    geometry, said = feature["geometry"], feature.get("properties") or {}
    kind, given = geometry.get("type"), geometry.get("coordinates")
    if kind not in ("Point", "LineString", "Polygon") or not isinstance(said, dict):
        raise DataError(
            f"{where}: a point, line or polygon with properties was expected, not a {str(kind)[:40]!r}"
        )
    along = kind != "Point"
    known_columns(list(said), ("name", "height", *(("spacing",) if along else ()), *OPTIONAL_FIELDS), where)
    fields = {name: said.get(name) for name in OPTIONAL_FIELDS}
    row = {name: "" if value is None else str(value) for name, value in fields.items()}
    name = str(said.get("name", ""))
    if not along:
        x, y, z = _place(given, said.get("height"), where, origin)
        yield mount_of({"name": name, "x": x, "y": y, "z": z, **row}, where)
        return
    if said.get("height") is None:
        raise DataError(f"{where}: has no height; give the property 'height', m above the ground")
    if not name:
        raise DataError(f"{where}: name is ''; a name that no other feature has was expected")
    for k, at in enumerate(_along(kind, given, said.get("spacing"), where, origin)):
        place = {"x": repr(at[0]), "y": repr(at[1]), "z": str(said["height"])}
        yield mount_of({"name": f"{name} {k + 1}", **place, **row}, where)


def _along(
    kind: str,
    given: Any,  # noqa: ANN401 - read from a file
    spacing: object,
    where: str,
    origin: Origin | None,
) -> list[tuple[float, float]]:
    """Return places along a line or an outline, m."""
    rings = given if kind == "Polygon" and isinstance(given, list) else [given]
    ring = rings[0] if rings else None
    if not isinstance(ring, list) or not 2 <= len(ring) <= _MOST:
        raise DataError(f"{where}: a {kind} of 2 to {_MOST:,} points was expected")
    points = [[float(v) for v in _place(point, 0.0, where, origin)[:2]] for point in ring]
    step = _SPACING_M if spacing is None else spacing
    if isinstance(step, bool) or not isinstance(step, int | float) or not 0.0 < step < math.inf:
        raise DataError(f"{where}: spacing is {str(spacing)[:40]!r}; metres above 0 were expected")
    line = shapely.LineString(points)
    if not line.length > 0.0 or line.length / step > _MOST:
        raise DataError(
            f"{where}: {line.length:.4g} m at a spacing of {step:g} m: between 1 and {_MOST:,} places were expected"
        )
    count = math.ceil(line.length / step - 1e-9)
    ends = 1 if kind == "LineString" else 0  # an outline ends where it began
    found = [line.interpolate(k / count, normalized=True) for k in range(count + ends)]
    return [(float(p.x), float(p.y)) for p in found]


def _place(coordinates: Any, height: object, where: str, origin: Origin | None) -> tuple[str, str, str]:  # noqa: ANN401
    """Return the place as text, as a table would hold it."""
    numbers = coordinates if isinstance(coordinates, list) else []
    good = len(numbers) in (2, 3) and all(
        isinstance(v, int | float) and not isinstance(v, bool) for v in numbers
    )
    if not good or not np.isfinite(numbers).all():
        raise DataError(
            f"{where}: coordinates are {str(coordinates)[:60]}; two or three finite numbers were expected"
        )
    if height is None and len(numbers) == 2:
        raise DataError(f"{where}: has no height; give the property 'height', m above the ground")
    z = str(numbers[2] if height is None else height)
    x, y = float(numbers[0]), float(numbers[1])
    if origin is not None:
        at = np.array([[x, y]])
        check_degrees(at, where, origin)
        x, y = enu_from_geodetic(at[:, 1], at[:, 0], np.array([origin.altitude_m]), origin)[0, :2].tolist()
    return repr(x), repr(y), z
