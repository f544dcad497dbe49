"""GeoJSON as RFC 7946 has it: WGS84, longitude before latitude, closed rings, outer ones counter-clockwise."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from shapely.geometry.polygon import orient

from camnet.errors import DataError
from camnet.importers.geodesy import Origin, geodetic_from_enu
from camnet.types import Array

__all__ = ["GeoFeature", "feature_collection"]

#: decimals of degrees (1 cm or better: 1e-8 degrees are 1.1 mm) and of metres
_DEGREES, _METRES = 8, 3


@dataclass(frozen=True, eq=False)
class GeoFeature:
    """A point (3,) or polygons in the site's metres (east, north, up), with the properties of the feature."""

    geometry: Array | Sequence[shapely.Polygon]
    properties: dict[str, Any]


def feature_collection(features: Iterable[GeoFeature], origin: Origin, up_m: float) -> dict[str, Any]:
    """Return a FeatureCollection.

    Parameters
    ----------
    features : what it holds; features without any polygon have the geometry null
    origin : of the site's frame
    up_m : height of the polygons above the plane z = 0, m

    Raises
    ------
    DataError
        The site crosses the 180th meridian, where the standard asks for polygons to be cut.
    """
    rows = [_feature(feature, origin, up_m) for feature in features]
    return {"type": "FeatureCollection", "features": rows}


def _feature(feature: GeoFeature, origin: Origin, up_m: float) -> dict[str, Any]:
    geometry: dict[str, Any] | None
    if isinstance(feature.geometry, np.ndarray):
        lon, lat, alt = geodetic_from_enu(feature.geometry[None], origin)[0].tolist()
        place = [round(lon, _DEGREES), round(lat, _DEGREES), round(alt, _METRES)]
        geometry = {"type": "Point", "coordinates": place}
    else:
        parts = [_rings(polygon, origin, up_m) for polygon in feature.geometry]
        parts = [rings for rings in parts if rings]
        geometry = None
        if len(parts) == 1:
            geometry = {"type": "Polygon", "coordinates": parts[0]}
        elif parts:
            geometry = {"type": "MultiPolygon", "coordinates": parts}
    return {"type": "Feature", "geometry": geometry, "properties": feature.properties}


def _rings(polygon: shapely.Polygon, origin: Origin, up_m: float) -> list[list[list[float]]]:
    """Return the rings of a polygon, the outer one first; none where it is smaller than the rounding."""
    turned = orient(polygon, 1.0)
    rings = [_ring(np.asarray(ring.coords), origin, up_m) for ring in (turned.exterior, *turned.interiors)]
    return [ring for ring in rings if ring] if rings[0] else []


def _ring(corners: Array, origin: Origin, up_m: float) -> list[list[float]]:
    places = geodetic_from_enu(np.c_[corners[:, :2], np.full(len(corners), up_m)], origin)[:, :2]
    if np.ptp(places[:, 0]) > 180.0:
        raise DataError(
            f"origin {origin.latitude_deg:g}, {origin.longitude_deg:g}: the site crosses the 180th meridian; GeoJSON "
            "of such sites is not supported"
        )
    places = np.round(places, _DEGREES)
    places = places[np.r_[True, np.any(np.diff(places, axis=0) != 0.0, axis=1)]]
    ring: list[list[float]] = places.tolist()
    return ring if len(ring) >= 4 else []
