"""Labels, windows and peaks of periodic signals with an odd number of samples a side.

An odd number keeps the signal's Fourier series free of a frequency without a conjugate, so that the signal
between the samples is defined without a choice: r(t) = 1/N sum_k R_k exp(2 pi i k t / N), |k| <= (N - 1)/2.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from camnet.types import Array

__all__ = ["Spectrum", "gaussian", "odd_fast_length", "peak", "peak_to_sidelobe", "series_peak"]

Spectrum = NDArray[np.complex64] | NDArray[np.complex128]
_NEWTON_STEPS = 5


def odd_fast_length(least: float) -> int:
    """Smallest odd number at least ``least`` without a prime factor above 11."""
    n = max(3, int(np.ceil(least)))
    n += 1 - n % 2
    while True:
        rest = n
        for prime in (3, 5, 7, 11):
            while rest % prime == 0:
                rest //= prime
        if rest == 1:
            return n
        n += 2


def signed(n: int) -> Array:
    """Sample numbers 0, 1, ..., -1 of a periodic signal as signed distances from sample 0."""
    return np.asarray(fft.fftfreq(n, 1.0 / n))


def gaussian(n: int, sigma: float) -> Array:
    """Gaussian (n,) of width ``sigma`` samples about sample 0, periodic."""
    return np.exp(-0.5 * (signed(n) / sigma) ** 2)


def peak(spectrum: Spectrum, columns: int) -> tuple[Array, float, Array]:
    """Greatest value of a two-dimensional signal, between the samples too.

    The signal is sampled twice as densely as it was given, and the best sample is refined by Newton's method.

    Parameters
    ----------
    spectrum : (rows, columns // 2 + 1) from ``rfft2``, odd rows and columns
    columns : of the signal

    Returns
    -------
    place : (2,) column, row, from -n/2 to n/2
    value : there
    response : (2 rows + 1, 2 columns + 1) the dense signal
    """
    rows, half = spectrum.shape
    dense_shape = (2 * rows + 1, 2 * columns + 1)
    padded = np.zeros((dense_shape[0], columns + 1), dtype=spectrum.dtype)
    top = rows // 2 + 1
    padded[:top, :half] = spectrum[:top]
    padded[top - rows :, :half] = spectrum[top:]
    scale = dense_shape[0] * dense_shape[1] / (rows * columns)
    response = fft.irfft2(padded, s=dense_shape) * scale
    row, column = np.unravel_index(int(np.argmax(response)), dense_shape)
    start = np.array([signed(dense_shape[1])[column] * columns, signed(dense_shape[0])[row] * rows])
    start /= [dense_shape[1], dense_shape[0]]
    place, value = _refine(spectrum, columns, start, float(response[row, column]))
    return place, value, response


def _refine(spectrum: Spectrum, columns: int, start: Array, value: float) -> tuple[Array, float]:
    """Newton's method on the Fourier series from the best sample; never leaves that sample's neighbourhood."""
    rows, half = spectrum.shape
    ky = 2.0j * np.pi * signed(rows) / rows
    kx = 2.0j * np.pi * np.arange(half) / columns
    weight = np.where(np.arange(half) == 0, 1.0, 2.0) / (rows * columns)
    best, place = value, start.copy()
    at = start.copy()
    for _ in range(_NEWTON_STEPS):
        ex, ey = weight * np.exp(kx * at[0]), np.exp(ky * at[1])
        r0, r1, r2 = (spectrum @ np.stack([ex, kx * ex, kx**2 * ex], axis=1)).T
        f = float((ey @ r0).real)
        if f > best:
            best, place = f, at.copy()
        gx, gy = float((ey @ r1).real), float(((ky * ey) @ r0).real)
        hxx, hxy, hyy = (float(h.real) for h in (ey @ r2, (ky * ey) @ r1, (ky**2 * ey) @ r0))
        determinant = hxx * hyy - hxy * hxy
        if not (hxx < 0.0 and determinant > 0.0):
            break
        step = np.array([hxy * gy - hyy * gx, hxy * gx - hxx * gy]) / determinant
        at = at + step
        if np.max(np.abs(at - start)) > 0.6 or np.max(np.abs(step)) < 1e-5:
            break
    return place, best


def series_peak(spectrum: Spectrum, n: int, dense: int) -> tuple[float, float]:
    """Greatest value of a one-dimensional signal (n odd) sampled ``dense`` (odd) times, then refined by a parabola.

    Returns
    -------
    place : in dense samples from sample 0, -dense/2 to dense/2
    value : there
    """
    padded = np.zeros(dense // 2 + 1, dtype=np.complex128)
    padded[: n // 2 + 1] = spectrum[: n // 2 + 1]
    response = fft.irfft(padded, n=dense) * (dense / n)
    best = int(np.argmax(response))
    before, at, after = response[best - 1], response[best], response[(best + 1) % dense]
    curvature = before - 2.0 * at + after
    shift = 0.5 * (before - after) / curvature if curvature < 0.0 else 0.0
    return float(signed(dense)[best] + shift), float(at - 0.25 * (before - after) * shift)


def peak_to_sidelobe(response: Array, sigma: tuple[float, float]) -> float:
    """Height of the peak above the rest of the response, in standard deviations of the rest.

    Parameters
    ----------
    response : (rows, columns)
    sigma : width of the wanted peak, rows and columns, samples; three of them around the peak do not count as rest
    """
    row, column = np.unravel_index(int(np.argmax(response)), response.shape)
    near = [
        np.abs(signed(n)) <= min(3.0 * s + 1.0, 0.25 * n) for n, s in zip(response.shape, sigma, strict=True)
    ]
    rest = response[~(np.roll(near[0], row)[:, None] & np.roll(near[1], column)[None, :])]
    spread = float(np.std(rest))
    return float((response[row, column] - np.mean(rest)) / spread) if spread > 1e-12 else 0.0
