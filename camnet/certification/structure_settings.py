"""Settings of certificates for agents that learn structure from their own motion: what is stated of their errors."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from camnet.settings import NonNegative, Positive, Settings

__all__ = ["LandmarkBounds", "PrintedBounds", "StructureBounds", "TargetModelBounds"]


class LandmarkBounds(Settings):
    """Chapter 4: features of stationary objects.

    ``lambda_a`` is the threshold of informative motion, ``kx_min_per_s`` the least eigenvalue of the gain K_X;
    ``distance_max_m`` bounds distances, ``error_lo_m`` and ``error_hi_m`` are the error's thresholds.
    """

    lambda_a: Annotated[float, Field(gt=0, le=1, allow_inf_nan=False)] = 0.3
    kx_min_per_s: Positive = 30.0
    distance_max_m: Positive = 5.0
    error_lo_m: Positive = 0.01
    error_hi_m: Positive = 0.25


class TargetModelBounds(Settings):
    """Chapter 5: the target when it leaves the view, and the model by which it is predicted.

    ``position_m``, ``velocity_mps`` bound the errors at that moment. With ``slope_per_s2`` the model is of
    acceleration: ``slope_per_s2``, ``damping_per_s`` are its Lipschitz constants in position and velocity, ``error``
    bounds what it is off by, weights and residual, m/s^2. Without, it is a velocity field: ``damping_per_s`` is its
    Lipschitz constant, ``error`` in m/s. What the
    agent's heading is off by in the model's frame is part of ``error``.
    """

    position_m: NonNegative = 0.05
    velocity_mps: NonNegative = 0.02
    slope_per_s2: NonNegative | None = None
    damping_per_s: NonNegative = 0.0
    error: NonNegative = 0.02


class PrintedBounds(Settings):
    """What the printed constants c1 to c5 ask for (`camnet.certification.bell_dwell.MovingTargetConstants`)."""

    camera_rate_radps: NonNegative = 0.5
    weight_bound: NonNegative = 1.0
    sigma_bar: NonNegative = 1.0
    sigma_eta: NonNegative = 1.0
    sigma_nu: NonNegative = 1.0
    nu_bar: NonNegative = 0.5
    phi_q: NonNegative = 1.0
    eps_bar: NonNegative = 0.01
    gamma_inv_min: Positive = 1.0
    gamma_inv_max: Positive = 1.0
    k_eta_min: Positive = 10.0
    k_nu_min: Positive = 10.0
    k_w_min: Positive = 1.0
    k_w_max: Positive = 1.0
    stack_lambda: Positive = 0.01
    stack_norm: NonNegative = 10.0
    stack_size: Annotated[int, Field(ge=1, le=1_000_000)] = 100
    window_s: NonNegative = 1.0
    velocity_noise: NonNegative = 0.02


class StructureBounds(Settings):
    """That agents learn structure from their own motion, and what is stated of their errors.

    ``speed_error_mps``, ``rate_error_radps`` bound the errors of an agent's measured velocities;
    ``camera_speed_mps`` is its highest speed (None: the quadrotor's).
    ``on_s`` is how long a target is seen between two gaps, for the printed theorem. ``stretches`` are simulated for
    ``learned``, with errors drawn within these bounds.
    """

    speed_error_mps: NonNegative = 0.02
    rate_error_radps: NonNegative = 0.002
    camera_speed_mps: Positive | None = None
    on_s: NonNegative = 15.0
    stretches: Annotated[int, Field(ge=1, le=10_000)] = 100
    landmark: LandmarkBounds = LandmarkBounds()
    target: TargetModelBounds = TargetModelBounds()
    printed: PrintedBounds = PrintedBounds()
