"""Sums over kernels in compiled loops: sigma at a pose, and the learned field W^T sigma along a path.

The kernels are those of `camnet.estimation.basis`, its cut-off included; that module is the oracle of this one. Where
all kernels have one diagonal covariance and lie on a regular grid (every shipped world), a kernel is a product of one
factor for its column and one for its row, and neighbouring factors follow from each other:

    exp(-1/2 a (x - c - i h)^2) = exp(-1/2 a (x - c)^2) [exp(a (x - c) h)]^i exp(-1/2 a i^2 h^2)

so a pose takes four exponentials in place of one for each kernel in reach. The result differs by rounding (relative
1e-14); which kernels are cut off is decided by the same expression as there.

| symbol | name | shape | unit |
| --- | --- | --- | --- |
| c | ``columns``, ``lines``: coordinates of the grid's columns (x) and lines (y) | (nx,), (ny,) | m |
| a | ``precision_x``, ``precision_y`` | - | 1/m^2 |
| h | ``spacing`` | - | m |
| exp(-1/2 a i^2 h^2) | ``falloff``: of columns and of lines | (2, reach + 1) | - |
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from camnet.estimation.basis import CUTOFF, RbfBasis
from camnet.estimation.vector_rows import running_rows
from camnet.types import Array, IntArray

__all__ = ["Kernels", "dense_weights", "field_on_grid", "kernels_at", "pack_kernels", "workspace"]


class Kernels(NamedTuple):
    """Kernels of a basis; the grid is empty (``on_grid`` False) where they have none."""

    centres: Array
    precision: Array
    heading_scale_m: float
    on_grid: bool
    columns: Array
    lines: Array
    number: IntArray
    precision_x: float
    precision_y: float
    spacing_x: float
    spacing_y: float
    reach: int
    falloff: Array


def _axis(values: Array) -> tuple[Array, float] | None:
    """Grid coordinates that hold all ``values`` exactly, evenly spaced but for rounding, and their spacing."""
    distinct = np.unique(values)
    if len(distinct) < 2:
        return distinct, 1.0
    spacing = float(np.diff(distinct).min())
    steps = np.rint((distinct - distinct[0]) / spacing).astype(int)
    spacing = float((distinct[-1] - distinct[0]) / steps[-1])
    even = distinct[0] + spacing * np.arange(steps[-1] + 1)
    if steps[-1] > 4 * len(distinct) or np.abs(even[steps] - distinct).max() > 1e-12 * np.abs(distinct).max():
        return None
    even[steps] = distinct
    return even, spacing


def pack_kernels(basis: RbfBasis) -> Kernels:
    """Kernels of ``basis`` for the loops, with their grid if they lie on one."""
    grid = _grid(basis) if basis.centres.shape[1] == 2 else None
    if grid is None:
        none = np.zeros(0)
        empty = np.zeros((0, 0), dtype=np.int64)
        return Kernels(
            basis.centres,
            basis.precision,
            basis.heading_scale_m,
            False,
            none,
            none,
            empty,
            1.0,
            1.0,
            1.0,
            1.0,
            0,
            np.zeros((2, 1)),
        )
    return grid


def _grid(basis: RbfBasis) -> Kernels | None:
    precision = basis.precision
    if (precision != precision[0]).any() or precision[0, 0, 1] != 0.0 or precision[0, 1, 0] != 0.0:
        return None
    axes = [_axis(basis.centres[:, i]) for i in range(2)]
    if axes[0] is None or axes[1] is None:
        return None
    (columns, dx), (lines, dy) = axes
    number = np.full((len(columns), len(lines)), -1, dtype=np.int64)
    i = np.searchsorted(columns, basis.centres[:, 0])
    j = np.searchsorted(lines, basis.centres[:, 1])
    number[i, j] = np.arange(basis.size)
    if (number >= 0).sum() < basis.size:
        return None
    ax, ay = float(precision[0, 0, 0]), float(precision[0, 1, 1])
    reach = 1 + math.ceil(max(math.sqrt(CUTOFF / ax) / dx, math.sqrt(CUTOFF / ay) / dy))
    steps = np.arange(reach + 1)
    falloff = np.exp(-0.5 * np.stack((ax * (steps * dx) ** 2, ay * (steps * dy) ** 2)))
    return Kernels(
        basis.centres,
        precision,
        basis.heading_scale_m,
        True,
        columns,
        lines,
        number,
        ax,
        ay,
        dx,
        dy,
        reach,
        falloff,
    )


@njit(cache=True, nogil=True)
def workspace(k: Kernels) -> Array:
    """Room for the factors of one pose: squared distances and factors of columns, then of lines."""
    return np.empty((4, 2 * k.reach + 1))


@njit(cache=True, nogil=True)
def _factors(
    x: float,
    coordinates: Array,
    spacing: float,
    precision: float,
    reach: int,
    falloff: Array,
    squares: Array,
    factors: Array,
) -> tuple[int, int]:
    """Write squared distances and factors of the coordinates in reach of ``x``; return the range (first, after)."""
    nearest = math.floor((x - coordinates[0]) / spacing + 0.5)
    n = len(coordinates)
    if not (-reach <= nearest < n + reach):
        return 0, 0
    first, after = max(0, nearest - reach), min(n, nearest + reach + 1)
    d = x - (coordinates[0] + nearest * spacing)
    here = math.exp(-0.5 * precision * d * d)
    up = math.exp(precision * d * spacing)
    down = 1.0 / up
    part = here
    for i in range(nearest, after):
        if i >= first:
            factors[i - first] = part * falloff[i - nearest]
        part *= up
    part = here
    for i in range(nearest - 1, first - 1, -1):
        part *= down
        if i < after:
            factors[i - first] = part * falloff[nearest - i]
    for i in range(first, after):
        e = x - coordinates[i]
        squares[i - first] = e * e * precision
    return first, after


@njit(cache=True, nogil=True)
def kernels_at(
    k: Kernels, x: float, y: float, hx: float, hy: float, index: IntArray, sigma: Array, work: Array
) -> int:
    """Write number and sigma of the kernels that are not zero at (x, y) with the heading (hx, hy); return how many."""
    count = 0
    if not k.on_grid:
        return _kernels_anywhere(k, x, y, hx, hy, index, sigma)
    c0, c1 = _factors(x, k.columns, k.spacing_x, k.precision_x, k.reach, k.falloff[0], work[0], work[1])
    l0, l1 = _factors(y, k.lines, k.spacing_y, k.precision_y, k.reach, k.falloff[1], work[2], work[3])
    for i in range(c0, c1):
        for j in range(l0, l1):
            if work[0, i - c0] + work[2, j - l0] < CUTOFF:
                number = k.number[i, j]
                if number >= 0:
                    index[count] = number
                    sigma[count] = work[1, i - c0] * work[3, j - l0]
                    count += 1
    return count


@njit(cache=True, nogil=True)
def _kernels_anywhere(
    k: Kernels, x: float, y: float, hx: float, hy: float, index: IntArray, sigma: Array
) -> int:
    """Do the same for kernels without a grid."""
    n, d = k.centres.shape
    count = 0
    e = np.zeros(4)
    norm = math.sqrt(hx * hx + hy * hy)
    scale = k.heading_scale_m / norm if norm > 1e-12 else 0.0
    for m in range(n):
        e[0], e[1] = x - k.centres[m, 0], y - k.centres[m, 1]
        if d == 4:
            e[2], e[3] = scale * hx - k.centres[m, 2], scale * hy - k.centres[m, 3]
        square = 0.0
        for i in range(d):
            for j in range(d):
                square += e[i] * k.precision[m, i, j] * e[j]
        if square < CUTOFF:
            index[count] = m
            sigma[count] = math.exp(-0.5 * square)
            count += 1
    return count


@njit(cache=True, nogil=True)
def dense_weights(k: Kernels, order: IntArray, n: int, weights: Array) -> tuple[Array, IntArray]:
    """Weights (nx ny, 8) on the whole grid, zero where no active kernel is, and each column's range (nx, 2) of them."""
    nx, ny = k.number.shape
    dense = np.zeros((nx * ny, 8))
    ranges = np.zeros((nx, 2), dtype=np.int64)
    ranges[:, 0] = ny
    for a in range(n):
        m = order[a]
        i = int(math.floor((k.centres[m, 0] - k.columns[0]) / k.spacing_x + 0.5))
        j = int(math.floor((k.centres[m, 1] - k.lines[0]) / k.spacing_y + 0.5))
        for o in range(8):
            dense[i * ny + j, o] = weights[a, o]
        ranges[i, 0] = min(ranges[i, 0], j)
        ranges[i, 1] = max(ranges[i, 1], j + 1)
    return dense, ranges


@njit(cache=True, nogil=True)
def field_on_grid(
    k: Kernels, dense: Array, ranges: IntArray, x: float, y: float, work: Array, out: Array
) -> None:
    """Write W^T sigma (8,) at (x, y) to ``out``; weights from `dense_weights`."""
    for o in range(8):
        out[o] = 0.0
    c0, c1 = _factors(x, k.columns, k.spacing_x, k.precision_x, k.reach, k.falloff[0], work[0], work[1])
    l0, l1 = _factors(y, k.lines, k.spacing_y, k.precision_y, k.reach, k.falloff[1], work[2], work[3])
    ny = k.number.shape[1]
    for i in range(c0, c1):
        first, after = max(l0, ranges[i, 0]), min(l1, ranges[i, 1])
        square = work[0, i - c0]
        while first < after and square + work[2, first - l0] >= CUTOFF:
            first += 1
        while first < after and square + work[2, after - 1 - l0] >= CUTOFF:
            after -= 1
        if first < after:
            running_rows(work[3], first - l0, after - first, dense, i * ny + first, work[1, i - c0], out)
