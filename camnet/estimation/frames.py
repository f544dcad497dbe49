"""Kinematics of a target's pose relative to a moving camera: the known part f of the estimator's model.

| symbol | name | shape | unit, frame |
| --- | --- | --- | --- |
| x = p_{m/c} | ``p_cam`` or ``p_rel_world`` | (3,) | m, camera frame or world axes |
| q = q_{m/c} | ``q_rel``: target body to camera frame | (4,) | - |
| v_c | ``v_camera`` | (3,) | m/s, frame as named |
| w_c | ``w_cam`` | (3,) | rad/s, camera frame |

Position held in the camera frame (parikh2018 (1), (2), (6)), with v_c and w_c in that frame too:

    x' = R_c^T v_m - v_c - w_c^x x,      q' = 1/2 B(q) (w_m - R(q)^T w_c),      w_m in the target's body frame,
    f = -[ v_c + w_c^x x ; 1/2 B(q) R(q)^T w_c ].

Position held in world axes (harris2020 (4-8)): ``p = p_m - p_c`` is a difference of two world vectors, so
p' = v_m - v_c and

    f = -[ v_c ; 1/2 B(q) R(q)^T w_c ].

harris2020 (2-5) has a further ``- w_c^x p``, which belongs to a position held in the camera frame: with it the model is
wrong by as much as the camera turns. (2-6) is right if both angular velocities are expressed in the camera frame.
In the relative form with world axes, ``Deta - F`` of a window is exactly the target's own world displacement, whatever
the camera did: both forms share one history stack.
"""

from __future__ import annotations

import numpy as np

from camnet.geometry.rotations_compiled import kinematic_matrix, rotate_inverse
from camnet.types import Array

__all__ = ["known_part_camera_axes", "known_part_world_axes", "printed_known_part_world_axes"]


def _turn_of_camera(q_rel: Array, w_cam: Array) -> Array:
    """Rate (4,) of the relative orientation that the camera's turning alone causes."""
    return np.asarray(-0.5 * kinematic_matrix(q_rel) @ rotate_inverse(q_rel, w_cam))


def known_part_camera_axes(p_cam: Array, q_rel: Array, v_camera_cam: Array, w_cam: Array) -> Array:
    """Return f (7,) for a position held in the camera frame (parikh2018 (6))."""
    return np.concatenate((-(v_camera_cam + np.cross(w_cam, p_cam)), _turn_of_camera(q_rel, w_cam)))


def known_part_world_axes(q_rel: Array, v_camera_world: Array, w_cam: Array) -> Array:
    """Return f (7,) for a position held in world axes, derived from (2-4); see the module's head."""
    return np.concatenate((-v_camera_world, _turn_of_camera(q_rel, w_cam)))


def printed_known_part_world_axes(
    p_rel_world: Array, q_rel: Array, v_camera_world: Array, w_camera_world: Array, w_cam: Array
) -> Array:
    """Return f (7,) as printed in harris2020 (2-5), (4-9); kept to show what is wrong with it."""
    linear = -(v_camera_world + np.cross(w_camera_world, p_rel_world))
    return np.concatenate((linear, _turn_of_camera(q_rel, w_cam)))
