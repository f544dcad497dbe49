"""Tracks from GPX 1.0 and 1.1: each ``<trk>`` is one track, whatever its segments."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from camnet.errors import DataError
from camnet.importers._clock import Clock
from camnet.importers._reading import Place, number, parse_xml
from camnet.importers.fixes import Fixes, TrackOptions, tracks_from_fixes
from camnet.importers.geodesy import latitude, longitude
from camnet.motion.track import Track

__all__ = ["read_gpx_tracks"]


def read_gpx_tracks(path: Path, options: TrackOptions) -> tuple[Track, ...]:
    """Read every track of a GPX file; waypoints and routes are left aside.

    A track is named by its ``<name>``, else by the file; a name that returns gets a number.

    Raises
    ------
    DataError
        Not GPX, a point without latitude, longitude or time, a value out of range, or no track at all.
    """
    reader = _GpxReader(path.name.partition(".")[0])
    parse_xml(path, "gpx", reader.start, reader.end)
    if not reader.fixes:
        raise DataError(f"{path}: has no track point (<trkpt> inside <trk>)")
    return tracks_from_fixes(reader.fixes, str(path), options, geodetic=True)


@dataclass(slots=True)
class _GpxReader:
    """Collects points as the elements go by."""

    stem: str
    fixes: dict[str, Fixes] = field(default_factory=dict)
    name: str = ""
    track: Fixes | None = None
    point: dict[str, float] | None = None
    clock: Clock = field(default_factory=Clock)

    def start(self, tag: str, attributes: dict[str, str], where: Place) -> None:
        """Open a track or a point."""
        if tag == "trk":
            self.track, self.name = Fixes(), ""
        elif tag == "trkpt" and self.track is not None:
            for key in ("lat", "lon"):
                if key not in attributes:
                    raise DataError(f"{where}: <trkpt> has no {key}")
            self.point = {
                "lat": latitude(attributes["lat"], where, "lat"),
                "lon": longitude(attributes["lon"], where, "lon"),
            }

    def end(self, tag: str, text: str, where: Place) -> None:
        """Take what an element held."""
        if self.point is not None:
            if tag == "time":
                self.point["time"] = self.clock.iso(text, where, "<time>")
            elif tag == "ele":
                self.point["ele"] = number(text, where, "<ele>")
            elif tag == "trkpt":
                self._close_point(where)
        elif self.track is not None:
            if tag == "name":
                self.name = text
            elif tag == "trk":
                self._close_track()

    def _close_point(self, where: Place) -> None:
        point, self.point = self.point, None
        if point is None or self.track is None:
            return
        if "time" not in point:
            raise DataError(f"{where}: <trkpt> has no <time>; a recorded track was expected, not a drawn one")
        self.track.add(point["time"], point["lon"], point["lat"], point.get("ele", 0.0))

    def _close_track(self) -> None:
        track, self.track = self.track, None
        if track is None or not track.t_s:
            return
        base = self.name or self.stem
        name, count = base, 1
        while name in self.fixes:
            count += 1
            name = f"{base} ({count})"
        self.fixes[name] = track
