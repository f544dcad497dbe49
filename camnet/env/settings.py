"""Settings of the handoff environment."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field

from camnet.errors import ConfigError
from camnet.settings import Fraction, NonNegative, Positive, Settings

__all__ = ["EnvSettings", "FailureSettings", "RewardSettings", "merged_settings"]


class RewardSettings(Settings):
    """Weights of the shared reward; one decision lasts dt seconds.

    ``in_view`` a second for each target in view (divided by the number of targets), ``reacquired`` for each
    completed handoff scaled by the share of the grace time left, ``lost`` for each missed handoff, ``effort`` a
    second for the mean squared speed of the agents over their squared top speed, ``region_exit`` a second and
    agent outside its region, ``collision`` once.

    A policy's return over an episode of T seconds with H handoffs is at most ``in_view * T + reacquired * H``.
    """

    in_view: NonNegative = 1.0
    reacquired: NonNegative = 1.0
    lost: NonNegative = 2.0
    effort: NonNegative = 0.05
    region_exit: NonNegative = 5.0
    collision: NonNegative = 20.0


class FailureSettings(Settings):
    """When agents fail: at random, by a schedule, or both.

    Each agent fails with ``rate_per_s`` (the hazard of an exponential lifetime), or at the time that ``schedule_s``
    names for it. A failed agent's camera sees nothing and it sends no messages any more; its body hovers where it was.
    """

    rate_per_s: NonNegative = 0.0
    schedule_s: dict[str, NonNegative] = Field(default_factory=dict)


class EnvSettings(Settings):
    """How the network is shown to policies.

    ``gaze_max_rad`` is the largest pan and tilt away from straight down; ``neighbours`` the number of nearest agents
    in an observation, those farther than ``communication_range_m`` being left out.

    ``action_mode`` and ``region_guard`` are explained in `camnet.env.actions`, ``observation_form`` ("flat" array or
    "dict" of named parts) in `camnet.env.layout`, ``info_form`` ("nested" or "flat" numbers) in `camnet.env.infos`,
    ``message_delay_s`` and ``message_loss`` in `camnet.env.messages`.

    ``score`` says which entries into a region count as handoffs: "v0" those of targets that were seen before,
    elsewhere, and are unseen now; "v1" every one, by the truth: a team that never looks is charged for all it misses.
    ``cameras`` "off" blinds the whole network, for comparison.
    """

    max_cycles: Annotated[int, Field(gt=0, le=10_000_000)] = 600
    gaze_max_rad: Annotated[float, Field(gt=0, lt=1.5)] = 1.2
    neighbours: Annotated[int, Field(ge=0, le=1000)] = 2
    communication_range_m: Positive = 100.0
    terminate_on_collision: bool = True
    lost_limit_s: Positive | None = None
    reward: RewardSettings = RewardSettings()
    action_mode: Literal["setpoint", "velocity", "assign"] = "setpoint"
    observation_form: Literal["flat", "dict"] = "flat"
    info_form: Literal["nested", "flat"] = "nested"
    region_guard: bool = True
    message_delay_s: NonNegative = 0.0
    message_loss: Fraction = 0.0
    failures: FailureSettings = FailureSettings()
    score: Literal["v0", "v1"] = "v0"
    cameras: Literal["on", "off"] = "on"


def merged_settings(settings: EnvSettings | None, options: dict[str, Any]) -> EnvSettings:
    """Return ``settings`` with single fields from ``options`` in place; ``max_steps`` also names ``max_cycles``.

    Raises
    ------
    ConfigError
        A field is unknown or its value makes no sense.
    """
    if "max_steps" in options:
        options = {**options, "max_cycles": options["max_steps"]}
        del options["max_steps"]
    unknown = sorted(set(options) - set(EnvSettings.model_fields))
    if unknown:
        known = ", ".join(EnvSettings.model_fields)
        raise ConfigError(f"unknown option {unknown[0]!r} of the handoff environment; known are {known}")
    base = EnvSettings() if settings is None else settings
    try:
        return EnvSettings.model_validate({**base.model_dump(), **options})
    except ValueError as error:
        raise ConfigError(f"options of the handoff environment: {error}") from error
