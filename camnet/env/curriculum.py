"""Options of ``reset(options=...)``: the same world made easier or harder for one episode.

| option | meaning | default |
| --- | --- | --- |
| `target_speed_scale` | factor on the targets' speeds | 1 |
| `target_start` | "random": drawn along the path; or a share (0 to 1) of the way along it, one or one each | world's |
| `noise_scale` | factor on the noise of the pose sensors | 1 |
| `max_cycles` | length of the episode in decisions | environment's |
| `message_delay_s`, `message_loss` | see `camnet.env.messages` | environment's |
| `failure_rate_per_s` | hazard of each agent | environment's |

A speed scale above 1 raises the targets' bounds too, and with them the unit in which observations show velocities.
They hold for one episode. The key ``options`` is ignored: PettingZoo's API test passes it to every environment.
"""

from __future__ import annotations

import difflib
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, ValidationError

from camnet.config.models import Scenario
from camnet.env.settings import EnvSettings
from camnet.errors import ConfigError
from camnet.geometry.settings import Road
from camnet.motion.factory import build_motion
from camnet.motion.road_network import RoadNetwork
from camnet.motion.settings import FieldTarget, RoadTarget, TargetSettings, TrackTarget
from camnet.motion.vector_field import VectorFieldMotion
from camnet.settings import Fraction, NonNegative, Positive, Settings

__all__ = ["ResetOptions", "changed_scenario", "changed_settings", "read_options"]

Share = Annotated[float, Field(ge=0, lt=1, allow_inf_nan=False)]


class ResetOptions(Settings):
    """Options of one episode; None keeps what the environment has."""

    target_speed_scale: Positive = 1.0
    target_start: Literal["random"] | Share | tuple[Share, ...] | None = None
    noise_scale: NonNegative = 1.0
    max_cycles: Annotated[int, Field(gt=0)] | None = None
    message_delay_s: NonNegative | None = None
    message_loss: Fraction | None = None
    failure_rate_per_s: NonNegative | None = None


def read_options(options: dict[str, Any] | None) -> ResetOptions:
    """Check the options of a reset.

    Raises
    ------
    ConfigError
        An unknown option, or a value that is none; the message names it, quotes it and says what is known.
    """
    if options is not None and not isinstance(options, dict):
        raise ConfigError(f"reset options {options!r}: a dictionary was expected")
    given = {key: value for key, value in (options or {}).items() if key != "options"}
    for key in given:
        if key not in ResetOptions.model_fields:
            close = difflib.get_close_matches(str(key), list(ResetOptions.model_fields), 1)
            hint = f"did you mean {close[0]!r}? " if close else ""
            raise ConfigError(
                f"reset option {key!r}: unknown; {hint}known are {', '.join(ResetOptions.model_fields)}"
            )
    try:
        return ResetOptions.model_validate(given)
    except ValidationError as error:
        fault = error.errors()[0]
        name = str(fault["loc"][0])
        reasons = "; or ".join(dict.fromkeys(e["msg"].lower() for e in error.errors() if e["loc"][0] == name))
        raise ConfigError(f"reset option {name} = {given[name]!r}: {reasons}") from None


def changed_settings(settings: EnvSettings, options: ResetOptions) -> EnvSettings:
    """Return the environment's settings for one episode."""
    update: dict[str, Any] = {
        name: getattr(options, name)
        for name in ("max_cycles", "message_delay_s", "message_loss")
        if getattr(options, name) is not None
    }
    if options.failure_rate_per_s is not None:
        update["failures"] = settings.failures.model_copy(update={"rate_per_s": options.failure_rate_per_s})
    return settings.model_copy(update=update) if update else settings


def changed_scenario(scenario: Scenario, options: ResetOptions) -> Scenario:
    """Return the world of one episode.

    Raises
    ------
    ConfigError
        An option that this world's targets cannot follow.
    """
    update: dict[str, Any] = {}
    if options.noise_scale != 1.0:
        sensing = scenario.sensing
        update["sensing"] = sensing.model_copy(
            update={
                "position_noise_m": sensing.position_noise_m * options.noise_scale,
                "orientation_noise_rad": sensing.orientation_noise_rad * options.noise_scale,
            }
        )
    if options.target_speed_scale != 1.0 or options.target_start is not None:
        starts = _starts(options, len(scenario.targets))
        update["targets"] = tuple(
            _started(_faster(target, options.target_speed_scale), start, scenario.roads)
            for target, start in zip(scenario.targets, starts, strict=True)
        )
    return scenario.model_copy(update=update) if update else scenario


def _starts(options: ResetOptions, count: int) -> tuple[float | str | None, ...]:
    start = options.target_start
    if not isinstance(start, tuple):
        return (start,) * count
    if len(start) != count:
        raise ConfigError(
            f"reset option target_start = {start!r}: {len(start)} shares for {count} targets; give one or {count}"
        )
    return start


def _faster(target: TargetSettings, scale: float) -> TargetSettings:
    motion = target.motion
    if scale == 1.0:
        return target
    if isinstance(motion, TrackTarget | FieldTarget):
        raise ConfigError(
            f"reset option target_speed_scale = {scale:g}: target {target.name!r} has a speed of its own; "
            "leave the option out"
        )
    raised = max(scale, 1.0)
    speed = motion.speed_mps
    faster = (scale * speed[0], scale * speed[1]) if isinstance(speed, tuple) else scale * speed
    return target.model_copy(
        update={
            "motion": motion.model_copy(update={"speed_mps": faster}),
            "v_max_mps": raised * target.v_max_mps,
            "w_max_radps": raised * target.w_max_radps,
        }
    )


def _started(target: TargetSettings, start: float | str | None, roads: tuple[Road, ...]) -> TargetSettings:
    """Put a target on its path: at a share of it, or anywhere (drawn at each reset)."""
    if start is None:
        return target
    motion = target.motion
    if isinstance(motion, TrackTarget | FieldTarget):
        raise ConfigError(
            f"reset option target_start = {start!r}: target {target.name!r} has a path of its own; leave the option out"
        )
    if isinstance(motion, RoadTarget):
        names = [road.name for road in roads]
        length_m = RoadNetwork.of(roads).lines[names.index(motion.road)].length_m
        arc_m = None if isinstance(start, str) else start * length_m
        return target.model_copy(update={"motion": motion.model_copy(update={"start_arc_m": arc_m})})
    place: tuple[float, float] | None = None
    if not isinstance(start, str):
        path = build_motion(target, roads)
        if isinstance(path, VectorFieldMotion):
            place = _along(path, start)
    return target.model_copy(update={"start_m": place, "start_heading_rad": None})


def _along(motion: VectorFieldMotion, share: float) -> tuple[float, float]:
    """Point at a share of the way along a closed path."""
    points = np.vstack([motion.start_points, motion.start_points[:1]])
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    at = share * way[-1]
    return float(np.interp(at, way, points[:, 0])), float(np.interp(at, way, points[:, 1]))
