"""Observer and predictor of the camera's pose, with resets at landmarks (bell2019, section 4.4), compiled.

| symbol | name | shape | unit | equation |
| --- | --- | --- | --- | --- |
| ``p``, ``q`` | ``p_world``, ``q_world`` | (K, 3), (K, 4) | m, - | camera to world |
| ``v_c``, ``w_c`` | ``v_cam``, ``w_cam`` | (K, 3) | m/s, rad/s | measured, camera frame |
| ``p_k``, ``q_k`` | | | | the estimate when the key frame was taken |
| ``p_{c/k}``, ``q_{c/k}`` | ``p_ck``, ``q_ck`` | (K, 3), (K, 4) | m, - | camera in the key frame |

Landmark in view: the pose is set to the landmark's. A usable key frame:
``p' = R(q) v_c + K_p (p_k + R(q_k) p_{c/k} - p)``, ``q' = 1/2 B(q) w_c + K_q (q_k q_{c/k} - q)``. Else the predictor,
the same without the feedback. Between images the mean of their velocities holds.

Two departures. The quaternion that is fed back gets the sign of q first: q and -q are one rotation. And a key frame
that was taken before a landmark came into view is not used after it: the pose was reset meanwhile, and ``p_k`` was not.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from camnet.compiled import cached_njit
from camnet.geometry.rotations_compiled import align_sign, exp, multiply, normalise, rotate
from camnet.types import Array, BoolArray, IntArray

__all__ = ["KeyFrameFeedback", "Landmarks", "observe_pose", "predict_pose"]


class Landmarks(NamedTuple):
    """Landmark poses: ``seen`` (K,), and where it is, the camera's pose by it (K, 3), (K, 4)."""

    seen: BoolArray
    p_world: Array
    q_world: Array


class KeyFrameFeedback(NamedTuple):
    """Key frames at K images.

    ``number`` (K,) of the key frame tracked, rising; ``usable`` (K,); ``p_ck`` (K, 3) m and ``q_ck`` (K, 4), the camera
    in the key frame.
    """

    number: IntArray
    usable: BoolArray
    p_ck: Array
    q_ck: Array


def predict_pose(t_s: Array, v_cam: Array, w_cam: Array, landmarks: Landmarks) -> tuple[Array, Array]:
    """Dead reckoning with resets: poses (K, 3), (K, 4); the first image must see the landmark."""
    count = len(t_s)
    none = KeyFrameFeedback(
        np.zeros(count, dtype=np.int64),
        np.zeros(count, dtype=bool),
        np.zeros((count, 3)),
        np.zeros((count, 4)),
    )
    return observe_pose(t_s, v_cam, w_cam, landmarks, none, 0.0, 0.0)


@cached_njit
def observe_pose(
    t_s: Array, v_cam: Array, w_cam: Array, landmarks: Landmarks, key: KeyFrameFeedback, k_p: float, k_q: float
) -> tuple[Array, Array]:  # fmt: skip
    """Poses (K, 3), (K, 4) with gains ``k_p``, ``k_q`` in 1/s; the first image must see the landmark."""
    count = len(t_s)
    p_world, q_world = np.empty((count, 3)), np.empty((count, 4))
    p, q = landmarks.p_world[0].copy(), landmarks.q_world[0].copy()
    p_k, q_k = p.copy(), q.copy()
    valid = True
    for t in range(count):
        if t > 0:
            dt = t_s[t] - t_s[t - 1]
            w = 0.5 * dt * (w_cam[t - 1] + w_cam[t])
            middle = multiply(q, exp(0.5 * w))
            p = p + rotate(middle, 0.5 * dt * (v_cam[t - 1] + v_cam[t]))
            q = normalise(multiply(middle, exp(0.5 * w)))
        if landmarks.seen[t]:
            p, q, valid = landmarks.p_world[t].copy(), landmarks.q_world[t].copy(), False
        if t == 0 or key.number[t] != key.number[t - 1]:
            p_k, q_k, valid = p.copy(), q.copy(), True
        elif key.usable[t] and valid:
            share_p, share_q = 1.0 - math.exp(-k_p * dt), 1.0 - math.exp(-k_q * dt)
            p = p + share_p * (p_k + rotate(q_k, key.p_ck[t]) - p)
            target = align_sign(multiply(q_k, key.q_ck[t]), q)
            q = normalise(q + share_q * (target - q))
        p_world[t], q_world[t] = p, q
    return p_world, q_world
