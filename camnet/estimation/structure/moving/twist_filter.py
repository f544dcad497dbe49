"""Causal filter of a rigid target's pose and velocity: an extended Kalman filter of a constant body twist.

| symbol | name | shape | unit | equation |
| --- | --- | --- | --- | --- |
| ``p``, ``q`` | ``p``, ``q`` | (3,), (4,) | m, - | position, body to scene |
| ``v``, ``w`` | ``v_body``, ``w_body`` | (3,), (3,) | m/s, rad/s | velocities in body axes |
| ``dx`` | | (12,) | | errors ``[dp (scene); dr (body); dv; dw]``, ``q_true = q exp(dr)`` |
| | | | | ``p' = R(q) v``, ``q' = q (x) w / 2``, v' and w' white of densities ``accel_psd``, ``angular_psd`` |
| ``F`` | | (12, 12) | | ``dp + dt R (dv - v^x dr)``, ``Exp(-w dt) dr + dt dw`` |
| ``z`` | | (6,) | | measured pose: ``[p_z - p; log(q^-1 q_z)]``, with its own covariance |

In body axes a target that turns steadily has a constant velocity: extrapolated, the filter is the coordinated turn.
``smooth`` is the fixed-interval (Rauch-Tung-Striebel) smoother of one seen stretch, from that stretch alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from camnet.compiled import cached_njit
from camnet.geometry.rotations_compiled import conjugate, exp, log, multiply, normalise, to_matrix
from camnet.settings import Positive, Settings
from camnet.types import Array

__all__ = ["TwistFilter", "TwistFilterSettings", "TwistState", "coast"]

_SIZE = 12


class TwistFilterSettings(Settings):
    """Densities of the unknown accelerations and the spread of the velocities before the first image."""

    accel_psd_m2ps3: Positive = 2e-4
    angular_psd_rad2ps3: Positive = 2e-4
    start_speed_mps: Positive = 0.5
    start_rate_radps: Positive = 0.5


@dataclass(frozen=True, eq=False, slots=True)
class TwistState:
    """Estimate at one time; see the module's table. ``covariance`` (12, 12) is that of dx."""

    t_s: float
    p: Array
    q: Array
    v_body: Array
    w_body: Array
    covariance: Array

    @property
    def v_scene(self) -> Array:
        """Velocity (3,) in scene axes, m/s."""
        return np.asarray(to_matrix(self.q) @ self.v_body)


@cached_njit
def _skew(a: Array) -> Array:
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


@cached_njit
def _coasted(p: Array, q: Array, v: Array, w: Array, dt: float) -> tuple[Array, Array]:
    """Pose after dt at a constant twist; exact for the turn, second order for the way."""
    middle = multiply(q, exp(0.5 * dt * w))
    return p + dt * (to_matrix(middle) @ v), normalise(multiply(q, exp(dt * w)))


@cached_njit
def _predict(
    p: Array, q: Array, v: Array, w: Array, cov: Array, dt: float, accel: float, angular: float
) -> tuple[Array, Array, Array, Array]:
    eye = np.eye(3)
    f = np.eye(_SIZE)
    r = to_matrix(multiply(q, exp(0.5 * dt * w)))
    f[0:3, 3:6] = -dt * (r @ _skew(v))
    f[0:3, 6:9] = dt * r
    f[3:6, 3:6] = to_matrix(exp(-dt * w))
    f[3:6, 9:12] = dt * eye
    noise = np.zeros((_SIZE, _SIZE))
    noise[0:3, 0:3] = (accel * dt**3 / 3.0) * eye
    noise[0:3, 6:9] = (accel * dt**2 / 2.0) * r
    noise[6:9, 0:3] = noise[0:3, 6:9].T
    noise[6:9, 6:9] = (accel * dt) * eye
    noise[3:6, 3:6] = (angular * dt**3 / 3.0) * eye
    noise[3:6, 9:12] = (angular * dt**2 / 2.0) * eye
    noise[9:12, 3:6] = noise[3:6, 9:12].T
    noise[9:12, 9:12] = (angular * dt) * eye
    new_p, new_q = _coasted(p, q, v, w, dt)
    return new_p, new_q, f @ cov @ f.T + noise, f


