"""One-dimensional correlation filter over the size of the target.

Danelljan et al., Discriminative Scale Space Tracking, TPAMI 39(8), 2017: the fast variant of the scale filter.

| symbol | name | shape |
| --- | --- | --- |
| S, S+ | scales sampled, scales after interpolation | |
| a | step between interpolated scales; sampled ones are S+/S steps apart | |
| f | windowed features, one column a scale | D x S |
| u | template: running mean of f | D x S |
| P | orthonormal basis of the columns of u: loses nothing, as u has only S columns | D x S |
| A, B | numerator and denominator, as for the translation | S x S, S |

Departure: each feature's mean over the scales is removed before the window, which would draw every change towards none
(measured on a scene that shrinks 4 times over 350 images: final size 2.6 % too large instead of 3.1 %).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from camnet.sensing.visual.fourier import gaussian, series_peak
from camnet.sensing.visual.hog import hog
from camnet.sensing.visual.patch import Image, resample, shrink
from camnet.sensing.visual.settings import ScaleSettings
from camnet.types import Array

__all__ = ["ScaleGrid", "ScaleModel", "learn", "respond", "sample"]


@dataclass(frozen=True, eq=False, slots=True)
class ScaleGrid:
    """What does not change during a track.

    Attributes
    ----------
    factors : (S,) sizes relative to the current one, in the order of the periodic signal (1 first)
    window : (S,) Hann window about the current size
    label : (S,) transform of the wanted response
    shape : rows, columns of the patches, px
    """

    factors: Array
    window: Array
    label: NDArray[np.complex128]
    shape: tuple[int, int]

    @staticmethod
    def of(settings: ScaleSettings, width: float, height: float) -> ScaleGrid:
        """Grid for a target of ``width`` x ``height`` px."""
        n = settings.scales
        signed = fft.fftfreq(n, 1.0 / n)
        apart = settings.interpolated_scales / n
        area = min(1.0, np.sqrt(settings.model_area_px / (width * height)))
        shape = [max(3 * settings.cell_px, round(length * area)) for length in (height, width)]
        sigma = settings.interpolated_scales * settings.sigma_factor / apart
        return ScaleGrid(
            settings.step ** (signed * apart),
            np.cos(np.pi * signed / (n + 1)) ** 2,
            fft.fft(gaussian(n, sigma)),
            (shape[0], shape[1]),
        )


@dataclass(frozen=True, eq=False, slots=True)
class ScaleModel:
    """What has been learnt: template u (D, S), basis P (D, S), numerator (S, S), denominator (S,)."""

    template: Array
    basis: Array
    numerator: NDArray[np.complex128]
    denominator: Array


def sample(image: Image, centre: Array, size: Array, grid: ScaleGrid, cell: int) -> Array:
    """Windowed features (D, S) of the target taken at every scale.

    Parameters
    ----------
    image : (H, W, C)
    centre, size : (2,), (2,) of the target, px
    grid : scales and patch size
    cell : side of a cell, px
    """
    pixels = np.array([grid.shape[1], grid.shape[0]])
    block = max(1, int(np.min(size / pixels) * float(np.min(grid.factors))))
    small, origin, block = shrink(image, centre, size * float(np.max(grid.factors)), block)
    at, step = (centre - origin) / block, size / (pixels * block)
    columns = [hog(resample(small, at, step * factor, grid.shape), cell).ravel() for factor in grid.factors]
    features = np.stack(columns, axis=1).astype(float)
    mean = features @ grid.window / np.sum(grid.window)
    return np.asarray((features - mean[:, None]) * grid.window)


def learn(model: ScaleModel | None, features: Array, grid: ScaleGrid, rate: float) -> ScaleModel:
    """Take in the windowed features (D, S) of a target of the size in force."""
    template = features if model is None else (1.0 - rate) * model.template + rate * features
    basis = np.linalg.qr(template)[0]
    mean = fft.fft(basis.T @ template, axis=1)
    numerator = np.conj(mean) * grid.label
    spectrum = fft.fft(features, axis=1)
    energy = np.sum(spectrum.real**2 + spectrum.imag**2, axis=0)
    denominator = energy if model is None else (1.0 - rate) * model.denominator + rate * energy
    return ScaleModel(template, basis, numerator, denominator)


def respond(model: ScaleModel, features: Array, settings: ScaleSettings) -> tuple[float, float]:
    """Change of size that answers best, and the response there.

    Returns
    -------
    factor : size relative to the current one
    value : response, near 1 where the target looks as it did
    """
    z = fft.fft(model.basis.T @ features, axis=1)
    spectrum = np.sum(model.numerator * z, axis=0) / (model.denominator + settings.regularisation)
    steps, value = series_peak(spectrum, settings.scales, settings.interpolated_scales)
    return float(settings.step**steps), value
