"""Settings of the certificates: the bounds that the proofs assume."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from camnet.certification.structure_settings import StructureBounds
from camnet.settings import NonNegative, Positive, Settings

__all__ = ["CertificateSettings", "DetectionSettings"]


class DetectionSettings(Settings):
    """When a target in view of a fixed camera counts as seen: ``count`` detections with probability ``confidence``.

    A camera takes ``rate_hz`` frames in a second, each of which shows the target to its detector with ``probability``,
    one by one; ``latency_s`` is how late a detection is known.
    """

    rate_hz: Positive
    probability: Annotated[float, Field(gt=0.0, le=1.0)]
    count: Annotated[int, Field(ge=1, le=1000)] = 1
    confidence: Annotated[float, Field(gt=0.0, lt=1.0)] = 0.99
    latency_s: NonNegative = 0.0


class CertificateSettings(Settings):
    """Bounds assumed by the dwell-time conditions (harris2020, sections 3.2 and 4.3).

    ``eps_bar`` bounds the residual of the motion model. ``etadot_max`` bounds the rate of the target's pose;
    ``None``: from the target's ``v_max`` and ``w_max``. ``v_lo`` is the Lyapunov level that the error must fall
    below while observed; ``None``: the geometric mean of the floor of the error and the upper level.
    ``working_range_m`` is the distance at which targets are watched; ``None``: the middle of the camera's range.
    ``sigma_bar`` bounds the norm of the basis; ``None``: from the spacing and width of its kernels.
    ``weight_bound`` bounds the norm of the ideal weights; ``None``: the estimator's projection radius.
    ``initial_error_m`` is the position error allowed when the target leaves; ``None``: sqrt(2 v_lo) where dwell
    times are concerned, and 0.05 m for the ``learned`` certificate.
    ``off_max_s`` is the longest time out of view that the designer allows; ``None``: for ``sound`` the dwell time, for
    ``learned`` the longest gap that the estimator learns across. ``corridor_m`` is how far beside the path
    that it learned from a target may be. ``position_error_m`` and ``orientation_error_rad`` bound the error of a
    measured pose; ``None``: five standard deviations on every axis where the world states them (level ``pose``).
    ``field_slope_per_s`` bounds the Lipschitz constant of the target's own law in the corridor, with which e_v is a
    bound between the points too at which it is taken. ``detection`` says when a target in view counts as seen;
    ``None``: at once. ``structure`` says that agents learn structure from their own motion, and bounds their errors.
    """

    eps_bar: NonNegative = 0.01
    etadot_max: Positive | None = None
    v_lo: Positive | None = None
    working_range_m: Positive | None = None
    sigma_bar: Positive | None = None
    weight_bound: Positive | None = None
    initial_error_m: NonNegative | None = None
    off_max_s: Positive | None = None
    corridor_m: NonNegative = 0.02
    position_error_m: NonNegative | None = None
    orientation_error_rad: NonNegative | None = None
    field_slope_per_s: NonNegative | None = None
    detection: DetectionSettings | None = None
    structure: StructureBounds | None = None
