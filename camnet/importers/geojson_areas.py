"""Areas from GeoJSON (RFC 7946): polygons in longitude and latitude, or in the metres of a site without an origin."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from shapely.geometry import shape

from camnet.errors import DataError
from camnet.importers._reading import open_binary
from camnet.importers.geodesy import Origin, enu_from_geodetic
from camnet.types import Array

__all__ = ["NamedArea", "check_degrees", "read_areas", "read_geojson"]

_POLYGONS = ("Polygon", "MultiPolygon")


@dataclass(frozen=True, eq=False)
class NamedArea:
    """One area: ``name`` and polygons ``shape`` in the site's metres."""

    name: str
    shape: shapely.Geometry


def read_areas(path: Path, origin: Origin | None) -> tuple[NamedArea, ...]:
    """Read every polygon of a GeoJSON file.

    Parameters
    ----------
    path : a geometry, a feature or a collection of either; a feature is named by its property ``name``, else its ``id``
    origin : of the site's local frame; None: coordinates are the site's metres

    Raises
    ------
    DataError
        The file is no GeoJSON, holds no polygon, or a polygon crosses itself or lies elsewhere on Earth.
    """
    found: list[NamedArea] = []
    for name, geometry in _geometries(read_geojson(path), str(path)):
        words = name or f"area {len(found) + 1}"
        found.append(NamedArea(words, _polygon(geometry, f"{path}, {words!r}", origin)))
    if not found:
        raise DataError(f"{path}: holds no area; polygons of GeoJSON (RFC 7946) were expected")
    twice = [a.name for k, a in enumerate(found) if a.name in {b.name for b in found[:k]}]
    if twice:
        raise DataError(f"{path}: area {twice[0]!r} is there twice; give every area a name of its own")
    return tuple(found)


def read_geojson(path: Path) -> dict[str, Any]:
    """Return a GeoJSON object.

    Raises
    ------
    DataError
        The file is no JSON object with a ``type``.
    """
    with open_binary(path) as stream:
        data = stream.read()
    try:
        content = json.loads(data)
    except (ValueError, RecursionError) as error:
        raise DataError(f"{path}: is no JSON ({error}); GeoJSON (RFC 7946) was expected") from None
    if not isinstance(content, dict) or "type" not in content:
        raise DataError(f"{path}: has no 'type'; a GeoJSON object (RFC 7946) was expected")
    return content


def _geometries(content: object, where: str) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield name and geometry of every polygon in an object."""
    kind = content.get("type") if isinstance(content, dict) else None
    if not isinstance(content, dict) or kind is None:
        raise DataError(f"{where}: {str(content)[:60]!r} is no GeoJSON object")
    if kind == "FeatureCollection":
        for k, feature in enumerate(_list(content, "features", where)):
            yield from _geometries(feature, f"{where}, feature {k + 1}")
    elif kind == "Feature":
        properties = content.get("properties") or {}
        name = str(properties.get("name", content.get("id", ""))) if isinstance(properties, dict) else ""
        for _, geometry in _geometries(content.get("geometry"), where):
            yield name, geometry
    elif kind == "GeometryCollection":
        for geometry in _list(content, "geometries", where):
            yield from _geometries(geometry, where)
    elif kind in _POLYGONS:
        yield "", content
    else:
        raise DataError(f"{where}: a {str(kind)[:40]!r} has no area; {' or '.join(_POLYGONS)} was expected")


def _list(content: dict[str, Any], key: str, where: str) -> list[Any]:
    value = content.get(key)
    if not isinstance(value, list):
        raise DataError(f"{where}: {key!r} is {str(value)[:40]!r}; a list was expected")
    return value


def _polygon(geometry: dict[str, Any], where: str, origin: Origin | None) -> shapely.Geometry:
    try:
        area = shapely.force_2d(shape(geometry))
    except (ValueError, TypeError, KeyError, IndexError, shapely.errors.ShapelyError) as error:
        raise DataError(f"{where}: its coordinates are no rings of positions ({error})") from None
    corners = shapely.get_coordinates(area)
    if len(corners) == 0 or not np.isfinite(corners).all():
        raise DataError(f"{where}: has no corners, or corners that are not finite")
    if origin is not None:
        check_degrees(corners, where, origin)
        area = shapely.transform(area, lambda lon_lat: _metres(lon_lat, origin))
    if not area.is_valid or not area.area > 0.0:
        raise DataError(
            f"{where}: is no area ({shapely.is_valid_reason(area)}); list the corners in order around the border"
        )
    return area


def _metres(lon_lat: Array, origin: Origin) -> Array:
    altitude = np.full(len(lon_lat), origin.altitude_m)
    return enu_from_geodetic(lon_lat[:, 1], lon_lat[:, 0], altitude, origin)[:, :2]


def check_degrees(corners: Array, where: str, origin: Origin) -> None:
    """Refuse longitudes and latitudes (n, 2) that are more than a degree from the origin."""
    away = np.abs(corners - (origin.longitude_deg, origin.latitude_deg)).max(axis=0)
    if away.max() > 1.0:
        k = int(np.abs(corners - (origin.longitude_deg, origin.latitude_deg)).max(axis=1).argmax())
        raise DataError(
            f"{where}: corner {corners[k].tolist()} is more than a degree from the origin (longitude "
            f"{origin.longitude_deg:g}, latitude {origin.latitude_deg:g}); longitude, then latitude was expected"
        )
