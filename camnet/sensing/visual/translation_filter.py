"""Two-dimensional correlation filter on compressed features.

Danelljan et al., Discriminative Scale Space Tracking, TPAMI 39(8), 2017: the fast variant of the translation filter.

| symbol | name | shape | tag |
| --- | --- | --- | --- |
| f | windowed features of the new patch | cells x 31 | |
| u | template: running mean of f | cells x 31 | (T1) |
| P | projection on the principal directions of u | 31 x d | (T2) |
| G | transform of the wanted response | cells | |
| conj(A) | G times the conjugate transforms of P'u | d x cells | (T3) |
| B | running sum of the energies of the transforms of P'f | cells | (T4) |
| Y | transform of the response to a patch z: sum_l conj(A_l) Z_l / (B + lambda) | cells | (T5) |

Half spectra of real signals are kept throughout. Departure: the window is applied before the principal
directions are found, so that they serve the target rather than its surroundings.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from camnet.sensing.visual.fourier import gaussian
from camnet.sensing.visual.hog import Features

__all__ = ["TranslationModel", "label_spectrum", "learn", "respond"]

_Complex = NDArray[np.complex64]


@dataclass(frozen=True, eq=False, slots=True)
class TranslationModel:
    """What has been learnt.

    Attributes
    ----------
    template : (rows, columns, 31) u
    projection : (31, d) P
    numerator : (d, rows, columns // 2 + 1) conj(A)
    denominator : (rows, columns // 2 + 1) B
    """

    template: Features
    projection: Features
    numerator: _Complex
    denominator: Features


def label_spectrum(rows: int, columns: int, sigma: tuple[float, float]) -> _Complex:
    """Transform G of the wanted response: a Gaussian of width ``sigma`` (rows, columns) cells about cell (0, 0)."""
    label = np.outer(gaussian(rows, sigma[0]), gaussian(columns, sigma[1]))
    return np.asarray(fft.rfft2(label), dtype=np.complex64)


def learn(
    model: TranslationModel | None, features: Features, label: _Complex, components: int, rate: float
) -> TranslationModel:
    """Take in the windowed features of a patch centred on the target.

    Parameters
    ----------
    model : what was learnt so far, None at the first patch
    features : (rows, columns, 31) f
    label : G, see `label_spectrum`
    components : number d of principal directions
    rate : weight of the new patch
    """
    template = features if model is None else _mix(model.template, features, rate)  # (T1)
    projection = principal_directions(template, components)  # (T2)
    mean = _transform(template, projection)
    numerator = np.conj(mean) * label  # (T3)
    new = mean if model is None else _transform(features, projection)
    energy = np.sum(new.real**2 + new.imag**2, axis=0)
    denominator = energy if model is None else _mix(model.denominator, energy, rate)  # (T4)
    return TranslationModel(template, projection, numerator, denominator)


def respond(model: TranslationModel, features: Features, regularisation: float) -> _Complex:
    """Half spectrum of the response to the windowed features of a patch (T5)."""
    z = _transform(features, model.projection)
    return np.asarray(
        np.einsum("drc,drc->rc", model.numerator, z) / (model.denominator + np.float32(regularisation))
    )


def principal_directions(template: Features, components: int) -> Features:
    """Directions (31, d) that hold most of the template's energy; columns orthonormal."""
    flat = template.reshape(-1, template.shape[-1])
    _, vectors = np.linalg.eigh((flat.T @ flat).astype(np.float64))
    return np.ascontiguousarray(vectors[:, ::-1][:, :components], dtype=np.float32)


def _transform(features: Features, projection: Features) -> _Complex:
    rows, columns, channels = features.shape
    compressed = projection.T @ features.reshape(-1, channels).T
    return np.asarray(fft.rfft2(compressed.reshape(-1, rows, columns), axes=(1, 2)), dtype=np.complex64)


def _mix(old: Features, new: Features, rate: float) -> Features:
    return np.asarray((np.float32(1.0 - rate)) * old + np.float32(rate) * new, dtype=np.float32)
