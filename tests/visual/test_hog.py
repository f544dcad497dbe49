"""The HOG kernel against a plain NumPy version written from the definition."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from camnet.sensing.visual.hog import hog


def oracle(patch: np.ndarray, cell: int) -> np.ndarray:
    image = patch.astype(float)
    padded = np.pad(image, ((1, 1), (1, 1), (0, 0)), mode="edge")
    gx, gy = padded[1:-1, 2:] - padded[1:-1, :-2], padded[2:, 1:-1] - padded[:-2, 1:-1]
    best = np.argmax(gx**2 + gy**2, axis=2)[:, :, None]
    gx, gy = np.take_along_axis(gx, best, 2)[:, :, 0], np.take_along_axis(gy, best, 2)[:, :, 0]
    angles = np.arange(18) * np.pi / 9.0
    along = gx[:, :, None] * np.cos(angles) + gy[:, :, None] * np.sin(angles)
    # half-way between two orientations: the later one, counted round the circle
    tied = along > along.max(axis=2, keepdims=True) - 1e-9 * (1.0 + along.max(axis=2, keepdims=True))
    orientation = np.where(tied[:, :, 0] & tied[:, :, 17], 0, 17 - np.argmax(tied[:, :, ::-1], axis=2))
    size = np.hypot(gx, gy)
    rows, columns = patch.shape[0] // cell, patch.shape[1] // cell
    votes = np.zeros((rows, columns, 18))
    for y in range(rows * cell):
        for x in range(columns * cell):
            for r in range(rows):
                wy = max(0.0, 1.0 - abs((y + 0.5) / cell - (r + 0.5)))
                if wy == 0.0:
                    continue
                for k in range(columns):
                    wx = max(0.0, 1.0 - abs((x + 0.5) / cell - (k + 0.5)))
                    votes[r, k, orientation[y, x]] += wy * wx * size[y, x]
    unsigned = votes[:, :, :9] + votes[:, :, 9:]
    energy = np.pad(np.sum(unsigned**2, axis=2), 1, mode="edge")
    out = np.zeros((rows, columns, 31))
    for i, (dr, dk) in enumerate([(0, 0), (0, 1), (1, 0), (1, 1)]):
        block = sum(energy[dr + a : dr + a + rows, dk + b : dk + b + columns] for a in (0, 1) for b in (0, 1))
        scale = 1.0 / np.sqrt(block + 1e-4)[:, :, None]
        signed = np.minimum(votes * scale, 0.2)
        out[:, :, :18] += 0.5 * signed
        out[:, :, 18:27] += 0.5 * np.minimum(unsigned * scale, 0.2)
        out[:, :, 27 + i] = 0.2357 * signed.sum(axis=2)
    return out


@pytest.mark.parametrize("cell", [1, 2, 3, 4])
@pytest.mark.parametrize("channels", [1, 3])
def test_kernel_matches_the_definition(cell: int, channels: int) -> None:
    rng = np.random.default_rng(10 * cell + channels)
    patch = rng.integers(0, 256, size=(4 * cell + 1, 5 * cell + 2, channels), dtype=np.uint8)
    # the kernel looks one pixel past the last whole cell where the patch has one; so does the definition
    assert np.max(np.abs(hog(patch, cell) - oracle(patch, cell))) < 2e-6


@given(st.integers(0, 2**32 - 1), st.integers(1, 4), st.integers(2, 7), st.integers(2, 7))
@settings(max_examples=15)
def test_kernel_matches_on_few_grey_levels(seed: int, cell: int, rows: int, columns: int) -> None:
    """Few levels make gradients tie between channels and between orientations."""
    patch = np.random.default_rng(seed).integers(0, 3, size=(rows + cell, columns + cell, 3), dtype=np.uint8)
    assert np.max(np.abs(hog(patch, cell) - oracle(patch, cell)), initial=0.0) < 2e-6


def test_flat_patch_has_no_features() -> None:
    assert not hog(np.full((16, 16, 3), 77, dtype=np.uint8), 4).any()


def test_negative_turns_signed_orientations_by_half_a_circle() -> None:
    patch = np.random.default_rng(0).integers(0, 256, size=(24, 20, 1), dtype=np.uint8)
    a, b = hog(patch, 4), hog(255 - patch, 4)
    np.testing.assert_allclose(np.roll(a[:, :, :18], 9, axis=2), b[:, :, :18], atol=1e-6)
    np.testing.assert_allclose(a[:, :, 18:27], b[:, :, 18:27], atol=1e-6)


def test_contrast_does_not_matter() -> None:
    patch = np.random.default_rng(0).integers(0, 60, size=(24, 20, 1), dtype=np.uint8)
    np.testing.assert_allclose(hog(patch, 4), hog(4 * patch + 3, 4), atol=1e-4)
