"""Recorded tracks from any of the formats read here.

`read_tracks` reads every track of a file; `load_tracks` those that a target's settings name.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Literal

from camnet.errors import DataError
from camnet.importers.csv_tracks import read_csv_tracks
from camnet.importers.eth_tracks import read_eth_tracks
from camnet.importers.fcd_tracks import read_fcd_tracks
from camnet.importers.fixes import TrackOptions
from camnet.importers.geodesy import Origin
from camnet.importers.gpx_tracks import read_gpx_tracks
from camnet.motion.settings import TrackTarget
from camnet.motion.track import Track

__all__ = ["Origin", "Track", "TrackOptions", "load_tracks", "only_track", "read_tracks"]

_READERS: dict[str, Callable[[Path, TrackOptions], tuple[Track, ...]]] = {
    "csv": read_csv_tracks,
    "gpx": read_gpx_tracks,
    "fcd": read_fcd_tracks,
    "eth": read_eth_tracks,
}


def read_tracks(
    path: str | Path, format: Literal["csv", "gpx", "fcd", "eth"], options: TrackOptions | None = None
) -> tuple[Track, ...]:
    """Read every track of a file.

    Parameters
    ----------
    path : the file; ``.gz`` is unpacked
    format : ``csv`` (columns by their names), ``gpx``, ``fcd`` (SUMO), ``eth`` (ETH/UCY text)
    options : origin, heights, cleaning

    Raises
    ------
    DataError
        Whatever is wrong with the file, with line, field and value.
    """
    if format not in _READERS:
        raise DataError(f"track format {format!r} is unknown; one of {', '.join(_READERS)} was expected")
    return _READERS[format](Path(path), options or TrackOptions())


def load_tracks(
    settings: TrackTarget, folder: str | Path = ".", max_gap_s: float | None = None
) -> tuple[Track, ...]:
    """Read the tracks that a target's settings name.

    Parameters
    ----------
    settings : file (relative to ``folder``), format, identity, origin, height
    folder : where recorded data lie
    max_gap_s : split where fixes lie farther apart

    Returns
    -------
    tracks
        Those of the identity ``settings.id`` (several if split), or all where it is None.
    """
    origin = None if settings.origin is None else Origin(*settings.origin)
    options = TrackOptions(origin, settings.height_m, max_gap_s=max_gap_s, frame_dt_s=settings.frame_dt_s)
    path = Path(folder) / settings.file
    tracks = read_tracks(path, settings.format, options)
    if settings.id is None:
        return tracks
    chosen = tuple(
        track for track in tracks if track.id.rpartition("#")[0] == settings.id or track.id == settings.id
    )
    if not chosen:
        raise DataError(
            f"{path}: has no track {settings.id!r}; it has {_listing(track.id for track in tracks)}"
        )
    return chosen


def only_track(tracks: Sequence[Track], where: str) -> Track:
    """Return the one track there is; several are an error that lists them."""
    if len(tracks) != 1:
        raise DataError(
            f"{where}: holds {len(tracks)} tracks where one was expected; "
            f"choose an id: {_listing(track.id for track in tracks)}"
        )
    return tracks[0]


def _listing(identities: Iterable[str], shown: int = 12) -> str:
    names = list(dict.fromkeys(identities))
    more = f", ... ({len(names)} in all)" if len(names) > shown else ""
    return ", ".join(names[:shown]) + more
