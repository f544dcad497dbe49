"""Settings of the learning estimator, its basis, its history stack and the remedies of the gap problem."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from camnet.errors import ConfigError
from camnet.settings import Fraction, NonNegative, Positive, Settings
from camnet.types import Array

__all__ = [
    "AdateFilterSettings",
    "BasisSettings",
    "EkfSettings",
    "EstimatorSettings",
    "GapSettings",
    "StackSettings",
    "checked_bounds",
]


class BasisSettings(Settings):
    """Radial basis functions over position (and heading), placed by ``placement``.

    ``road``: along the roads of the world and their margins; ``grid``: over the bounding box of all regions.
    ``width_m`` is the Gaussian's standard deviation; with ``position_heading`` the heading enters as
    ``heading_scale_m * (cos, sin)``.
    """

    placement: Literal["auto", "grid", "road"] = "auto"
    inputs: Literal["position", "position_heading"] = "position"
    spacing_m: Positive = 0.5
    width_m: Positive = 0.5
    margin_m: NonNegative = 1.0
    heading_scale_m: Positive = 0.5
    headings: Annotated[int, Field(gt=0, le=360)] = 8
    max_kernels: Annotated[int, Field(gt=0, le=4000)] = 400


class StackSettings(Settings):
    """History stack: ``size`` windows of ``window_s``; ``rule`` chooses which to keep.

    ``lambda_min`` is the printed rule in one eigendecomposition, with ``d_optimal`` in its place where the smallest
    eigenvalue is below rounding; ``lambda_min_naive`` is the printed rule by brute force.
    Each end of a window is the mean of ``average`` poses: the mean of that many windows, each shifted by one sample,
    is a window equation itself, and its noise is smaller. ``outlier_gate`` is in standard deviations of the recent
    window residuals. With ``forgetting``, a run of windows beyond the gate is taken for a change of the target's ways,
    and what contradicts it nearby leaves the stack. Finite excitation: eigenvalues from ``excitation_threshold`` on
    (s^2) count, and all but ``excitation_share`` of new regressors must lie among them.
    """

    size: Annotated[int, Field(gt=0, le=20_000)] = 600
    window_s: Positive = 0.4
    average: Annotated[int, Field(gt=0, le=1000)] = 4
    rule: Literal["lambda_min", "lambda_min_naive", "d_optimal"] = "d_optimal"
    excitation_threshold: Positive = 1e-3
    excitation_share: Fraction = 0.1
    regularisation: Positive = 1e-3
    outlier_gate: Positive = 6.0
    forgetting: bool = True


class GapSettings(Settings):
    """Remedies of the gap problem: what carries the prediction where nothing was measured.

    ``prior`` takes over where the learned model has no data; its turn rate fades with ``turn_memory_s``. ``road`` turns
    as the world's roads do; off them, and in a world without any, it is ``constant_turn``.
    ``learn_across`` puts the path across a gap, reconstructed ``entry_s`` after the re-sighting, into the stack.
    ``accel_psd_m2ps3`` is the unknown acceleration assumed for that path, ``path_std_mps`` the velocity uncertainty
    at which a window of it counts half as much as a measured one. ``pace`` makes the target's speed a state: the
    learned velocities are scaled by how fast it left, as far as that has been found to last.
    """

    prior: Literal["none", "constant_velocity", "constant_turn", "road"] = "road"
    turn_memory_s: Positive = 5.0
    handover_s: Positive = 1.0
    learn_across: bool = True
    entry_s: Positive = 0.6
    max_gap_s: Positive = 60.0
    accel_psd_m2ps3: Positive = 1e-3
    path_std_mps: Positive = 0.05
    pace: bool = False


class EkfSettings(Settings):
    """Constant-velocity Kalman filter: unknown accelerations (power spectral densities) and measurement noise."""

    accel_psd_m2ps3: Positive = 3e-3
    angular_accel_psd_rad2ps3: Positive = 3e-3
    position_noise_m: Positive = 0.01
    orientation_noise_rad: Positive = 0.01


class AdateFilterSettings(Settings):
    """Adaptive trajectory estimation as predictor of a target (li2019): the steering model and the smoother's step.

    ``alpha_per_s`` and ``beta_mps2`` are the drag, ``power_density`` and ``steering_density`` the densities to begin
    with (they are learnt), ``rest_density`` and ``rest_speed_mps`` white acceleration at rest and where it begins.
    A gap longer than ``restart_s`` ends a track. ``keep`` and ``limit`` are observed and most steps in the window.
    """

    step_s: Positive = 0.2
    alpha_per_s: Positive = 0.01
    beta_mps2: Positive = 0.4
    power_density: Positive = 1e-3
    steering_density: Positive = 1e-4
    rest_density: Positive = 3e-3
    rest_speed_mps: Positive = 0.02
    turn_sd_radps: Positive = 0.5
    position_noise_m: Positive = 0.01
    process_gain: NonNegative = 0.05
    restart_s: Positive = 2.0
    keep: Annotated[int, Field(gt=0, le=10_000)] = 30
    limit: Annotated[int, Field(gt=0, le=10_000)] = 60


class EstimatorSettings(Settings):
    """Update laws (3-6)-(3-12), (4-16)-(4-20): gains ``k1_per_s``, ``k2``, ``kcl``, ``gamma``, mix ``alpha``.

    ``form: twist`` learns [v; w] and multiplies by B(q); ``stacked`` learns the seven rates of the papers.
    ``leakage`` draws weights without data to zero (0: the printed law). ``share`` lets all regions use one model.
    Nothing is learned from a camera whose own pose puts the target in the world worse than ``learn_within_m`` (standard
    deviation).
    """

    form: Literal["twist", "stacked"] = "twist"
    frame: Literal["world", "relative"] = "world"
    share: bool = False
    k1_per_s: Positive = 3.0
    k2: NonNegative = 0.1
    kcl: Positive = 1.0
    gamma: Positive = 1.0
    alpha: Fraction = 1.0
    leakage: NonNegative = 1e-3
    switching: Literal["sign", "sat", "tanh"] = "tanh"
    boundary_layer: Positive = 0.05
    weight_bound: Positive = 20.0
    reset_on_sighting: bool = True
    learn_within_m: Positive = 0.05
    regression_samples: Annotated[int, Field(ge=3, le=10_000)] = 20
    basis: BasisSettings = BasisSettings()
    stack: StackSettings = StackSettings()
    gap: GapSettings = GapSettings()
    ekf: EkfSettings = EkfSettings()
    adate: AdateFilterSettings = AdateFilterSettings()


def checked_bounds(tracking_bounds: Array, n_regions: int, rate_hz: float) -> Array:
    """Box (2, 3) that targets stay in, m, world frame: the lower corner, then the upper.

    Raises
    ------
    ConfigError
        If it is no such box, or the number of regions or the rate of measurements, Hz, is not positive.
    """
    bounds = np.array(tracking_bounds, dtype=float)
    if bounds.shape != (2, 3) or not (bounds[0] < bounds[1]).all():
        raise ConfigError(
            f"tracking_bounds: {bounds.tolist()}, expected (2, 3), the lower row below the upper"
        )
    if n_regions < 1 or not rate_hz > 0.0:
        raise ConfigError(f"n_regions {n_regions}, rate_hz {rate_hz}: both must be positive")
    return bounds
