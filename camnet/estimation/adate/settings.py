"""Settings of the adaptive trajectory estimator."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from camnet.settings import NonNegative, Positive, Settings

__all__ = ["AdaptationSettings", "AdateSettings", "StartSettings", "TruncationSettings"]

_Count = Annotated[int, Field(gt=0, le=100_000)]


class StartSettings(Settings):
    """How a track begins: a linear constant-velocity smoother until the velocity is significant.

    ``significance`` is the normalised squared speed v' P^-1 v above which the steering model takes over.
    """

    speed_sd_m_s: Positive = 2.0
    significance: Positive = 25.0
    power_sd: Positive = 0.2
    balance_sd_m_s: Positive = 0.3
    turn_sd_rad_s: Positive = 0.05


class AdaptationSettings(Settings):
    """Adaptation of the transition covariance Q (35) and of the observation covariance R (39).

    ``process: score`` follows the likelihood of the densities, ``fading`` is (35) as printed, ``none`` keeps them.
    ``observation: local`` finds drift by the local mean of an observer's residuals, ``gate`` is (39) as printed,
    ``student`` weights each observation by a Student-t law, ``none`` keeps R.
    """

    process: Literal["score", "fading", "none"] = "score"
    process_gain: NonNegative = 0.05
    process_lag: _Count = 25
    process_range: Positive = 1000.0
    memory_s: Positive = 20.0
    observation: Literal["local", "gate", "student", "none"] = "local"
    drift_span: _Count = 8
    drift_gate: Positive = 16.0
    outlier_gate: Positive = 16.0
    learn_scale: bool = True
    scale_memory: Positive = 30.0
    student_dof: Positive = 4.0


class TruncationSettings(Settings):
    """Length of the part of the trajectory that is still updated (40), (41).

    A state is frozen when the weighted squared change of all states up to it stays below ``threshold``, when
    ``keep`` observed
    steps follow it; at most ``limit`` steps are kept in any case.
    """

    threshold: Positive = 1e-3
    average: Annotated[float, Field(gt=0, le=1)] = 0.3
    keep: _Count = 50
    limit: _Count = 160


class AdateSettings(Settings):
    """Adaptive trajectory estimation (li2019, section IV).

    An update takes ``iterations`` Gauss-Newton steps (fewer once the largest change is below ``tolerance``), and up to
    ``rescue`` of them until the largest squared transition error is below ``closed`` variances. A large ``iterations``
    iterates to convergence.
    """

    iterations: _Count = 1
    rescue: _Count = 6
    closed: Positive = 1e3
    tolerance: NonNegative = 1e-6
    start: StartSettings = StartSettings()
    adaptation: AdaptationSettings = AdaptationSettings()
    truncation: TruncationSettings = TruncationSettings()
