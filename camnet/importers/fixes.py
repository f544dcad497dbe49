"""From the rows of a track file to clean tracks, the same way for every format.

Readers of single formats collect `Fixes` (rows as they stand in the file); `tracks_from_fixes` sorts them by time,
drops repeated times, converts latitudes and longitudes, and splits at long gaps.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise
from typing import Literal

import numpy as np

from camnet.errors import DataError
from camnet.importers.geodesy import Origin, enu_from_geodetic
from camnet.motion.track import Track
from camnet.types import Array, IntArray

__all__ = ["Fixes", "TrackOptions", "tracks_from_fixes"]

#: how far from its origin a local frame still is one, m
_LOCAL_M = 200_000.0
#: farthest place of a track in metres: projected coordinates of any zone on Earth are nearer, m
_FARTHEST_M = 2e7
#: fixes of one identity at one time that lie farther apart are two targets, m
_SAME_PLACE_M = 20.0


@dataclass(frozen=True, slots=True)
class TrackOptions:
    """How files become tracks.

    Attributes
    ----------
    origin : local frame of latitudes and longitudes (needed for those alone)
    height_m : z of the tracks where the file's height is absent or unused
    use_altitude : take the file's height (GPS heights are poor, so this is off)
    order : ``sort`` rows of one identity by time, or make a step back in time an ``error``
    max_gap_s : split a track where fixes lie farther apart; the pieces are named ``id#1``, ``id#2``, ...
    min_fixes : leave out tracks (after splitting) with fewer fixes
    frame_dt_s : time of one frame number in ETH/UCY files (25 frames a second)
    """

    origin: Origin | None = None
    height_m: float = 0.0
    use_altitude: bool = False
    order: Literal["sort", "error"] = "sort"
    max_gap_s: float | None = None
    min_fixes: int = 1
    frame_dt_s: float = 0.04

    def __post_init__(self) -> None:
        if self.max_gap_s is not None and not self.max_gap_s > 0:
            raise DataError(f"max_gap_s is {self.max_gap_s}; a positive time in seconds was expected")
        if not 0 < self.frame_dt_s < float("inf"):
            raise DataError(f"frame_dt_s is {self.frame_dt_s}; a positive time in seconds was expected")


@dataclass(slots=True)
class Fixes:
    """Rows of one identity, in the order of the file."""

    t_s: list[float] = field(default_factory=list)
    x: list[float] = field(default_factory=list)
    y: list[float] = field(default_factory=list)
    z: list[float] = field(default_factory=list)
    heading_rad: list[float] = field(default_factory=list)
    speed_mps: list[float] = field(default_factory=list)

    def add(self, t_s: float, x: float, y: float, z: float) -> None:
        """Append one fix without heading and speed."""
        self.t_s.append(t_s)
        self.x.append(x)
        self.y.append(y)
        self.z.append(z)

    def localise(self, where: str, options: TrackOptions) -> None:
        """Turn longitudes (x), latitudes (y) and heights (z) into local metres."""
        if options.origin is None:
            raise DataError(
                f"{where}: holds latitudes and longitudes, but no origin was given; "
                "name the latitude, longitude and altitude of the local frame"
            )
        altitude = (
            np.asarray(self.z) if options.use_altitude else np.full(len(self.x), options.origin.altitude_m)
        )
        enu = enu_from_geodetic(np.asarray(self.y), np.asarray(self.x), altitude, options.origin)
        away = np.linalg.norm(enu[:, :2], axis=1)
        k = int(np.argmax(away))
        if away[k] > _LOCAL_M:
            raise DataError(
                f"{where}: latitude {self.y[k]:.6g}, longitude {self.x[k]:.6g} lies {away[k] / 1000:.0f} km from the "
                f"origin {options.origin.latitude_deg:g}, {options.origin.longitude_deg:g}; at most "
                f"{_LOCAL_M / 1000:.0f} km was expected: are latitude and longitude swapped?"
            )
        self.x, self.y = enu[:, 0].tolist(), enu[:, 1].tolist()
        self.z = enu[:, 2].tolist() if options.use_altitude else [options.height_m] * len(self.x)

    def track(self, identity: str, where: str, order: Literal["sort", "error"]) -> Track:
        """Sort by time (stably), keep the first of several fixes at one time, and freeze."""
        t = np.asarray(self.t_s)
        back = np.flatnonzero(np.diff(t) < 0)
        if order == "error" and back.size:
            raise DataError(
                f"{where}: track {identity!r} steps back in time from {t[back[0]]} to {t[back[0] + 1]} s; "
                "rows in the order of time were expected"
            )
        farthest = max(map(abs, (*self.x, *self.y)), default=0.0)
        if farthest > _FARTHEST_M:
            raise DataError(
                f"{where}: track {identity!r} is {farthest:.4g} m from the origin, more than {_FARTHEST_M:g} m"
            )
        chosen = np.unique(t, return_index=True)[1]
        self._at_one_place(identity, where, t, chosen)
        heading = np.asarray(self.heading_rad)[chosen] if self.heading_rad else None
        speed = np.asarray(self.speed_mps)[chosen] if self.speed_mps else None
        return Track(identity, t[chosen], np.column_stack([self.x, self.y, self.z])[chosen], heading, speed)

    def _at_one_place(self, identity: str, where: str, t: Array, chosen: IntArray) -> None:
        """Refuse fixes of one identity at one time that no receiver's noise explains: two targets of one name."""
        if len(chosen) == len(t):
            return
        p = np.column_stack([self.x, self.y])
        apart = np.linalg.norm(p - p[chosen][np.searchsorted(t[chosen], t)], axis=1)
        k = int(np.argmax(apart))
        if apart[k] > _SAME_PLACE_M:
            raise DataError(
                f"{where}: track {identity!r} is at two places at {t[k]:.10g} s, {apart[k]:.4g} m apart; "
                "different targets need different names"
            )


def tracks_from_fixes(
    fixes: dict[str, Fixes], where: str, options: TrackOptions, geodetic: bool
) -> tuple[Track, ...]:
    """Make clean tracks, in the order in which the identities first appear.

    Parameters
    ----------
    fixes : rows by identity
    where : the file, for messages
    options : how to clean
    geodetic : x are longitudes and y latitudes, to be converted to metres about ``options.origin``
    """
    if geodetic:
        for rows in fixes.values():
            rows.localise(where, options)
    tracks = [
        piece
        for identity, rows in fixes.items()
        for piece in _split(rows.track(identity, where, options.order), options.max_gap_s)
        if piece.t_s.size >= options.min_fixes
    ]
    if not tracks:
        raise DataError(f"{where}: holds no track of at least {options.min_fixes} fixes")
    return tuple(tracks)


def _split(track: Track, max_gap_s: float | None) -> list[Track]:
    if max_gap_s is None:
        return [track]
    cuts = np.flatnonzero(np.diff(track.t_s) > max_gap_s) + 1
    if cuts.size == 0:
        return [track]
    edges = [0, *cuts.tolist(), track.t_s.size]
    pieces = [track.select(a, b) for a, b in pairwise(edges)]
    return [
        Track(f"{track.id}#{k}", piece.t_s, piece.p_world, piece.heading_rad, piece.speed_mps)
        for k, piece in enumerate(pieces, start=1)
    ]
