"""Proposes operating regions: the square areas that most recorded tracks pass.

A greedy maximum-coverage choice on a grid: count, for every position of a square window, the distinct tracks that
enter it; take the best, set it aside with a margin, and go on. Distinct tracks count, not fixes, so a queue at a
red light does not outweigh a street that everybody drives through.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree

from camnet.errors import DataError
from camnet.motion.track import Track
from camnet.types import Array, IntArray

__all__ = ["BusyRegion", "Visit", "busiest_regions", "visits"]

#: grid cells along the side of a square: the resolution of the choice
_CELLS_ACROSS = 8


@dataclass(frozen=True, slots=True)
class BusyRegion:
    """A square ``[min, max]`` in the ground plane (m) and the number of distinct tracks that enter it."""

    min_m: tuple[float, float]
    max_m: tuple[float, float]
    tracks: int


@dataclass(frozen=True, slots=True)
class Visit:
    """One stay of a track in a region: its index, and the times of the first and last instant inside, s."""

    region: int
    enter_s: float
    leave_s: float


def busiest_regions(
    tracks: Sequence[Track],
    size_m: float,
    count: int,
    margin_m: float = 0.0,
    centers_m: Array | None = None,
) -> tuple[BusyRegion, ...]:
    """Choose up to ``count`` squares that do not overlap, the busiest first.

    Parameters
    ----------
    tracks : recorded tracks; between two fixes a track is taken as straight
    size_m : side of a square
    count : how many to choose; fewer come back when the traffic is exhausted
    margin_m : least distance between two squares
    centers_m : (k, 2) where squares may be centred (junctions, say); anywhere on a grid of an eighth of the side
        when None

    Raises
    ------
    DataError
        No tracks, or a number out of range.
    """
    _check(tracks, size_m, count, margin_m)
    cell_m = size_m / _CELLS_ACROSS
    paths = [_dense(track, cell_m / 2)[1] for track in tracks]
    if centers_m is None:
        corners, passing = _on_grid(paths, cell_m)
    else:
        corners, passing = _at_centers(paths, np.asarray(centers_m, dtype=np.float64), size_m)
    chosen: list[BusyRegion] = []
    while len(chosen) < count and passing.size and passing.max() > 0:
        best = int(np.argmax(passing))
        x, y = (round(float(value), 6) for value in corners[best])
        chosen.append(BusyRegion((x, y), (x + size_m, y + size_m), int(passing[best])))
        clear = np.any(np.abs(corners - corners[best]) >= size_m + margin_m - 1e-9, axis=1)
        corners, passing = corners[clear], passing[clear]
    return tuple(chosen)


def visits(track: Track, regions: Sequence[BusyRegion], step_m: float = 1.0) -> tuple[Visit, ...]:
    """List a track's stays in the regions, in the order of time; between fixes the track is taken as straight."""
    t_s, path = _dense(track, step_m)
    found = []
    for index, region in enumerate(regions):
        inside = np.all((path >= region.min_m) & (path <= region.max_m), axis=1).astype(int)
        edges = np.flatnonzero(np.diff(np.concatenate([[0], inside, [0]])))
        for first, last in edges.reshape(-1, 2):
            found.append(Visit(index, float(t_s[first]), float(t_s[last - 1])))
    return tuple(sorted(found, key=lambda visit: visit.enter_s))


def _check(tracks: Sequence[Track], size_m: float, count: int, margin_m: float) -> None:
    if not tracks:
        raise DataError("busiest_regions: no track was given; at least one was expected")
    for name, value in (("size_m", size_m), ("count", count)):
        if not (np.isfinite(value) and value > 0):
            raise DataError(f"busiest_regions: {name} is {value}; more than 0 was expected")
    if not (np.isfinite(margin_m) and margin_m >= 0):
        raise DataError(f"busiest_regions: margin_m is {margin_m}; 0 or more was expected")


def _dense(track: Track, step_m: float) -> tuple[Array, Array]:
    """Fill a track up to times (k,) and positions (k, 2) at most ``step_m`` apart."""
    p, t = track.p_world[:, :2], track.t_s
    pieces = np.maximum(1, np.ceil(np.linalg.norm(np.diff(p, axis=0), axis=1) / step_m)).astype(int)
    index = np.repeat(np.arange(t.size - 1), pieces)
    starts = np.repeat(np.cumsum(pieces) - pieces, pieces)
    fraction = (np.arange(index.size) - starts) / pieces[index]
    dense_t = np.append(t[index] + fraction * (t[index + 1] - t[index]), t[-1])
    dense_p = np.vstack([p[index] + fraction[:, None] * (p[index + 1] - p[index]), p[-1:]])
    return dense_t, dense_p


def _at_centers(paths: Sequence[Array], centers: Array, size_m: float) -> tuple[Array, Array]:
    """Lower corners (k, 2) of the squares about ``centers`` and the distinct tracks (k,) that enter each."""
    passing = np.zeros(len(centers))
    for path in paths:
        inside = cKDTree(path).query_ball_point(centers, size_m / 2, p=np.inf, return_length=True)
        passing += np.asarray(inside) > 0
    return centers - size_m / 2, passing


def _on_grid(paths: Sequence[Array], cell_m: float) -> tuple[Array, Array]:
    """Lower corners (k, 2) of the squares of the grid and the distinct tracks (k,) that enter each.

    To a count comes less than one for how busy the surroundings are, which breaks ties and so centres a square
    on its junction.
    """
    origin = np.min([path.min(axis=0) for path in paths], axis=0) - _CELLS_ACROSS * cell_m
    extent = np.max([path.max(axis=0) for path in paths], axis=0) - origin
    shape = (np.floor(extent / cell_m) + 1).astype(int)
    cells = [np.floor((path - origin) / cell_m).astype(np.int64) for path in paths]
    counts = _window_counts(cells, (int(shape[0]), int(shape[1])), _CELLS_ACROSS)
    ties = ndimage.gaussian_filter(counts, _CELLS_ACROSS / 4) / (counts.max() + 1.0)
    used = np.argwhere(counts > 0)
    return origin + cell_m * used, (counts + ties)[counts > 0]


def _window_counts(cells: Sequence[IntArray], shape: tuple[int, int], across: int) -> Array:
    """Count, for the window of ``across`` cells a side that begins at each cell, the distinct tracks inside."""
    counts = np.zeros(int(np.prod(shape)))
    steps = np.arange(across)
    i_step, j_step = (grid.ravel() for grid in np.meshgrid(steps, steps, indexing="ij"))
    for own in cells:
        flat = np.unique(own[:, 0] * shape[1] + own[:, 1])
        # a cell lies in the windows that begin at it or up to across - 1 cells before it
        starts = flat[:, None] - (i_step * shape[1] + j_step)
        counts[np.unique(starts)] += 1
    return counts.reshape(shape)
