"""Windows and experience from recorded pedestrians (ETH/UCY): 8 samples seen, 12 to be predicted.

A sample is 0.4 s in all of these files but one: people in ``biwi_eth`` walk at 2.6 m/s if its 10 frames are taken for
0.4 s, so a step is longer there. Everything counts in samples, so that it does not matter.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from camnet.errors import DataError
from camnet.importers.tracks import TrackOptions, read_tracks
from camnet.types import Array, IntArray

__all__ = [
    "FUTURE",
    "OBSERVED",
    "SAMPLE_S",
    "Experience",
    "Walkers",
    "Windows",
    "experience_of",
    "load",
    "windows_of",
]

OBSERVED, FUTURE = 8, 12
SAMPLE_S = 0.4


@dataclass(frozen=True, eq=False, slots=True)
class Walkers:
    """Uninterrupted pieces of everybody's path: person, first sample, positions (k, 2) in m."""

    pieces: tuple[tuple[int, int, Array], ...]


@dataclass(frozen=True, eq=False, slots=True)
class Windows:
    """What is to be predicted.

    Attributes
    ----------
    person, now : (n,) who, and the sample at which the last position was seen
    seen : (n, 8, 2) positions up to now, m
    future : (n, 12, 2) displacements from the last position seen, m
    """

    person: IntArray
    now: IntArray
    seen: Array
    future: Array


@dataclass(frozen=True, eq=False, slots=True)
class Experience:
    """What people did, in the order of time: known of at sample t is what lies at or before t.

    Attributes
    ----------
    person, at : (m,) who, and the sample
    p, v : (m, 2), (m, 2) position (m) and displacement since the sample before (m)
    ahead : (m,) samples that follow, at most 12
    deviation : (m, 12, 2) position h samples later less ``p + h v``, m; zero beyond ``ahead``
    """

    person: IntArray
    at: IntArray
    p: Array
    v: Array
    ahead: IntArray
    deviation: Array


def load(path: Path) -> Walkers:
    """Read one text file.

    Raises
    ------
    DataError
        If the file cannot be read or has no two samples of anybody.
    """
    tracks = read_tracks(path, "eth", TrackOptions())
    steps = np.concatenate([np.diff(track.t_s) for track in tracks])
    if not len(steps):
        raise DataError(f"{path}: nobody is seen twice; tracks of several samples were expected")
    step_s = float(np.median(steps))
    pieces: list[tuple[int, int, Array]] = []
    for person, track in enumerate(tracks):
        sample = np.rint(track.t_s / step_s).astype(np.int64)
        cuts = np.flatnonzero(np.diff(sample) != 1) + 1
        for part in np.split(np.arange(len(sample)), cuts):
            pieces.append((person, int(sample[part[0]]), np.array(track.p_world[part, :2])))
    return Walkers(tuple(pieces))


def windows_of(walkers: Walkers) -> Windows:
    """Return every run of 20 consecutive samples, in the order of time.

    Raises
    ------
    DataError
        If there is none.
    """
    found = [
        (person, first + s, p[s - OBSERVED + 1 : s + 1], p[s + 1 : s + 1 + FUTURE] - p[s])
        for person, first, p in walkers.pieces
        for s in range(OBSERVED - 1, len(p) - FUTURE)
    ]
    if not found:
        raise DataError(
            f"no run of {OBSERVED + FUTURE} consecutive samples of one person; the tracks are too short"
        )
    found.sort(key=lambda w: (w[1], w[0]))
    person, now, seen, future = zip(*found, strict=True)
    return Windows(np.array(person), np.array(now), np.array(seen), np.array(future))


def experience_of(walkers: Walkers) -> Experience:
    """Every sample of everybody that has one before and one after it."""
    rows = []
    hs = np.arange(1.0, FUTURE + 1.0)[:, None]
    for person, first, p in walkers.pieces:
        for s in range(1, len(p) - 1):
            n = min(FUTURE, len(p) - 1 - s)
            step = p[s] - p[s - 1]
            departure = np.zeros((FUTURE, 2))
            departure[:n] = p[s + 1 : s + 1 + n] - p[s] - hs[:n] * step
            rows.append((first + s, person, p[s], step, n, departure))
    rows.sort(key=lambda r: (r[0], r[1]))
    columns = [np.array(column) for column in zip(*rows, strict=True)]
    at, who, places, steps, ahead, departures = columns
    return Experience(who, at, places, steps, ahead, departures)
