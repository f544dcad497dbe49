"""Settings of key frames and of the observer of their distances; defaults are published where the paper states them.

| name | published | what |
| --- | --- | --- |
| ``k``, ``k_x`` | 40, 30 1/s | gains K and K_X, multiples of the identity |
| ``lambda_a`` | 0.3 | motion is informative where ``1 - |u_kc^T u_ic|`` exceeds it |
| ``window_s`` | up to 1 s | window of a sample, from the last instant the motion became informative |
| ``stack_size``, ``stack_lambda`` | 50, 1e-4 | samples N of the stack; learned once ``YY`` exceeds lambda |
| ``least_y``, ``least_u_m``, ``distance_m`` | 0.1, 0.15 m, 0.5 to 5 m | samples that are accepted |
| ``gate_px``, ``gate`` | 3 (or 10) pixels, 6.63 | standard deviation and chi-square bound of both gates |
| ``settled_m`` | 0.01 m | th_lo, the distance error after the first dwell time |
| ``least_features``, ``most_features``, ``spacing_px`` | 20, 50, 100 pixels | life of a key frame |
| ``near_expected`` | 0.1 | two-view solutions further from the expected pose are not used |
| ``start_m`` | | first estimate of the distances; not published, the mean distance is |
| ``flow_filter_s``, ``pose_filter_s`` | | time constants of the filtered flow and relative pose; not published |

6.63 is the 99 % bound of one degree of freedom; the gates test two coordinates, for which it is 9.21. The published
number is the default.
"""

from __future__ import annotations

from pydantic import Field

from camnet.settings import Fraction, NonNegative, Positive, Settings

__all__ = ["KeyFrameSettings", "RelativePoseSettings"]


class RelativePoseSettings(Settings):
    """How the pose of a key frame is found about the expected one; see `relative_pose`.

    Attributes
    ----------
    noise_px : least standard deviation of a tracked corner, pixels
    tilt_sd_rad, turn_sd_rad : prior standard deviations of the expected rotation about the axes across the vertical
        and about it (camera x and z; y)
    direction_sd_rad : of the expected direction, beside what follows from the rotation
    """

    noise_px: Positive = 0.5
    tilt_sd_rad: Positive = 0.003
    turn_sd_rad: Positive = 0.1
    direction_sd_rad: Positive = 0.005


class KeyFrameSettings(Settings):
    """See the module's table."""

    k: Positive = 40.0
    k_x: Positive = 30.0
    lambda_a: Fraction = 0.3
    window_s: Positive = 1.0
    stack_size: int = Field(default=50, ge=1)
    stack_lambda: Positive = 1e-4
    least_y: Positive = 0.1
    least_u_m: Positive = 0.15
    distance_m: tuple[Positive, Positive] = (0.5, 5.0)
    gate_px: Positive = 3.0
    gate: Positive = 6.63
    settled_m: Positive = 0.01
    least_features: int = Field(default=20, ge=4)
    most_features: int = Field(default=50, ge=4)
    spacing_px: NonNegative = 100.0
    near_expected: Positive = 0.1
    start_m: Positive = 1.5
    flow_filter_s: Positive = 0.1
    pose_filter_s: Positive = 0.2
    relative_pose: RelativePoseSettings = RelativePoseSettings()
