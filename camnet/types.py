"""Plain data that crosses package borders. All arrays are float64; quaternions are scalar first.

| type | what |
| --- | --- |
| `Pose`, `Twist` | position and orientation; linear and angular velocity |
| `CameraMotion` | where a camera is and how it moves, as known to its agent |
| `PoseMeasurement` | what one camera reports of one target at one instant |
| `TargetEstimate` | what an estimator believes of one target |
| `Snapshot` | the truth at one instant: only the world, the sensors and the log may read it |
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "Array",
    "BoolArray",
    "CameraMotion",
    "IntArray",
    "Pose",
    "PoseMeasurement",
    "Snapshot",
    "TargetEstimate",
    "Twist",
]

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]


@dataclass(frozen=True, eq=False, slots=True)
class Pose:
    """Position ``p`` (3,) in m and orientation ``q`` (4,), body to reference frame."""

    p: Array
    q: Array


@dataclass(frozen=True, eq=False, slots=True)
class Twist:
    """Linear velocity ``v`` (3,) in m/s and angular velocity ``w`` (3,) in rad/s; frames as the user states."""

    v: Array
    w: Array


@dataclass(frozen=True, eq=False, slots=True)
class CameraMotion:
    """Pose and velocity of one camera.

    Attributes
    ----------
    p_world : (3,) position of the optical centre, m
    q_world : (4,) camera frame (x right, y down, z forward) to world
    v_world : (3,) linear velocity in the world frame, m/s
    w_cam : (3,) angular velocity in the camera frame, rad/s
    cov : (3,3) covariance of x and y, m, and heading, rad, where the agent estimates its own pose; None: it knows it
    """

    p_world: Array
    q_world: Array
    v_world: Array
    w_cam: Array
    cov: Array | None = None


@dataclass(frozen=True, eq=False, slots=True)
class PoseMeasurement:
    """Pose of one target relative to one camera, as measured.

    Attributes
    ----------
    t_s : time at which the image was taken, s
    camera : index of the camera
    target : index of the target
    p_cam : (3,) target position in the camera frame, m
    q_cam : (4,) target body frame to camera frame; either sign
    motion : the camera's own pose and velocity at ``t_s``
    """

    t_s: float
    camera: int
    target: int
    p_cam: Array
    q_cam: Array
    motion: CameraMotion


@dataclass(frozen=True, eq=False, slots=True)
class TargetEstimate:
    """What an estimator believes of one target at one instant, in the world frame.

    Attributes
    ----------
    t_s : time of the estimate, s
    p_world, q_world : (3,), (4,) pose
    v_world, w_body : (3,), (3,) velocity in the world frame, angular velocity in the target's body frame
    seen : whether a measurement is in force
    last_seen_s : time of the last measurement, s (-inf before the first)
    region : index of the region whose model predicts (-1 before the first sighting)
    radius_m : empirical error radius, m (inf when unknown)
    """

    t_s: float
    p_world: Array
    q_world: Array
    v_world: Array
    w_body: Array
    seen: bool
    last_seen_s: float
    region: int
    radius_m: float


@dataclass(frozen=True, eq=False, slots=True)
class Snapshot:
    """The true state of a world with N agents, C cameras and M targets.

    Cameras are ordered: the N agents' cameras first, then the fixed ones.

    Attributes
    ----------
    t_s : time, s
    step : physics step number
    agent_p_world, agent_q_world : (N,3), (N,4) quadrotor pose, body to world
    agent_v_world, agent_w_body : (N,3), (N,3) quadrotor velocity
    camera_p_world, camera_q_world : (C,3), (C,4) camera frame to world
    camera_v_world, camera_w_cam : (C,3), (C,3) camera velocity
    target_p_world, target_q_world : (M,3), (M,4) target body to world
    target_v_world, target_w_body : (M,3), (M,3) target velocity
    collisions : pairs of body names in contact during the last control period (ground contact of targets excepted)
    """

    t_s: float
    step: int
    agent_p_world: Array
    agent_q_world: Array
    agent_v_world: Array
    agent_w_body: Array
    camera_p_world: Array
    camera_q_world: Array
    camera_v_world: Array
    camera_w_cam: Array
    target_p_world: Array
    target_q_world: Array
    target_v_world: Array
    target_w_body: Array
    collisions: tuple[tuple[str, str], ...] = ()
