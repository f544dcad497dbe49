"""Mounts of cameras from GeoJSON (RFC 7946): points with their height and the directions that each allows."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from camnet.errors import DataError
from camnet.importers._reading import known_columns
from camnet.importers.geodesy import Origin, enu_from_geodetic
from camnet.importers.geojson_areas import check_degrees, read_geojson
from camnet.importers.mounts import OPTIONAL_FIELDS, Mount, mount_of

__all__ = ["read_geojson_mounts"]


def read_geojson_mounts(path: Path, origin: Origin | None) -> tuple[Mount, ...]:
    """Read a collection of points with the property ``name`` and, if wanted, those of ``read_mounts``'s columns.

    Parameters
    ----------
    path : features of points; ``height`` is the mount's height above the ground of the site, m, else the third
        coordinate: metres above the origin's altitude too
    origin : of the site's local frame, for longitudes and latitudes; None: coordinates are the site's metres

    Raises
    ------
    DataError
        The file is no collection of points, a point has no height or name, a name is there twice, or a value is not a
        number in its range.
    """
    content = read_geojson(path)
    features = content.get("features")
    if content["type"] != "FeatureCollection" or not isinstance(features, list) or not features:
        raise DataError(f"{path}: a FeatureCollection of points, one a mount, was expected")
    found: dict[str, Mount] = {}
    for k, feature in enumerate(features):
        where = f"{path}, feature {k + 1}"
        mount = _mount(feature, where, origin)
        if not mount.name or mount.name in found:
            raise DataError(f"{where}: name is {mount.name!r}; a name that no other feature has was expected")
        found[mount.name] = mount
    return tuple(found.values())


def _mount(feature: object, where: str, origin: Origin | None) -> Mount:
    if not isinstance(feature, dict) or not isinstance(feature.get("geometry"), dict):
        raise DataError(f"{where}: is no feature with a geometry")
    geometry, said = feature["geometry"], feature.get("properties") or {}
    if geometry.get("type") != "Point" or not isinstance(said, dict):
        raise DataError(
            f"{where}: a point with properties was expected, not a {str(geometry.get('type'))[:40]!r}"
        )
    known_columns(list(said), ("name", "height", *OPTIONAL_FIELDS), where)
    x, y, z = _place(geometry.get("coordinates"), said.get("height"), where, origin)
    fields = {name: said.get(name) for name in OPTIONAL_FIELDS}
    row = {name: "" if value is None else str(value) for name, value in fields.items()}
    return mount_of({"name": str(said.get("name", "")), "x": x, "y": y, "z": z, **row}, where)


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
