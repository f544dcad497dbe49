"""Tracks from SUMO's floating-car data (FCD): XML, one ``<timestep>`` after another.

Positions are those of the vehicle's front bumper in the network's metres; SUMO's angle is in degrees clockwise from
north and becomes a heading anticlockwise from x (east).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path

from camnet.errors import DataError
from camnet.importers._reading import Place, number, parse_xml
from camnet.importers.fixes import Fixes, TrackOptions, tracks_from_fixes
from camnet.motion.track import Track

__all__ = ["read_fcd_tracks"]


def read_fcd_tracks(path: Path, options: TrackOptions) -> tuple[Track, ...]:
    """Read every vehicle and person of an FCD file (``.gz`` allowed), with headings and speeds where it has them.

    Raises
    ------
    DataError
        Not FCD, an attribute is missing or no number, times do not increase, a vehicle is twice in one of them, or
        there is no vehicle at all.
    """
    reader = _FcdReader(options.height_m)
    parse_xml(path, "fcd-export", reader.start)
    if not reader.fixes:
        raise DataError(f"{path}: has no vehicle in any <timestep>")
    return tracks_from_fixes(reader.fixes, str(path), options, geodetic=False)


@dataclass(slots=True)
class _FcdReader:
    height_m: float
    t_s: float = math.nan
    fixes: dict[str, Fixes] = field(default_factory=dict)
    here: set[str] = field(default_factory=set)
    given: tuple[str, ...] | None = None

    def start(self, tag: str, attributes: dict[str, str], where: Place) -> None:
        """Take a time or a vehicle."""
        if tag == "timestep":
            t_s = number(_get(attributes, "time", tag, where), where, "time")
            if t_s <= self.t_s:
                raise DataError(
                    f"{where}: time is {t_s:g} s after {self.t_s:g} s; increasing times were expected"
                )
            self.t_s = t_s
            self.here.clear()
        elif tag in ("vehicle", "person"):
            if math.isnan(self.t_s):
                raise DataError(f"{where}: <{tag}> stands outside of a <timestep>")
            if self.given is None:  # --fcd-output.attributes may leave them out, then of every vehicle
                self.given = tuple(name for name in ("angle", "speed") if name in attributes)
            x, y, *rest = (
                number(_get(attributes, name, tag, where), where, name) for name in ("x", "y", *self.given)
            )
            more = dict(zip(self.given, rest, strict=True))
            identity = _get(attributes, "id", tag, where)
            if not identity or identity in self.here:
                raise DataError(
                    f"{where}: id is {identity!r}; a name that this <timestep> has once was expected"
                )
            self.here.add(identity)
            fixes = self.fixes.setdefault(identity, Fixes())
            fixes.add(self.t_s, x, y, self.height_m)
            if "angle" in more:
                fixes.heading_rad.append(math.remainder(math.radians(90.0 - more["angle"]), 2.0 * math.pi))
            if "speed" in more:
                fixes.speed_mps.append(more["speed"])


def _get(attributes: dict[str, str], name: str, tag: str, where: Place) -> str:
    if name not in attributes:
        raise DataError(f"{where}: <{tag}> has no attribute {name}; it has {', '.join(attributes) or 'none'}")
    return attributes[name]
