"""Observer and predictor of a moving target (bell2019, section 5.4), corrected.

| symbol | name | shape | unit | equation |
| --- | --- | --- | --- | --- |
| ``eta = [p_{m/c}; q_{m/c}]`` | ``p``, ``q`` | (3,), (4,) | m, - | pose of the target in the camera frame |
| ``nu = [v_m; w_m]`` | ``nu`` | (6,) | m/s, rad/s | its velocities, scene axes |
| ``K_eta``, ``K_nu`` | ``k_eta``, ``k_nu`` | | 1/s | multiples of the identity |

Seen:    ``p' = v_m - v_c - w_c^x p + K_eta p~``, ``q' = 1/2 (w_m - w_c) (x) q + K_eta q~`` with the measured nu,
         ``nu' = W^T sigma + K_nu nu~``, ``W'`` as in `acceleration`.
Unseen:  the same with nu_hat for nu and without feedback; W follows the stack.

Departures from print. ``Phi(q) nu`` with ``-w_c^x p`` and ``-1/2 w_c (x) q`` counts each velocity once. nu is kept in
scene axes (see `acceleration`) and turned into the camera's for the rates of the pose. The feedback is taken as an
exponential step, the turns exactly. The bound of the poses and velocities (proj) is on the speed and the turn rate.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from camnet.estimation.structure.moving.acceleration import AccelerationModel
from camnet.geometry.rotations_compiled import conjugate, exp, log, multiply, normalise, rotate
from camnet.settings import Positive, Settings
from camnet.types import Array

__all__ = ["CameraState", "MotionObserver", "ObserverGains"]


class ObserverGains(Settings):
    """Gains, and the bounds of speed and turn rate that estimates are projected onto."""

    k_eta: Positive = 5.0
    k_nu: Positive = 5.0
    speed_max_mps: Positive = 1.0
    rate_max_radps: Positive = 1.0


@dataclass(frozen=True, eq=False, slots=True)
class CameraState:
    """Known of the camera: pose in the scene (3,) m, (4,) camera to scene; velocities (3,), (3,) in its own axes."""

    p_scene: Array
    q_scene: Array
    v_cam: Array
    w_cam: Array


class MotionObserver:
    """Step it with a measurement while the target is seen, without one else.

    Parameters
    ----------
    gains : see there
    model : the acceleration model; its stack is filled by the caller
    p, q, nu : pose (3,), (4,) in the camera frame and velocities (6,) in scene axes to begin with
    """

    def __init__(self, gains: ObserverGains, model: AccelerationModel, p: Array, q: Array, nu: Array) -> None:
        self._g, self.model = gains, model
        self.p, self.q, self.nu = p, q, nu

    def p_scene(self, camera: CameraState) -> Array:
        """Estimated position (3,) in the scene, m."""
        return np.asarray(camera.p_scene + rotate(camera.q_scene, self.p))

    def observe(self, dt_s: float, camera: CameraState, p_z: Array, q_z: Array, nu_z: Array) -> None:
        """Advance by ``dt_s`` with measured pose (camera frame) and velocities (scene axes), held over the step."""
        place = np.asarray(camera.p_scene + rotate(camera.q_scene, p_z))
        sigma, error = self.model.sigma(place, nu_z), nu_z - self.nu
        self._move(dt_s, camera, nu_z)
        back = 1.0 - np.exp(-self._g.k_eta * dt_s)
        self.p = self.p + back * (p_z - self.p)
        self.q = normalise(multiply(self.q, exp(back * log(multiply(conjugate(self.q), q_z)))))
        gain = 1.0 - np.exp(-self._g.k_nu * dt_s)
        self.nu = self._bounded(self.nu + dt_s * sigma @ self.model.weights + gain * error)
        self.model.step(dt_s, sigma, error)

    def predict(self, dt_s: float, camera: CameraState) -> None:
        """Advance by ``dt_s`` unseen."""
        rate = self.model.rate(self.p_scene(camera), self.nu)
        self._move(dt_s, camera, self.nu + 0.5 * dt_s * rate)
        self.nu = self._bounded(self.nu + dt_s * rate)
        self.model.step(dt_s)

    def _move(self, dt_s: float, camera: CameraState, nu: Array) -> None:
        """``p' = v_m - v_c - w_c^x p``, ``q' = 1/2 (w_m - w_c) (x) q`` over one step at constant velocities."""
        into = conjugate(camera.q_scene)
        v, w = rotate(into, nu[:3]), rotate(into, nu[3:])
        half = exp(-0.5 * dt_s * camera.w_cam)
        self.p = rotate(half, rotate(half, self.p) + dt_s * (v - camera.v_cam))
        self.q = normalise(multiply(exp(dt_s * (w - camera.w_cam)), self.q))

    def _bounded(self, nu: Array) -> Array:
        out = nu.copy()
        for part, most in ((slice(0, 3), self._g.speed_max_mps), (slice(3, 6), self._g.rate_max_radps)):
            size = float(np.linalg.norm(nu[part]))
            if size > most:
                out[part] *= most / size
        return out
