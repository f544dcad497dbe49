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
    """Rigid body, rotors and inner loop of one quadrotor (about 1 kg class by default)."""

    mass_kg: Positive = 1.0
    inertia_kgm2: Vector3 = (0.01, 0.01, 0.018)
    arm_m: Positive = 0.2
    thrust_n_per_rad2ps2: Positive = 6.0e-6
    torque_nm_per_rad2ps2: Positive = 1.0e-7
    rotor_max_radps: Positive = 900.0
    motor_lag_s: NonNegative = 0.03
    drag_n_per_mps: Vector3 = (0.15, 0.15, 0.2)
    v_max_mps: Positive = 2.5
    a_max_mps2: Positive = 5.0


class GimbalSettings(Settings):
    """Three-axis gimbal that carries the camera."""

    rate_max_radps: Positive = 3.0
    lag_s: NonNegative = 0.02


class PhysicsSettings(Settings):
    """Engine, rates and environment.

    ``actuation: quadrotor`` flies the rigid body with its inner loop; ``kinematic`` is the thesis' model
    (4-1), (4-2): the camera moves as commanded plus a bounded disturbance of norm ``disturbance``.
    """

    backend: Literal["pybullet"] = "pybullet"
    step_hz: Annotated[int, Field(gt=0)] = 240
    gravity_mps2: NonNegative = 9.81
    actuation: Literal["quadrotor", "kinematic"] = "quadrotor"
    disturbance: NonNegative = 0.02
    wind: WindSettings = WindSettings()
    quadrotor: QuadrotorSettings = QuadrotorSettings()
    gimbal: GimbalSettings = GimbalSettings()
