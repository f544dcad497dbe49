"""Latitude and longitude to local metres: x east, y north, z up about an origin on the WGS84 ellipsoid."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pymap3d

from camnet.errors import DataError
from camnet.importers._reading import Place, number
from camnet.types import Array

__all__ = ["Origin", "enu_from_geodetic", "geodetic_from_enu", "latitude", "longitude"]


@dataclass(frozen=True, slots=True)
class Origin:
    """Where the local frame sits: degrees, and metres above the WGS84 ellipsoid."""

    latitude_deg: float
    longitude_deg: float
    altitude_m: float = 0.0

    def __post_init__(self) -> None:
        if not -90 <= self.latitude_deg <= 90:
            raise DataError(f"origin latitude is {self.latitude_deg}; -90 to 90 degrees was expected")
        if not -180 <= self.longitude_deg <= 180:
            raise DataError(f"origin longitude is {self.longitude_deg}; -180 to 180 degrees was expected")
        if not np.isfinite(self.altitude_m):
            raise DataError(f"origin altitude is {self.altitude_m}; finite metres were expected")


def enu_from_geodetic(latitude_deg: Array, longitude_deg: Array, altitude_m: Array, origin: Origin) -> Array:
    """Convert (n,) geodetic coordinates on WGS84 to (n, 3) east, north, up about ``origin``, in metres."""
    east, north, up = pymap3d.geodetic2enu(
        latitude_deg,
        longitude_deg,
        altitude_m,
        origin.latitude_deg,
        origin.longitude_deg,
        origin.altitude_m,
    )
    return np.stack([np.asarray(east), np.asarray(north), np.asarray(up)], axis=-1)


def geodetic_from_enu(p_world: Array, origin: Origin) -> Array:
    """Convert (n, 3) east, north, up about ``origin``, m, to (n, 3) longitude, latitude (degrees), altitude (m)."""
    p = np.asarray(p_world, dtype=float)
    lat, lon, alt = pymap3d.enu2geodetic(
        p[:, 0], p[:, 1], p[:, 2], origin.latitude_deg, origin.longitude_deg, origin.altitude_m
    )
    return np.stack([np.asarray(lon), np.asarray(lat), np.asarray(alt)], axis=-1)


def latitude(text: str, where: str | Place, field: str = "latitude") -> float:
    """Read a latitude in degrees; ``where`` is "file, line n"."""
    return _angle(text, where, field, 90.0)


def longitude(text: str, where: str | Place, field: str = "longitude") -> float:
    """Read a longitude in degrees; ``where`` is "file, line n"."""
    return _angle(text, where, field, 180.0)


def _angle(text: str, where: str | Place, field: str, limit: float) -> float:
    value = number(text, where, field)
    if not -limit <= value <= limit:
        raise DataError(f"{where}: {field} is {text!r}; {-limit:g} to {limit:g} degrees was expected")
    return value
