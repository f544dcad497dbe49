"""A reader of tracks: lines of identity, x and y in metres, time in seconds, with blanks between them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from camnet.errors import DataError
from camnet.importers.fixes import TrackOptions
from camnet.motion.track import Track

__all__ = ["read_xyt"]


def read_xyt(path: Path, options: TrackOptions) -> list[Track]:
    """Return the tracks of a file.

    Raises
    ------
    DataError
        A line is something else.
    """
    rows: dict[str, list[tuple[float, float, float]]] = {}
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1):
        try:
            name, x, y, t_s = line.split()
            rows.setdefault(name, []).append((float(t_s), float(x), float(y)))
        except ValueError:
            raise DataError(f"{path}, line {number}: {line!r}: identity x y t was expected") from None
    tables = {name: np.array(sorted(row)) for name, row in rows.items()}
    return [Track(name, a[:, 0], np.column_stack([a[:, 1:], np.zeros(len(a))])) for name, a in tables.items()]
