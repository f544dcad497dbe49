"""Where the kernels go: on a grid over a box, along roads, or whichever the world suggests.

Published placements: 9 x 9 on a grid (parikh2018, experiment 1); every 0.3 m along the roads with two headings
(experiment 2). A kernel that data never reaches costs time and keeps the smallest eigenvalue of the stack at zero.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.cluster.vq import kmeans2
from scipy.spatial import cKDTree

from camnet.errors import ConfigError
from camnet.estimation.basis import RbfBasis
from camnet.estimation.settings import BasisSettings
from camnet.geometry.settings import Road
from camnet.types import Array

#: points of a grid that are looked at; far more than any number of kernels
_MOST_POINTS = 4_000_000

__all__ = ["grid_centres", "place_basis", "place_on_data", "road_centres"]


def grid_centres(low: Array, high: Array, spacing_m: float) -> Array:
    """Centres (p, 2) on a square grid that covers the rectangle from ``low`` (2,) to ``high`` (2,), centred in it."""
    axes = []
    for a, b in zip(low[:2], high[:2], strict=True):
        steps = max(0, math.ceil((b - a) / spacing_m - 1e-9))
        axes.append(0.5 * (a + b) + spacing_m * (np.arange(steps + 1) - 0.5 * steps))
    x, y = np.meshgrid(*axes, indexing="ij")
    return np.column_stack((x.ravel(), y.ravel()))


def _segments(road: Road) -> tuple[Array, Array]:
    points = np.asarray(road.points_m, dtype=float)
    if len(points) < 2:
        raise ConfigError(f"road {road.name!r}: {len(points)} point(s), at least 2 are needed")
    ends = np.roll(points, -1, axis=0) if road.closed else points[1:]
    starts = points if road.closed else points[:-1]
    return starts, ends


def distance_to_roads(xy: Array, roads: Sequence[Road], within_m: float = math.inf) -> tuple[Array, Array]:
    """Distance (n,) of points (n, 2) from the nearest road, m, and that road's direction there (n,), rad.

    Points further than ``within_m`` from every road may keep an infinite distance, which saves most of the work.
    """
    best = np.full(len(xy), np.inf)
    direction = np.zeros(len(xy))
    order = np.argsort(xy[:, 0], kind="stable")
    x = xy[order, 0]
    for road in roads:
        for a, b in zip(*_segments(road), strict=True):
            first = int(np.searchsorted(x, min(a[0], b[0]) - within_m, side="left"))
            last = int(np.searchsorted(x, max(a[0], b[0]) + within_m, side="right"))
            near = order[first:last]
            y = xy[near, 1]
            near = near[(y >= min(a[1], b[1]) - within_m) & (y <= max(a[1], b[1]) + within_m)]
            d, points = b - a, xy[near]
            length2 = float(d @ d)
            share = np.clip((points - a) @ d / length2, 0.0, 1.0) if length2 > 0.0 else np.zeros(len(near))
            distance = np.linalg.norm(points - a - share[:, None] * d, axis=1)
            closer = distance < best[near]
            best[near[closer]] = distance[closer]
            direction[near[closer]] = math.atan2(d[1], d[0])
    return best, direction


def road_centres(roads: Sequence[Road], spacing_m: float, margin_m: float) -> Array:
    """Centres (p, 2): the grid points within ``margin_m`` of a road's centre line.

    A grid cut along the roads has the same density on straights, bends and junctions; rows that follow each road
    would crowd where roads meet.
    """
    points = _all_points(roads)
    grid = grid_centres(points.min(axis=0) - margin_m, points.max(axis=0) + margin_m, spacing_m)
    distance, _ = distance_to_roads(grid, roads, margin_m)
    return grid[distance <= margin_m]


def _all_points(roads: Sequence[Road]) -> Array:
    if not roads:
        raise ConfigError("basis placement 'road': the world has no roads; use 'grid' or 'auto'")
    return np.vstack([np.asarray(road.points_m, dtype=float) for road in roads])


def _grid_size(low: Array, high: Array, spacing_m: float, margin_m: float) -> float:
    """Points of a grid over the rectangle and its margin."""
    return float(np.prod((high[:2] - low[:2] + 2.0 * margin_m) / spacing_m + 1.0))


def _with_headings(
    centres: Array, roads: Sequence[Road], along_roads: bool, settings: BasisSettings
) -> Array:
    """Centres (p, 4): with both directions of the nearest road, or with headings all round."""
    scale = settings.heading_scale_m
    if along_roads:
        _, direction = distance_to_roads(centres, roads)
        headings = np.stack((direction, direction + math.pi), axis=1)
    else:
        turn = 2.0 * math.pi * np.arange(settings.headings) / settings.headings
        headings = np.tile(turn, (len(centres), 1))
    count = headings.shape[1]
    xy = np.repeat(centres, count, axis=0)
    psi = headings.ravel()
    return np.column_stack((xy, scale * np.cos(psi), scale * np.sin(psi)))


def place_basis(settings: BasisSettings, roads: Sequence[Road], low: Array, high: Array) -> RbfBasis:
    """Basis for a world with ``roads`` whose regions and gaps lie in the box from ``low`` to ``high`` (2,) or (3,), m.

    If more than ``max_kernels`` would be needed, spacing and width grow together until they are enough.

    Raises
    ------
    ConfigError
        If roads are asked for and there are none, or the box is not finite.
    """
    low, high = np.asarray(low, dtype=float)[:2], np.asarray(high, dtype=float)[:2]
    along = settings.placement == "road" or (settings.placement == "auto" and len(roads) > 0)
    if not along and not (np.isfinite(low).all() and np.isfinite(high).all() and (low <= high).all()):
        raise ConfigError(
            f"basis placement 'grid': box {low.tolist()} to {high.tolist()} is not a finite box"
        )
    scale = 1.0
    points = _all_points(roads) if along else np.stack([low, high])
    corners = points.min(axis=0), points.max(axis=0)
    while _grid_size(*corners, scale * settings.spacing_m, settings.margin_m) > _MOST_POINTS:
        scale *= 1.1
    while True:
        spacing = scale * settings.spacing_m
        if along:
            centres = road_centres(roads, spacing, max(settings.margin_m, 0.75 * spacing))
        else:
            centres = grid_centres(low - settings.margin_m, high + settings.margin_m, spacing)
        if settings.inputs == "position_heading":
            centres = _with_headings(centres, roads, along, settings)
        if len(centres) <= settings.max_kernels:
            break
        scale *= 1.1
    width = scale * settings.width_m
    return RbfBasis.create(centres, width * width, settings.heading_scale_m)


def place_on_data(
    points: Array, count: int, rng: np.random.Generator, heading_scale_m: float = 1.0, overlap: float = 1.0
) -> RbfBasis:
    """Basis of at most ``count`` kernels where targets have been: k-means centres, one width for each.

    The width is ``overlap`` times the distance to the nearest other centre. Kernels that no point is nearest to are
    left out.

    Parameters
    ----------
    points : (n, 2) positions, m, or (n, 4) positions and ``heading_scale_m`` times the direction of the heading
    count : number of kernels asked for
    rng : draws the first centres
    heading_scale_m : radius of the heading circle, m
    overlap : width over distance

    Raises
    ------
    ConfigError
        If there are fewer different points than kernels, or ``overlap`` is not positive.
    """
    points = np.asarray(points, dtype=float)
    if points.ndim != 2 or points.shape[1] not in (2, 4) or not np.isfinite(points).all():
        raise ConfigError(
            f"basis from data: points of shape {points.shape}, expected finite (n, 2) or (n, 4)"
        )
    different = len(np.unique(points, axis=0))
    if not 2 <= count <= different:
        raise ConfigError(f"basis from data: count {count}, expected 2 ... {different}, the number of points")
    if not overlap > 0.0:
        raise ConfigError(f"basis from data: overlap {overlap}, expected a positive factor")
    centres, labels = kmeans2(points, count, minit="++", rng=rng)
    centres = centres[np.unique(labels)]
    if len(centres) < 2:
        raise ConfigError("basis from data: all points fell to one centre; give more different points")
    distance, _ = cKDTree(centres).query(centres, k=2)
    width = np.maximum(overlap * np.asarray(distance)[:, 1], 1e-6)
    return RbfBasis.create(centres, width[:, None, None] ** 2 * np.eye(points.shape[1]), heading_scale_m)
