"""Settings of the handoff environment."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from camnet.settings import NonNegative, Positive, Settings

__all__ = ["EnvSettings", "RewardSettings"]


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


class EnvSettings(Settings):
    """How the network is shown to policies.

    ``gaze_max_rad`` is the largest pan and tilt away from straight down; ``neighbours`` the number of nearest agents
    in an observation, those farther than ``communication_range_m`` being left out.
    """

    max_cycles: Annotated[int, Field(gt=0)] = 600
    gaze_max_rad: Annotated[float, Field(gt=0, lt=1.5)] = 1.2
    neighbours: Annotated[int, Field(ge=0)] = 2
    communication_range_m: Positive = 100.0
    terminate_on_collision: bool = True
    lost_limit_s: Positive | None = None
    reward: RewardSettings = RewardSettings()
