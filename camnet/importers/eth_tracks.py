"""Tracks from ETH/UCY text files: frame, identity, x, y in metres, parted by blanks."""

from __future__ import annotations

from pathlib import Path

from camnet.errors import DataError
from camnet.importers._reading import number, text_lines
from camnet.importers.fixes import Fixes, TrackOptions, tracks_from_fixes
from camnet.motion.track import Track

__all__ = ["read_eth_tracks"]

_FIELDS = ("frame", "identity", "x", "y")


def read_eth_tracks(path: Path, options: TrackOptions) -> tuple[Track, ...]:
    """Read every pedestrian; time is ``options.frame_dt_s`` times the frame number.

    Raises
    ------
    DataError
        A row has not four numbers, or a frame or identity is no whole number.
    """
    fixes: dict[str, Fixes] = {}
    for line, text in text_lines(path):
        row = text.split()
        if not row:
            continue
        where = f"{path}, line {line}"
        if len(row) != len(_FIELDS):
            raise DataError(f"{where}: {len(row)} fields {text!r}; frame, identity, x and y were expected")
        frame, identity, x, y = (number(value, where, name) for value, name in zip(row, _FIELDS, strict=True))
        for name, value in (("frame", frame), ("identity", identity)):
            if value != int(value):
                raise DataError(
                    f"{where}: {name} is {value:g}; frame, identity, x and y were expected in this order"
                )
        fixes.setdefault(f"{identity:.0f}", Fixes()).add(options.frame_dt_s * frame, x, y, options.height_m)
    return tracks_from_fixes(fixes, str(path), options, geodetic=False)
