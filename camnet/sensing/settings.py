"""Settings of sensing."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from camnet.settings import Fraction, NonNegative, Positive, Settings

__all__ = ["SensingSettings"]


class SensingSettings(Settings):
    """How the truth becomes measurements.

    ``level: pose`` is the true relative pose plus noise; ``regression_samples`` is the window from which rates
    are regressed (20 in parikh2018), never from the truth; ``regression_degree`` 1 gives the rates in the middle of
    that window, 2 those at its end with four times the noise.
    """

    level: Literal["pose"] = "pose"
    rate_hz: Positive = 30.0
    position_noise_m: NonNegative = 0.01
    orientation_noise_rad: NonNegative = 0.01
    latency_s: NonNegative = 0.0
    dropout_probability: Fraction = 0.0
    regression_samples: Annotated[int, Field(ge=3)] = 20
    regression_degree: Literal[1, 2] = 1
