"""Settings of the simulated world: physics, quadrotors, gimbals, wind."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from camnet.settings import NonNegative, Positive, Settings, Vector3

__all__ = ["GimbalSettings", "PhysicsSettings", "QuadrotorSettings", "WindSettings"]


class WindSettings(Settings):
    """Mean wind and first-order (Dryden-like) gusts, world frame."""

    mean_mps: Vector3 = (0.0, 0.0, 0.0)
    gust_std_mps: NonNegative = 0.0
    gust_time_s: Positive = 2.0


class QuadrotorSettings(Settings):
    """Rigid body, rotors and inner loop of one quadrotor (about 1 kg class by default).

    The inner loop turns a velocity command into rotor speeds: ``velocity_gain_per_s`` and
    ``velocity_integral_per_s2`` make an acceleration, ``attitude_hz`` and ``attitude_damping`` place the poles of
    the attitude loop; ``rotor_response_s`` is how fast it asks the rotors to answer, overdriving motors of a longer
    lag. ``height_m`` is the body's height for collisions.
    """

    mass_kg: Positive = 1.0
    inertia_kgm2: Vector3 = (0.01, 0.01, 0.018)
    arm_m: Positive = 0.2
    height_m: Positive = 0.1
    thrust_n_per_rad2ps2: Positive = 6.0e-6
    torque_nm_per_rad2ps2: Positive = 1.0e-7
    rotor_max_radps: Positive = 900.0
    motor_lag_s: NonNegative = 0.03
    rotor_response_s: NonNegative = 0.01
    drag_n_per_mps: Vector3 = (0.15, 0.15, 0.2)
    v_max_mps: Positive = 2.5
    a_max_mps2: Positive = 5.0
    velocity_gain_per_s: Positive = 5.0
    velocity_integral_per_s2: NonNegative = 3.0
    attitude_hz: Positive = 3.5
    attitude_damping: Positive = 0.9


class GimbalSettings(Settings):
    """Three-axis gimbal that carries the camera: yaw, pan and tilt joints, from the body outwards.

    All angles zero looks straight down, the image's x axis along the body's x axis. ``pan_max_rad`` keeps the pan
    joint away from its singularity at a right angle. ``offset_m`` is the optical centre in the body frame.
    """

    rate_max_radps: Positive = 3.0
    lag_s: NonNegative = 0.005
    pan_max_rad: Annotated[float, Field(gt=0, lt=1.5)] = 1.4
    offset_m: Vector3 = (0.0, 0.0, -0.05)


class PhysicsSettings(Settings):
    """Engine, rates and environment.

    ``actuation: quadrotor`` flies the rigid body with its inner loop; ``kinematic`` is the thesis' model
    (4-1), (4-2): the camera moves as commanded plus a bounded disturbance of norm ``disturbance`` (m/s for the
    linear part, rad/s for the angular part). ``speed_limit_mps`` and ``range_limit_m`` (distance from the start)
    are where a body counts as diverged. The quadrotors' inner loop runs at ``flight_hz``, which divides ``step_hz``
    and is a multiple of the control rate (None: the lowest such rate that is at least 60 Hz); rotors and gimbals
    follow at ``step_hz``.
    """

    backend: Literal["pybullet"] = "pybullet"
    step_hz: Annotated[int, Field(gt=0, le=100_000)] = 240
    flight_hz: Annotated[int, Field(gt=0, le=100_000)] | None = None
    gravity_mps2: NonNegative = 9.81
    actuation: Literal["quadrotor", "kinematic"] = "quadrotor"
    disturbance: NonNegative = 0.02
    speed_limit_mps: Positive = 50.0
    range_limit_m: Positive = 5000.0
    wind: WindSettings = WindSettings()
    quadrotor: QuadrotorSettings = QuadrotorSettings()
    gimbal: GimbalSettings = GimbalSettings()
