"""Sums over kernels in compiled loops: sigma at a pose, and the learned field W^T sigma along a path.

The kernels are those of `camnet.estimation.basis`, its cut-off included; that module is the oracle of this one. Where
all kernels have one diagonal covariance and lie on a regular grid (every shipped world), a kernel is a product of one
factor for its column and one for its row, and neighbouring factors follow from each other:

    exp(-1/2 a (x - c - i h)^2) = exp(-1/2 a (x - c)^2) [exp(a (x - c) h)]^i exp(-1/2 a i^2 h^2)

so a pose takes four exponentials in place of one for each kernel in reach. The result differs by rounding (relative
1e-14); which kernels are cut off is decided by the same expression as there.

| symbol | name | shape | unit |
| --- | --- | --- | --- |
| c | first in ``lattice``: coordinates of the grid's columns (x), then of its lines (y) | (nx + ny,) | m |
| a | ``precision_x``, ``precision_y`` | - | 1/m^2 |
| h | ``spacing`` | - | m |
| exp(-1/2 a i^2 h^2) | then in ``lattice``: of columns, of lines | (2 (reach + 1),) | - |
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from camnet.batch.compiled import inner
from camnet.estimation.basis import CUTOFF, RbfBasis
from camnet.estimation.vector_rows import running_rows
from camnet.types import Array, IntArray

__all__ = ["Kernels", "dense_weights", "field_on_grid", "kernels_at", "pack_kernels"]


class Kernels(NamedTuple):
    """Kernels of a basis; the grid is empty (``on_grid`` False) where they have none."""

    centres: Array
    precision: Array
    heading_scale_m: float
    on_grid: bool
    lattice: Array
    number: IntArray
    precision_x: float
    precision_y: float
    spacing_x: float
    spacing_y: float
    reach: int


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
    if grid is not None:
        return grid
    none = np.zeros((0, 0), dtype=np.int64)
    return Kernels(
        basis.centres, basis.precision, basis.heading_scale_m, False, np.zeros(1), none, 1.0, 1.0, 1.0, 1.0, 0
    )


def _grid(basis: RbfBasis) -> Kernels | None:
    precision = basis.precision
    if (precision != precision[0]).any() or precision[0, 0, 1] != 0.0 or precision[0, 1, 0] != 0.0:
        return None
    x_axis, y_axis = _axis(basis.centres[:, 0]), _axis(basis.centres[:, 1])
    if x_axis is None or y_axis is None:
        return None
    (columns, dx), (lines, dy) = x_axis, y_axis
    number = np.full((len(columns), len(lines)), -1, dtype=np.int64)
    i = np.searchsorted(columns, basis.centres[:, 0])
    j = np.searchsorted(lines, basis.centres[:, 1])
    number[i, j] = np.arange(basis.size)
    if (number >= 0).sum() < basis.size:
        return None
    ax, ay = float(precision[0, 0, 0]), float(precision[0, 1, 1])
    reach = 1 + math.ceil(max(math.sqrt(CUTOFF / ax) / dx, math.sqrt(CUTOFF / ay) / dy))
    steps = np.arange(reach + 1)
    falloff_x = np.exp(-0.5 * ax * (steps * dx) ** 2)
    falloff_y = np.exp(-0.5 * ay * (steps * dy) ** 2)
    lattice = np.concatenate((columns, lines, falloff_x, falloff_y))
    return Kernels(
        basis.centres, precision, basis.heading_scale_m, True, lattice, number, ax, ay, dx, dy, reach
    )


@inner
def _factors(
    x: float,
    n: int,
    coordinates: Array,
    falloff: Array,
    spacing: float,
    precision: float,
    reach: int,
    out: Array,
) -> tuple[int, int]:
    """Write squared distances, then factors, of the ``n`` coordinates in reach of ``x``; return the range of these."""
    nearest = math.floor((x - coordinates[0]) / spacing + 0.5)
    if not (-reach <= nearest < n + reach):
        return 0, 0
    first, after = max(0, nearest - reach), min(n, nearest + reach + 1)
    d = x - (coordinates[0] + nearest * spacing)
    up = math.exp(precision * d * spacing)
    down = 1.0 / up
    right = math.exp(-0.5 * precision * d * d)
    left = right
    factors = out[2 * reach + 1 :]
    middle = nearest - first
    for i in range(reach + 1):
        if 0 <= middle + i < after - first:
            factors[middle + i] = right * falloff[i]
        if 0 <= middle - i < after - first:
            factors[middle - i] = left * falloff[i]
        right *= up
        left *= down
    for i in range(after - first):
        e = x - coordinates[first + i]
        out[i] = e * e * precision
    return first, after


@inner
def _both_factors(k: Kernels, x: float, y: float, work: Array) -> tuple[int, int, int, int]:
    """Do so for columns and lines: ranges of columns and of lines.

    ``work`` (4 (2 reach + 1),) takes squared distances and factors of columns, then of lines.
    """
    nx, ny = k.number.shape
    half, falloff = 2 * (2 * k.reach + 1), k.lattice[nx + ny :]
    c0, c1 = _factors(x, nx, k.lattice, falloff, k.spacing_x, k.precision_x, k.reach, work)
    l0, l1 = _factors(
        y, ny, k.lattice[nx:], falloff[k.reach + 1 :], k.spacing_y, k.precision_y, k.reach, work[half:]
    )
    return c0, c1, l0, l1


@inner
def kernels_at(
    k: Kernels, x: float, y: float, hx: float, hy: float, index: IntArray, sigma: Array, work: Array
) -> int:
    """Write number and sigma of the kernels that are not zero at (x, y) with the heading (hx, hy); return how many."""
    count = 0
    if not k.on_grid:
        return int(_kernels_anywhere(k, x, y, hx, hy, index, sigma))
    c0, c1, l0, l1 = _both_factors(k, x, y, work)
    n = 2 * k.reach + 1
    for i in range(c1 - c0):
        numbers = k.number[c0 + i]
        for j in range(l1 - l0):
            number = numbers[l0 + j]
            if number >= 0 and work[i] + work[2 * n + j] < CUTOFF:
                index[count] = number
                sigma[count] = work[n + i] * work[3 * n + j]
                count += 1
    return count


@inner
def _kernels_anywhere(
    k: Kernels, x: float, y: float, hx: float, hy: float, index: IntArray, sigma: Array
) -> int:
    """Do the same for kernels without a grid."""
    n, d = k.centres.shape
    count = 0
    norm = math.sqrt(hx * hx + hy * hy)
    scale = k.heading_scale_m / norm if norm > 1e-12 else 0.0
    for m in range(n):
        ex, ey, eu, ev = x - k.centres[m, 0], y - k.centres[m, 1], 0.0, 0.0
        if d == 4:
            eu, ev = scale * hx - k.centres[m, 2], scale * hy - k.centres[m, 3]
        e, square = (ex, ey, eu, ev), 0.0
        for i in range(d):
            for j in range(d):
                square += e[i] * k.precision[m, i, j] * e[j]
        if square < CUTOFF:
            index[count] = m
            sigma[count] = math.exp(-0.5 * square)
            count += 1
    return count


@inner
def dense_weights(
    k: Kernels, order: IntArray, n: int, weights: Array, dense: Array, ranges: IntArray
) -> tuple[float, float, float, float]:
    """Write the weights of ``n`` active kernels to their places on the grid, and where in each column they are.

    ``dense`` (8 nx ny,) is zero where no active kernel is; ``ranges`` (2 nx,) takes first and after of each column.
    Returns the box (x0, x1, y0, y1) beyond which all of these kernels are cut off.
    """
    nx, ny = k.number.shape
    for i in range(len(dense)):
        dense[i] = 0.0
    for i in range(nx):
        ranges[2 * i], ranges[2 * i + 1] = ny, 0
    x0, x1, y0, y1 = math.inf, -math.inf, math.inf, -math.inf
    for a in range(n):
        m = order[a]
        x0, x1 = min(x0, k.centres[m, 0]), max(x1, k.centres[m, 0])
        y0, y1 = min(y0, k.centres[m, 1]), max(y1, k.centres[m, 1])
        i = math.floor((k.centres[m, 0] - k.lattice[0]) / k.spacing_x + 0.5)
        j = math.floor((k.centres[m, 1] - k.lattice[nx]) / k.spacing_y + 0.5)
        for o in range(8):
            dense[8 * (i * ny + j) + o] = weights[8 * a + o]
        ranges[2 * i] = min(ranges[2 * i], j)
        ranges[2 * i + 1] = max(ranges[2 * i + 1], j + 1)
    # a little more than the cut-off, which is decided kernel by kernel
    rx, ry = 1.001 * math.sqrt(CUTOFF / k.precision_x), 1.001 * math.sqrt(CUTOFF / k.precision_y)
    return x0 - rx, x1 + rx, y0 - ry, y1 + ry


@inner
def field_on_grid(
    k: Kernels,
    dense: Array,
    ranges: IntArray,
    box: tuple[float, float, float, float],
    x: float,
    y: float,
    work: Array,
    out: Array,
) -> None:
    """Write W^T sigma (8,) at (x, y) to ``out``; weights, ranges and box from `dense_weights`."""
    for o in range(8):
        out[o] = 0.0
    if not (box[0] < x < box[1] and box[2] < y < box[3]):
        return
    c0, c1, l0, l1 = _both_factors(k, x, y, work)
    n, ny = 2 * k.reach + 1, k.number.shape[1]
    for i in range(c1 - c0):
        first, after = max(l0, ranges[2 * (c0 + i)]) - l0, min(l1, ranges[2 * (c0 + i) + 1]) - l0
        square = work[i]
        while first < after and square + work[2 * n + first] >= CUTOFF:
            first += 1
        while first < after and square + work[2 * n + after - 1] >= CUTOFF:
            after -= 1
        if first < after:
            begin = (c0 + i) * ny + l0 + first
            running_rows(work, 3 * n + first, after - first, dense, begin, work[n + i], out)
