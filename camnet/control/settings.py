"""Settings of the pose controller and of its references."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from camnet.settings import Fraction, NonNegative, Positive, Settings

__all__ = ["ControllerSettings"]


class ControllerSettings(Settings):
    """Sliding-mode controller (4-6) and the C1 references it follows.

    ``d_bar_mps`` and ``d_bar_radps`` are the disturbance bounds of the robust term; outside them the envelope
    (4-27) does not hold and the run says so. ``image_fill`` is the share of the image's smaller half-angle that the
    target and its uncertainty should fill; ``target_extent_m`` is the
    radius of a ball about the target's origin that holds its features. ``obstacle_margin_m`` is what the camera keeps
    from obstacles in its region: the body about it and the tracking error.
    """

    rate_hz: Positive = 60.0
    k1_per_s: Positive = 2.0
    d_bar_mps: NonNegative = 0.3
    d_bar_radps: NonNegative = 0.5
    switching: Literal["sign", "sat", "tanh"] = "tanh"
    boundary_layer: Positive = 0.12
    reference_v_max_mps: Positive = 1.5
    reference_a_max_mps2: Positive = 2.0
    reference_jerk_max_mps3: Positive = 8.0
    reference_position_gain_per_s: Positive = 2.0
    reference_velocity_gain_per_s: Positive = 8.0
    reference_w_max_radps: Positive = 1.5
    reference_w_acceleration_radps2: Positive = 6.0
    gaze_gain_per_s: Positive = 4.0
    gaze_max_rad: Annotated[float, Field(gt=0, lt=1.4)] = 1.1
    region_margin_m: NonNegative = 0.25
    obstacle_margin_m: Positive = 0.5
    min_height_m: Positive = 0.8
    image_fill: Fraction = 0.5
    target_extent_m: Positive = 0.4
