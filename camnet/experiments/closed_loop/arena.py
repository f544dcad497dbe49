"""The world that an attack is flown in: hostile targets in the place of the world's, wind from any side.

Assumptions that are falsified on request change the world flown, and never the promise:

| ``--violate`` | what differs |
| --- | --- |
| ``speed=+20%`` | targets drive up to 20 % faster (``-20%``: 20 % slower) than stated, whenever the attacker wants |
| ``footprint=-30%`` | every camera sees a field of view 30 % narrower, measured on the ground |
| ``wind=x2`` | mean wind, gusts and disturbance are twice as strong |
| ``promise=-20%`` | the promise itself is 20 % tighter than stated |
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from camnet.config.models import Scenario
from camnet.errors import ConfigError
from camnet.experiments.closed_loop.plan import Plan
from camnet.experiments.world_ways import wander_m
from camnet.motion.planned import PlannedField, PlannedRoad
from camnet.motion.protocol import TargetMotion
from camnet.motion.road import RoadMotion
from camnet.motion.settings import FieldTarget, RoadTarget, TrackTarget
from camnet.motion.vector_field import VectorFieldMotion
from camnet.simulation.network import Network
from camnet.world.description import WorldDescription

__all__ = ["VIOLATIONS", "check_attackable", "hostile", "parse_violation", "violated", "with_targets"]

VIOLATIONS = ("speed", "footprint", "wind", "promise")
_CHANGE = re.compile(r"(speed|footprint|wind|promise)=(?:([+-][0-9.]+)%|x([0-9.]+))")


def parse_violation(text: str) -> tuple[str, float]:
    """Parse ``speed=+20%`` or ``wind=x2`` into what changes and the factor.

    Raises
    ------
    ValueError
        It is no such change, or leaves nothing.
    """
    match = _CHANGE.fullmatch(text.strip())
    if match is None:
        raise ValueError(f"{text!r}: give speed, footprint, wind or promise, as speed=+20% or wind=x2")
    factor = float(match[3]) if match[3] else 1.0 + float(match[2]) / 100.0
    if not 0.0 < factor < math.inf or factor == 1.0:
        raise ValueError(
            f"{text!r}: is a factor of {factor:g}; one above 0 that changes something was expected"
        )
    return match[1], factor


def check_attackable(scenario: Scenario) -> None:
    """Refuse a world whose targets have nothing to choose (ConfigError)."""
    if not scenario.targets:
        raise ConfigError(f"world {scenario.name!r} has no targets: nobody can break a promise")
    for target in scenario.targets:
        if isinstance(target.motion, TrackTarget | FieldTarget):
            what = "a recording" if isinstance(target.motion, TrackTarget) else "a stated law of motion"
            raise ConfigError(
                f"targets.{target.name}.motion.kind = {target.motion.kind!r}: {what} chooses nothing; attack targets "
                "of kind road or vector_field"
            )


def with_targets(scenario: Scenario, count: int) -> Scenario:
    """Return the world with ``count`` targets at the same time: copies of its own are added, or the last left out."""
    own = scenario.targets
    more = [
        own[k % len(own)].model_copy(update={"name": f"{own[k % len(own)].name}_{k // len(own) + 1}"})
        for k in range(len(own), count)
    ]
    return scenario.model_copy(update={"targets": (*own[:count], *more)})


def violated(scenario: Scenario, changes: Mapping[str, float]) -> Scenario:
    """Return the world in which assumptions are false: each of ``changes`` is a factor.

    Raises
    ------
    ConfigError
        There is nothing to change: no wind, for instance.
    """
    if "speed" in changes:
        scenario = _faster(scenario, changes["speed"])
    if "footprint" in changes:
        cameras = [_narrower(camera, changes["footprint"]) for camera in scenario.cameras]
        scenario = scenario.model_copy(update={"cameras": tuple(cameras)})
    if "wind" in changes:
        scenario = _windier(scenario, changes["wind"])
    return scenario


def _faster(scenario: Scenario, factor: float) -> Scenario:
    targets = []
    for target in scenario.targets:
        motion: Any = target.motion
        if isinstance(motion, RoadTarget):
            slow, fast = motion.speed_mps
            speed: Any = (min(slow, factor * slow), max(fast, factor * fast))
            top = speed[1]
        else:  # the plan decides when, see `camnet.motion.planned.DrivePlan.pace`
            speed = motion.speed_mps
            top = factor * speed * (1.0 + motion.speed_modulation)
        update = {
            "motion": motion.model_copy(update={"speed_mps": speed}),
            "v_max_mps": max(target.v_max_mps, top),
            "w_max_radps": max(factor, 1.0) * target.w_max_radps,
        }
        targets.append(target.model_copy(update=update))
    return scenario.model_copy(update={"targets": tuple(targets)})


def _narrower(camera: Any, factor: float) -> Any:  # noqa: ANN401 - a pydantic model
    optics = camera.intrinsics
    zoomed = optics.model_copy(update={"fx_px": optics.fx_px / factor, "fy_px": optics.fy_px / factor})
    return camera.model_copy(update={"intrinsics": zoomed})


def _windier(scenario: Scenario, factor: float) -> Scenario:
    physics, wind = scenario.physics, scenario.physics.wind
    disturbed = physics.actuation == "kinematic" and physics.disturbance > 0.0
    if not scenario.agents:
        raise ConfigError("--violate wind: no agent flies here, so wind moves nothing")
    if not any(wind.mean_mps) and not wind.gust_std_mps and not disturbed:
        raise ConfigError(
            "--violate wind: physics.wind states no wind, and twice nothing is nothing; state one, such as "
            "--set physics.wind.gust_std_mps=0.5"
        )
    stronger = wind.model_copy(
        update={
            "mean_mps": tuple(factor * v for v in wind.mean_mps),
            "gust_std_mps": factor * wind.gust_std_mps,
        }
    )
    update = {"wind": stronger, "disturbance": factor * physics.disturbance}
    return scenario.model_copy(update={"physics": physics.model_copy(update=update)})


def hostile(network: Network, plan: Plan) -> WorldDescription:
    """Return what the world is made of under an attack: targets and wind follow the plan."""
    description, scenario = network.description, network.scenario
    corridor = scenario.certificate.corridor_m
    targets = tuple(
        replace(target, motion=_planned(target.motion, plan, m, corridor))
        for m, target in enumerate(description.targets)
    )
    physics, wind = description.physics, description.physics.wind
    x, y, z = wind.mean_mps
    strength = math.hypot(x, y)
    turned = (strength * math.cos(plan.wind_rad), strength * math.sin(plan.wind_rad), z)
    wind = wind.model_copy(update={"mean_mps": turned})
    return replace(description, targets=targets, physics=physics.model_copy(update={"wind": wind}))


def _planned(motion: TargetMotion, plan: Plan, m: int, corridor_m: float) -> TargetMotion:
    if isinstance(motion, RoadMotion):
        return PlannedRoad(motion, plan.targets[m], wander_m(motion.lateral_std_m))
    if isinstance(motion, VectorFieldMotion):
        return PlannedField(motion, plan.targets[m], corridor_m)
    raise ConfigError("targets of kind 'track' choose nothing")
