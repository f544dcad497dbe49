"""Settings of targets: what moves, how, and what of it cameras look for."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from camnet.settings import Finite, NonNegative, Positive, Settings, Vector2, Vector3

__all__ = ["FieldTarget", "RoadTarget", "TargetClass", "TargetSettings", "TrackTarget", "VectorFieldTarget"]


class VectorFieldTarget(Settings):
    """A differential-drive robot that steers along a smooth planar vector field (parikh2018, experiment 1).

    ``field: loop`` circulates along the closed road named by ``road``; ``field: wave`` is a fixed analytic field
    around ``center_m`` that keeps within ``scale_m`` of it. ``speed_mps`` is the mean speed; it varies by the fraction
    ``speed_modulation``, smoothly with the place. ``motor_lag_s`` > 0 gives the robot a memory, so that its velocity
    is no longer a function of its pose.
    """

    kind: Literal["vector_field"]
    field: Literal["loop", "wave"] = "loop"
    road: str | None = None
    center_m: Vector2 = (0.0, 0.0)
    scale_m: Positive = 2.0
    speed_mps: Positive = 0.35
    attraction_per_s: Positive = 0.5
    heading_gain_per_s: Positive = 2.0
    speed_modulation: Annotated[float, Field(ge=0, lt=1)] = 0.1
    wheel_base_m: Positive = 0.23
    wheel_speed_max_mps: Positive | None = None
    motor_lag_s: NonNegative = 0.0


class RoadTarget(Settings):
    """A vehicle bound to the road graph; at junctions it turns at random."""

    kind: Literal["road"]
    road: str
    speed_mps: tuple[Finite, Finite] = (0.3, 0.4)
    start_arc_m: NonNegative | None = None
    lateral_std_m: NonNegative = 0.0


class TrackTarget(Settings):
    """A recorded track, replayed: a CSV/GPX/FCD/ETH file and the identity to follow in it.

    ``origin`` is the latitude and longitude (degrees) and altitude (m above WGS84) of the local frame, for files
    with latitudes. ``start_s`` is how far into the track the simulation begins. ``frame_dt_s`` is the time of one
    frame number in ETH/UCY files. Below ``min_speed_mps`` the heading is held, since noise would turn it.
    """

    kind: Literal["track"]
    file: Path
    format: Literal["csv", "gpx", "fcd", "eth"] = "csv"
    id: str | None = None
    height_m: Finite = 0.0
    origin: Vector3 | None = None
    start_s: NonNegative = 0.0
    frame_dt_s: Positive = 0.04
    min_speed_mps: NonNegative = 0.05


class FieldTarget(Settings):
    """A target that follows any law of motion, on the ground or in space; exactly one of four is given.

    ``velocity_mps``: formulas of x, y (z) and t, in metres and seconds, one for each component; two are a target on the
    ground, three one in space. ``acceleration_mps2``: formulas of the same and of vx, vy (vz), with
    ``start_velocity_mps``: a projectile, for instance. ``grid``: a CSV with x, y[, z], vx, vy[, vz]. ``entry``:
    ``module:attribute``, a function from places (n, dimensions) and a time to velocities; with ``start_velocity_mps``
    from places, velocities and a time to accelerations (``of_time: false`` says that the time does not matter).
    ``parameters`` are numbers that formulas name.

    It begins at the target's ``start_m``, ``start_height_m`` high; on the ground again (or where the law moves it no
    more) it stands. ``lipschitz_per_s`` bounds the slope of the velocity over the place: the class that ``learned``
    certificates of it speak of.
    """

    kind: Literal["field"]
    velocity_mps: Annotated[tuple[str | float, ...], Field(min_length=2, max_length=3)] | None = None
    acceleration_mps2: Annotated[tuple[str | float, ...], Field(min_length=2, max_length=3)] | None = None
    grid: Path | None = None
    entry: str | None = None
    dimensions: Literal[2, 3] = 2
    of_time: bool | None = None
    parameters: dict[str, Finite] = Field(default_factory=dict)
    start_height_m: NonNegative = 0.0
    start_velocity_mps: Vector3 | Vector2 | None = None
    lipschitz_per_s: NonNegative | None = None


TargetClass = Annotated[
    VectorFieldTarget | RoadTarget | TrackTarget | FieldTarget, Field(discriminator="kind")
]


class TargetSettings(Settings):
    """One target.

    ``features_m`` are the points, in the target's body frame (x forward, z up), that must all be in view.
    ``size_m`` is its collision box. ``v_max_mps`` and ``w_max_radps`` bound its motion. Where ``assumed_size`` is given
    the agents do not know how large the target is: they take it for so many times as large as it is, and learn its size
    from their own motion.
    """

    name: str
    motion: TargetClass
    start_m: Vector2 | None = None
    start_heading_rad: Finite | None = None
    size_m: Vector3 = (0.35, 0.35, 0.3)
    features_m: Annotated[tuple[Vector3, ...], Field(max_length=1000)] = (
        (0.12, 0.12, 0.3),
        (0.12, -0.12, 0.3),
        (-0.12, -0.12, 0.3),
        (-0.12, 0.12, 0.3),
    )
    assumed_size: Annotated[float, Field(ge=0.2, le=5.0, allow_inf_nan=False)] | None = None
    v_max_mps: Positive = 0.6
    w_max_radps: Positive = 1.5