@cached_njit
def _update(
    p: Array, q: Array, v: Array, w: Array, cov: Array, p_z: Array, q_z: Array, cov_z: Array
) -> tuple[Array, Array, Array, Array, Array, float]:
    e = np.empty(6)
    e[:3] = p_z - p
    e[3:] = log(multiply(conjugate(q), q_z))
    s = np.ascontiguousarray(cov[:6, :6]) + cov_z
    inverse = np.linalg.inv(s)
    gain = np.ascontiguousarray(cov[:, :6]) @ inverse
    dx = gain @ e
    keep = np.eye(_SIZE)
    keep[:, :6] -= gain
    after = keep @ cov @ keep.T + gain @ cov_z @ gain.T
    turned = normalise(multiply(q, exp(dx[3:6])))
    return p + dx[:3], turned, v + dx[6:9], w + dx[9:], 0.5 * (after + after.T), float(e @ inverse @ e)


def coast(state: TwistState, span_s: float, step_s: float = 0.05) -> tuple[Array, Array]:
    """Pose (3,), (4,) after ``span_s`` at the state's constant twist: the coordinated turn."""
    p, q = state.p, state.q
    steps = max(1, int(np.ceil(span_s / step_s)))
    for _ in range(steps):
        p, q = _coasted(p, q, state.v_body, state.w_body, span_s / steps)
    return p, q


class TwistFilter:
    """Feed it measured poses in the order of time; the first one, or one after ``restart``, begins a stretch.

    Attributes
    ----------
    stretch : states of the stretch so far, one a measurement
    """

    def __init__(self, settings: TwistFilterSettings) -> None:
        self._s = settings
        self.stretch: list[TwistState] = []
        self._steps: list[tuple[Array, Array, Array, Array]] = []

    def restart(self) -> None:
        """Forget everything: the next measurement begins a new stretch (after a re-sighting)."""
        self.stretch, self._steps = [], []

    def update(self, t_s: float, p_z: Array, q_z: Array, cov_z: Array) -> TwistState:
        """Take in a pose (3,) m, (4,) body to scene, with covariance (6, 6) of ``[dp (scene); dr (body)]``."""
        if not self.stretch:
            cov = np.zeros((_SIZE, _SIZE))
            cov[:6, :6] = cov_z
            cov[6:9, 6:9] = self._s.start_speed_mps**2 * np.eye(3)
            cov[9:, 9:] = self._s.start_rate_radps**2 * np.eye(3)
            state = TwistState(t_s, p_z.copy(), q_z.copy(), np.zeros(3), np.zeros(3), cov)
        else:
            a = self.stretch[-1]
            p, q, cov, f = _predict(
                a.p,
                a.q,
                a.v_body,
                a.w_body,
                a.covariance,
                t_s - a.t_s,
                self._s.accel_psd_m2ps3,
                self._s.angular_psd_rad2ps3,
            )
            self._steps.append((p, q, cov, f))
            state = TwistState(t_s, *_update(p, q, a.v_body, a.w_body, cov, p_z, q_z, cov_z)[:5])
        self.stretch.append(state)
        return state

    def smooth(self) -> list[TwistState]:
        """Return the stretch so far, each state from all of its measurements."""
        out = list(self.stretch)
        for k in range(len(out) - 2, -1, -1):
            now, nxt = self.stretch[k], out[k + 1]
            p, q, cov, f = self._steps[k]
            gain = np.linalg.solve(cov, f @ now.covariance).T
            away = np.concatenate(
                [
                    nxt.p - p,
                    log(multiply(conjugate(q), nxt.q)),
                    nxt.v_body - now.v_body,
                    nxt.w_body - now.w_body,
                ]
            )
            dx = gain @ away
            after = now.covariance + gain @ (nxt.covariance - cov) @ gain.T
            q_new = normalise(multiply(now.q, exp(dx[3:6])))
            out[k] = TwistState(
                now.t_s, now.p + dx[:3], q_new, now.v_body + dx[6:9], now.w_body + dx[9:], after
            )
        return out
