"""Settings of where an agent's knowledge of its own pose comes from, and of what it knows when that is lost.

| source | while the external pose is there | in an outage |
| --- | --- | --- |
| ``external`` | the true pose | there is none |
| ``dead_reckoning`` | velocity source and fixes, filtered; learns scale and gyro bias | velocity source |
| ``key_frames`` | the same | velocity source, heading held by rotations between images |

Height and tilt are known throughout: from the height sensor that optical flow needs anyway, and from gravity.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from camnet.settings import NonNegative, Positive, Settings

__all__ = ["ErrorBounds", "ExternalFixes", "PoseSource", "VelocitySource", "VisualRotation"]


#: an instant so close before an outage's end or beginning is on it, s
_EARLY_S = 1e-6


class VelocitySource(Settings):
    """Horizontal velocity from optical flow and height, and a gyro about the vertical, with their errors.

    ``scale`` and ``gyro_bias_radps`` are standard deviations over runs; a run's own values are constant, drawn within
    two of them. White noise adds ``position_walk_m`` to the position and ``heading_walk_rad`` to the heading in one
    second (standard deviations; they grow with the root of time).
    """

    scale: Annotated[float, Field(ge=0, le=0.4, allow_inf_nan=False)] = 0.03
    gyro_bias_radps: NonNegative = 0.002
    position_walk_m: NonNegative = 0.01
    heading_walk_rad: NonNegative = 0.0002


class ExternalFixes(Settings):
    """Fixes of the external pose: how often, and the standard deviations of position (an axis) and heading."""

    rate_hz: Positive = 10.0
    position_noise_m: Positive = 0.02
    heading_noise_rad: Positive = 0.005


class VisualRotation(Settings):
    """Turn of the camera between two images of one scene: every ``every_s``, with ``turn_noise_rad`` (SD)."""

    every_s: Positive = 2.0
    turn_noise_rad: Positive = 0.0044


class ErrorBounds(Settings):
    """What is stated of the errors that an outage begins with, for the certificate.

    ``position_m`` and ``heading_rad`` bound the pose's error when the external pose is lost, ``scale`` and
    ``gyro_bias_radps`` what calibration leaves of the velocity source's. Accumulated white noise is taken to stay
    within ``sigmas`` standard deviations, and the four bounds to be as many.
    """

    position_m: NonNegative = 0.05
    heading_rad: NonNegative = 0.01
    scale: Annotated[float, Field(ge=0, lt=1, allow_inf_nan=False)]
    gyro_bias_radps: NonNegative
    sigmas: Annotated[float, Field(ge=1, le=10, allow_inf_nan=False)] = 5.0


class PoseSource(Settings):
    """Where an agent's own pose comes from; see the module's table.

    ``outages_s`` are intervals [from, to] of the run's time without external pose. ``bounds`` default to those of a
    source that was never calibrated: two standard deviations of ``velocity``. ``calibrate: false`` takes the velocity
    as it is measured.
    """

    source: Literal["external", "dead_reckoning", "key_frames"] = "external"
    outages_s: Annotated[tuple[tuple[NonNegative, NonNegative], ...], Field(max_length=1000)] = ()
    velocity: VelocitySource = VelocitySource()
    fixes: ExternalFixes = ExternalFixes()
    visual: VisualRotation = VisualRotation()
    calibrate: bool = True
    bounds: ErrorBounds | None = None

    @property
    def may_be_lost(self) -> bool:
        """Whether the agent flies by an estimate of its pose."""
        return self.source != "external"

    @property
    def longest_outage_s(self) -> float:
        """Length of the longest outage, s; 0 without any."""
        return max((end - begin for begin, end in self.outages_s), default=0.0)

    def lost_at(self, t_s: float) -> bool:
        """Whether ``t_s`` lies in an outage."""
        return any(begin <= t_s + _EARLY_S < end for begin, end in self.outages_s)
