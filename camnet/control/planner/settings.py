"""Settings of the trajectory planner."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from camnet.settings import NonNegative, Positive, Settings

__all__ = ["PlannerSettings"]

_Count = Annotated[int, Field(gt=0, le=100_000)]


class PlannerSettings(Settings):
    """Prior, obstacle likelihood and stopping rule of a plan.

    ``alpha_per_s`` to ``rest_density`` are those of `camnet.estimation.pls.PowerLimitedSteering`; large densities let
    a plan turn and accelerate freely; ``acceleration_density`` (m^2/s^3) is that of the manoeuvre
    term of `camnet.control.planner.objective`. A point at distance d from an obstacle is unblocked with probability
    1/(1 + exp((margin_m - d)/softness_m)), ``obstacle_rate_hz`` times a second, looked at ``samples_per_step`` times
    a step. A plan is accepted only when its curve keeps ``safety_m`` from every obstacle and ``region_margin_m`` from
    the region's border; waypoints count ``waypoint_weight`` times, a reserve. It has converged when
    no position moves by more than ``tolerance_m``; a descent solves at most ``iterations_max`` linear systems, a call
    at most ``solves_per_plan`` (None: all it needs), the rest is left to the next call.
    """

    dt_s: Positive = 1.0
    alpha_per_s: Positive = 0.01
    beta_mps2: Positive = 0.4
    power_density: Positive = 4.0
    steering_density: Positive = 0.05
    velocity_density: Positive = 2.0
    acceleration_density: Positive = 2.0
    rest_speed_mps: Positive = 2.0
    rest_density: Positive = 2.0
    start_power_sd: Positive = 2.0
    start_turn_sd_radps: Positive = 0.5
    safety_m: NonNegative = 0.3
    margin_m: Positive = 0.7
    softness_m: Positive = 0.15
    waypoint_weight: Positive = 2.0
    obstacle_rate_hz: Positive = 8.0
    samples_per_step: _Count = 6
    region_margin_m: NonNegative = 0.25
    tolerance_m: Positive = 0.05
    iterations_max: _Count = 40
    patience: _Count = 15
    solves_per_plan: _Count | None = None
    directions: _Count = 8
    attempts: _Count = 5
