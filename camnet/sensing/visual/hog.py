"""Histograms of oriented gradients, 31 numbers a cell (Felzenszwalb et al., TPAMI 32(9), 2010, section 6).

| symbol | name | shape |
| --- | --- | --- |
| g | gradient of the colour channel with the greatest one at the pixel | 2 |
| h | votes for 18 signed orientations, bilinear in place | cells x 18 |
| E | energy of a cell: sum over 9 of (h_o + h_{o+9})^2 | cells |
| N | the four normalisers of a cell, 1 / sqrt(E over 2 x 2 cells) | 4 |

The features of a cell: 18 signed and 9 unsigned orientations, each half the sum of its four normalised votes cut at
0.2, and 4 texture energies. Departures: the cells at the border are kept (their energies repeat outwards), so that the
features have the size of the patch; a gradient half-way between two orientations votes for the larger angle.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from camnet.compiled import cached_njit
from camnet.sensing.visual.patch import Image

__all__ = ["CHANNELS", "Features", "hog"]

#: (rows, columns, 31) float32
Features = NDArray[np.float32]
CHANNELS: Final = 31
CUT: Final = 0.2
#: added to the sum of energies (gradients are in grey levels per two pixels)
FLOOR: Final = 1e-4
TEXTURE: Final = 0.2357


def _orientation_table() -> NDArray[np.uint8]:
    """Orientation 0..17 of every gradient of 8-bit images, by [dy + 255, dx + 255]."""
    d = np.arange(-255, 256)
    turns = np.arctan2(d[:, None], d[None, :]) / (np.pi / 9.0)
    return (np.floor(np.round(turns, 9) + 0.5).astype(int) % 18).astype(np.uint8)


_ORIENTATION: Final = _orientation_table()


def hog(patch: Image, cell: int) -> Features:
    """Features of a patch.

    Parameters
    ----------
    patch : (H, W, C) uint8
    cell : side of a cell, px

    Returns
    -------
    (H // cell, W // cell, 31)
    """
    rows, columns = patch.shape[0] // cell, patch.shape[1] // cell
    votes = np.zeros((rows + 2, columns + 2, 18), dtype=np.float32)  # with a rim for votes that fall outside
    _vote(np.ascontiguousarray(patch), cell, _ORIENTATION, votes)
    out = np.empty((rows, columns, CHANNELS), dtype=np.float32)
    _normalise(votes, out)
    return out


@cached_njit
def _share(n: int, cell: int) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
    """Lower of the two nearest cells of each pixel, counted with the rim, and the share of the upper one."""
    lower, share = np.empty(n, dtype=np.int32), np.empty(n, dtype=np.float32)
    for i in range(n):
        place = (i + 0.5) / cell + 0.5
        lower[i] = int(place)
        share[i] = place - int(place)
    return lower, share


@cached_njit
def _vote(patch: Image, cell: int, table: NDArray[np.uint8], votes: Features) -> None:
    """Add each pixel's gradient to the four nearest cells."""
    height, width, channels = patch.shape
    row_of, row_share = _share((votes.shape[0] - 2) * cell, cell)
    column_of, column_share = _share((votes.shape[1] - 2) * cell, cell)
    for y in range(len(row_of)):
        above, below = patch[max(y - 1, 0)], patch[min(y + 1, height - 1)]
        along = patch[y]
        upper, lower = votes[row_of[y]], votes[row_of[y] + 1]
        wy = row_share[y]
        for x in range(len(column_of)):
            left, right = max(x - 1, 0), min(x + 1, width - 1)
            best, gx, gy = np.int32(0), np.int32(0), np.int32(0)
            for c in range(channels):
                dx = np.int32(along[right, c]) - np.int32(along[left, c])
                dy = np.int32(below[x, c]) - np.int32(above[x, c])
                square = dx * dx + dy * dy
                if square > best:
                    best, gx, gy = square, dx, dy
            o = table[gy + 255, gx + 255]
            size = np.sqrt(np.float32(best))
            k, wx = column_of[x], column_share[x]
            low = size * wy
            high = size - low
            low_right, high_right = low * wx, high * wx
            upper[k, o] += high - high_right
            upper[k + 1, o] += high_right
            lower[k, o] += low - low_right
            lower[k + 1, o] += low_right


@cached_njit
def _normalise(votes: Features, out: Features) -> None:
    """Votes to features."""
    rows, columns = out.shape[0], out.shape[1]
    energy = np.empty((rows + 2, columns + 2), dtype=np.float32)
    for r in range(rows + 2):
        for k in range(columns + 2):
            h = votes[min(max(r, 1), rows), min(max(k, 1), columns)]
            total = np.float32(0.0)
            for o in range(9):
                both = h[o] + h[o + 9]
                total += both * both
            energy[r, k] = total
    half, cut = np.float32(0.5), np.float32(CUT)
    norm = np.empty(4, dtype=np.float32)
    texture = np.empty(4, dtype=np.float32)
    for r in range(rows):
        for k in range(columns):
            for i in range(4):
                a, b = r + i // 2, k + i % 2  # upper left cell of the block in the padded energies
                block = energy[a, b] + energy[a, b + 1] + energy[a + 1, b] + energy[a + 1, b + 1]
                norm[i] = np.float32(1.0) / np.sqrt(block + np.float32(FLOOR))
                texture[i] = np.float32(0.0)
            h = votes[r + 1, k + 1]
            for o in range(18):
                total = np.float32(0.0)
                for i in range(4):
                    value = min(h[o] * norm[i], cut)
                    total += value
                    texture[i] += value
                out[r, k, o] = half * total
            for o in range(9):
                both = h[o] + h[o + 9]
                total = np.float32(0.0)
                for i in range(4):
                    total += min(both * norm[i], cut)
                out[r, k, 18 + o] = half * total
            for i in range(4):
                out[r, k, 27 + i] = np.float32(TEXTURE) * texture[i]
