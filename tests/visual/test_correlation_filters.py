"""Filters against dense ridge regression, peaks against signals known between the samples."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import fft

from camnet.sensing.visual import scale_filter, translation_filter
from camnet.sensing.visual.fourier import odd_fast_length, peak, peak_to_sidelobe, series_peak
from camnet.sensing.visual.settings import ScaleSettings


def shifts(f: np.ndarray) -> np.ndarray:
    """All cyclic shifts of an image (rows, columns, channels), one a row."""
    rows, columns = f.shape[:2]
    return np.array([np.roll(f, (-r, -c), axis=(0, 1)).ravel() for r in range(rows) for c in range(columns)])


def test_translation_filter_is_ridge_regression_over_all_shifts() -> None:
    rng = np.random.default_rng(0)
    f, z = rng.normal(size=(2, 5, 7, 31)).astype(np.float32)
    label = translation_filter.label_spectrum(5, 7, (1.0, 1.2))
    y = fft.irfft2(label, s=(5, 7)).ravel()
    for regularisation in (0.01, 50.0):
        model = translation_filter.learn(None, f, label, 31, 0.025)
        ours = fft.irfft2(translation_filter.respond(model, z, regularisation), s=(5, 7))
        x = shifts(f).astype(float)
        dual = np.linalg.solve(x @ x.T + regularisation * np.eye(len(x)), y)  # w = X' (X X' + lambda)^-1 y
        dense = (shifts(z).astype(float) @ (x.T @ dual)).reshape(5, 7)
        np.testing.assert_allclose(ours, dense, atol=3e-5 * np.max(np.abs(dense)) + 1e-6)


def test_compression_keeps_what_lies_in_the_directions() -> None:
    """Features of rank 4 lose nothing when compressed to 4 components."""
    rng = np.random.default_rng(1)
    f = (rng.normal(size=(9, 11, 4)) @ rng.normal(size=(4, 31))).astype(np.float32)
    label = translation_filter.label_spectrum(9, 11, (1.0, 1.0))
    whole, small = (translation_filter.learn(None, f, label, n, 0.025) for n in (31, 4))
    responses = [translation_filter.respond(model, f, 0.01) for model in (whole, small)]
    np.testing.assert_allclose(responses[0], responses[1], atol=1e-3)
    directions = small.projection
    np.testing.assert_allclose(directions.T @ directions, np.eye(4), atol=1e-5)


def test_scale_filter_is_ridge_regression_over_all_shifts() -> None:
    rng = np.random.default_rng(2)
    settings = ScaleSettings(scales=9, interpolated_scales=9)
    grid = scale_filter.ScaleGrid.of(settings, 20.0, 30.0)
    f, z = rng.normal(size=(2, 40, 9))
    model = scale_filter.learn(None, f, grid, 0.025)
    x = np.array([np.roll(f, -s, axis=1).ravel() for s in range(9)])
    y = fft.ifft(grid.label).real
    w = x.T @ np.linalg.solve(x @ x.T + settings.regularisation * np.eye(9), y)
    # only the part of z in the span of the template's columns can answer
    seen = model.basis @ model.basis.T @ z
    dense = np.array([np.roll(seen, -s, axis=1).ravel() @ w for s in range(9)])
    spectrum = np.sum(model.numerator * fft.fft(model.basis.T @ z, axis=1), axis=0)
    ours = fft.ifft(spectrum / (model.denominator + settings.regularisation)).real
    np.testing.assert_allclose(ours, dense, atol=1e-9)


def test_learning_is_a_running_mean() -> None:
    rng = np.random.default_rng(3)
    a, b = rng.normal(size=(2, 5, 5, 31)).astype(np.float32)
    label = translation_filter.label_spectrum(5, 5, (1.0, 1.0))
    first = translation_filter.learn(None, a, label, 18, 0.1)
    np.testing.assert_allclose(
        translation_filter.learn(first, b, label, 18, 0.1).template, 0.9 * a + 0.1 * b, atol=1e-6
    )
    same = translation_filter.learn(first, a, label, 18, 0.1)
    np.testing.assert_allclose(same.denominator, first.denominator, rtol=1e-4)


@given(st.floats(-3.4, 3.4), st.floats(-2.4, 2.4), st.floats(0.6, 1.5))
def test_peak_is_found_between_the_samples(u: float, v: float, sigma: float) -> None:
    """A Gaussian made in the frequency domain, so that its shift is exact and its place known."""
    rows, columns = 21, 27
    ky, kx = 2 * np.pi * fft.fftfreq(rows), 2 * np.pi * fft.rfftfreq(columns)
    spectrum = np.exp(-0.5 * sigma**2 * (ky[:, None] ** 2 + kx**2) - 1j * (ky[:, None] * v + kx * u))
    place, value, response = peak(spectrum, columns)
    np.testing.assert_allclose(place, [u, v], atol=1e-4)
    assert value >= np.max(response) - 1e-12
    centred = np.exp(-0.5 * sigma**2 * (ky[:, None] ** 2 + kx**2))
    assert value == pytest.approx(
        fft.irfft2(centred, s=(rows, columns))[0, 0], abs=1e-9
    )  # not changed by the shift


@given(st.floats(-6.0, 6.0))
def test_series_peak_counts_in_dense_samples(shift: float) -> None:
    k = 2 * np.pi * fft.rfftfreq(17)
    spectrum = np.exp(-0.5 * (1.06 * k) ** 2 - 1j * k * shift)
    place, _ = series_peak(spectrum, 17, 33)
    assert place == pytest.approx(shift * 33 / 17, abs=0.03)


def test_odd_fast_lengths() -> None:
    assert [odd_fast_length(n) for n in (0.5, 3, 3.1, 13, 64, 100)] == [3, 3, 5, 15, 75, 105]


def test_peak_to_sidelobe_of_a_spike_and_of_nothing() -> None:
    assert peak_to_sidelobe(np.zeros((15, 15)), (1.0, 1.0)) == 0.0
    noise = np.random.default_rng(0).normal(size=(41, 41))
    noise[20, 20] = 30.0
    assert peak_to_sidelobe(noise, (1.0, 1.0)) == pytest.approx(30.0, rel=0.1)
