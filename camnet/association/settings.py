"""Settings of the association across gaps."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from camnet.settings import Fraction, NonNegative, Positive, Settings

__all__ = ["DensitySettings", "FutureSettings", "IdentitySettings"]


class DensitySettings(Settings):
    """Kernel density of crossings; a scale is the standard deviation of a kernel.

    ``position_scale_m``, ``velocity_scale_mps``: how alike two exits are. ``log_time_scale`` of the logarithm of the
    time away, and not less than ``time_floor_s``; ``place_scale_m`` of the place of entry, ``turn_scale_mps`` of
    the velocity at entry. A lesson's entry is moved by the share ``carry`` of the difference between the two exits.

    ``time_floor_s`` should be half the time between a recording's fixes: recorders that write every ten seconds
    make a true time away a multiple of ten, and a narrower kernel would tell recorders apart, not people.

    ``prior_weight``: the exit velocity, fading with ``prior_memory_s``, stands beside the lessons as one more, in a
    circle of ``prior_spread_m`` that grows by ``prior_growth_mps``.

    ``recency_bonus``: lessons of the same hour are nearer by this, fading with ``recency_s``.
    """

    position_scale_m: Positive = 7.0
    velocity_scale_mps: Positive = 1.0
    log_time_scale: Positive = 0.2
    time_floor_s: NonNegative = 5.0
    place_scale_m: Positive = 7.0
    turn_scale_mps: Positive = 0.6
    carry: Fraction = 0.5
    reversed_penalty: NonNegative = 0.6
    prior_weight: Annotated[float, Field(gt=0, le=1e3)] = 0.3
    prior_memory_s: Positive = 20.0
    prior_spread_m: Positive = 10.0
    prior_growth_mps: NonNegative = 0.5
    recency_bonus: NonNegative = 2.0
    recency_s: Positive = 7200.0


class IdentitySettings(Settings):
    """Association across gaps.

    ``window_s``: a decision is revised until this long after the entry. ``companion_time_s``,
    ``companion_place_m``: how near two exits, or two entries, are of people who walk together. ``horizon_s``:
    running alone, a gap is given up after this.
    """

    density: DensitySettings = DensitySettings()
    window_s: Positive = 180.0
    companion_time_s: Positive = 15.0
    companion_place_m: Positive = 15.0
    horizon_s: Positive = 600.0
    folds: Annotated[int, Field(ge=2, le=100)] = 5


class FutureSettings(Settings):
    """Branches: how alike two exits are (standard deviations of kernels), priors, intervals.

    ``prior_strength``: crossings that the shares over all exits of a view are worth; ``equal_strength``: crossings that
    equal shares are worth. ``recency_s``: lessons fade with the time since them; None: they do not. ``coverage``: share
    that the calibrated intervals hold.
    """

    position_scale_m: Positive = 3.0
    velocity_scale_mps: Positive = 2.0
    recency_s: Positive | None = None
    prior_strength: Positive = 1.0
    equal_strength: Positive = 1.0
    log_time_width: Positive = 0.1
    calibrate: bool = True
    coverage: Annotated[float, Field(gt=0, lt=1)] = 0.8
    calibration_size: Annotated[int, Field(gt=0, le=1_000_000)] = 400
