"""Stretches out of view, simulated: what errors of measured velocities and of a motion model do to predictions.

Many at once, with errors within stated bounds, either drawn (``learned`` dwell times) or chosen at every step to make
the prediction worse (``hostile``, which holds the sound dwell times to account). Nothing here uses a bound of theirs.

| ``hostile`` | what it does |
| --- | --- |
| velocity error | along what is off already |
| rate error | about the axis that moves the predicted point along what is off |
| target | the law's slope and damping pull truth and prediction apart, the model's error is along what is off |
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from camnet.certification.structure_dwell import TargetErrors
from camnet.geometry.rotations import IDENTITY, conjugate, exp, multiply, normalise, rotate
from camnet.types import Array

__all__ = ["PointStretches", "point_stretches", "target_stretches"]

_STEP_S, _TURN_RADPS = 0.05, 0.5


@dataclass(frozen=True, eq=False, slots=True)
class PointStretches:
    """Errors of N features with their key frames, at K times.

    Attributes
    ----------
    t_s : (K,) s out of view
    error_m : (N, K) norm of the error of ``[d_ic; d_kc; d_ik]``
    """

    t_s: Array
    error_m: Array

    def growths_mps(self) -> Array:
        """Growth of the error over the whole stretch (N,), m/s."""
        return np.asarray((self.error_m[:, -1] - self.error_m[:, 0]) / self.t_s[-1])


def _unit(x: Array) -> Array:
    return np.asarray(x / np.maximum(np.linalg.norm(x, axis=-1, keepdims=True), 1e-12))


def _in_ball(rng: np.random.Generator, count: int, radius: float) -> Array:
    """Vectors (count, 3) drawn evenly from a ball."""
    return np.asarray(radius * rng.random((count, 1)) ** (1.0 / 3.0) * _unit(rng.standard_normal((count, 3))))


class _Camera:
    """True and measured motion of N cameras: the true one changes at random every second."""

    def __init__(
        self, rng: np.random.Generator, count: int, errors: tuple[float, float], speed: float
    ) -> None:
        self._rng, self._count, self._errors, self._speed = rng, count, errors, speed
        self._drawn = _in_ball(rng, count, errors[0]), _in_ball(rng, count, errors[1])
        self.v, self.w = np.zeros((count, 3)), np.zeros((count, 3))

    def change(self) -> None:
        """Fly another way."""
        self.v = _in_ball(self._rng, self._count, self._speed)
        self.w = _in_ball(self._rng, self._count, _TURN_RADPS)

    def measured(self, off: Array | None, point: Array) -> tuple[Array, Array]:
        """Velocities as measured; ``off`` (N, 3): truth less prediction of ``point``, if the errors are hostile."""
        if off is None:
            return self.v + self._drawn[0], self.w + self._drawn[1]
        return self.v + self._errors[0] * _unit(off), self.w + self._errors[1] * _unit(np.cross(point, off))


def point_stretches(
    rng: np.random.Generator,
    count: int,
    span_s: float,
    errors: tuple[float, float],
    distance_m: float,
    error_m: float,
    speed_mps: float,
    hostile: bool = False,
) -> PointStretches:
    """Predict ``count`` features and their key frames over ``span_s``.

    Parameters
    ----------
    rng : draws places, motion and errors
    count, span_s : stretches, and how long each is
    errors : bounds of the errors of velocity, m/s, and rate, rad/s
    distance_m : features begin nearer than half of this, and their predictions are held within it
    error_m : bound of the error of the state at the beginning
    speed_mps : highest speed of the camera; it turns back where it would take a feature too far
    hostile : errors are chosen, not drawn
    """
    camera = _Camera(rng, count, errors, speed_mps)
    truth = _in_ball(rng, 2 * count, 0.5 * distance_m).reshape(2, count, 3)
    off = _in_ball(rng, count, error_m)
    guess = truth * (1.0 - off.T[:2, :, None] / np.maximum(np.linalg.norm(truth, axis=2), 1e-9)[..., None])
    at_key = off[:, 2]
    rows, times = [], np.arange(0.0, span_s + 0.5 * _STEP_S, _STEP_S)
    for k in range(len(times)):
        e = np.linalg.norm(truth, axis=2) - np.linalg.norm(guess, axis=2)
        rows.append(np.sqrt(np.sum(e * e, axis=0) + at_key**2))
        if k % round(1.0 / _STEP_S) == 0:
            camera.change()
        away = np.linalg.norm(guess, axis=2).max(axis=0) > 0.8 * distance_m
        camera.v = np.where(away[:, None], speed_mps * _unit(guess.mean(axis=0)), camera.v)
        v, w = camera.measured(truth[0] - guess[0] if hostile else None, guess[0])
        for j in range(2):
            truth[j] = _seen_after(truth[j], camera.v, camera.w)
            guess[j] = _seen_after(guess[j], v, w)
    return PointStretches(times, np.array(rows).T)


def _seen_after(p: Array, v: Array, w: Array) -> Array:
    """Stationary points (N, 3) in the camera frame a step later, exactly to the second order."""
    middle = p - 0.5 * _STEP_S * v
    return rotate(exp(-_STEP_S * w), middle) - 0.5 * _STEP_S * v


def target_stretches(
    rng: np.random.Generator,
    count: int,
    errors: TargetErrors,
    margin_m: float,
    longest_s: float,
    camera_speed_mps: float,
    hostile: bool = False,
) -> Array:
    """For how long ``count`` targets stay within ``margin_m`` of where the camera predicts them (count,), s.

    A stretch ends too, counted as kept for ``longest_s``, when the target is beyond ``errors.range_m``.

    Parameters
    ----------
    rng : draws places, motion and errors
    count : of the stretches
    errors : bounds of what is off
    margin_m : allowed error of the position in the camera frame
    longest_s : no stretch is longer
    camera_speed_mps : of the camera
    hostile : errors are chosen, not drawn
    """
    b = errors
    camera = _Camera(rng, count, (b.speed_error_mps, b.rate_error_radps), camera_speed_mps)
    share = np.ones((count, 1)) if hostile else rng.random((count, 1))
    sign = 1.0 if hostile else rng.choice([-1.0, 1.0], (count, 1))
    z, v = _in_ball(rng, count, 0.6 * b.range_m), _in_ball(rng, count, b.speed_bound_mps)
    along = _unit(rng.standard_normal((count, 3)))
    z_hat = z - (b.position_m * along if hostile else _in_ball(rng, count, b.position_m))
    v_hat = v - (b.velocity_mps * along if hostile else _in_ball(rng, count, b.velocity_mps))
    drive = _in_ball(rng, count, b.drive)
    q, q_hat = (np.tile(IDENTITY, (count, 1)) for _ in range(2))
    c, c_hat = np.zeros((count, 3)), np.zeros((count, 3))
    kept, open_ = np.full(count, longest_s), np.ones(count, dtype=bool)
    home, slope = z.copy(), b.slope
    for k in range(round(longest_s / _STEP_S)):
        p, p_hat = rotate(conjugate(q), z - c), rotate(conjugate(q_hat), z_hat - c_hat)
        off = p - p_hat
        lost = open_ & (np.linalg.norm(off, axis=1) > margin_m)
        kept[lost] = k * _STEP_S
        open_ &= ~lost & (np.linalg.norm(p, axis=1) <= b.range_m)
        if not open_.any():
            break
        if k % round(1.0 / _STEP_S) == 0:
            camera.change()
        worse = b.drive * _unit(z - z_hat) if hostile else drive
        if slope is None:
            f, f_hat = (share * sign * b.damping * (x - home) for x in (z, z_hat))
            v, v_hat = _held(f + worse, b), _held(f_hat, b)
        else:
            a, a_hat = (
                share * sign * (slope * (x - home) + b.damping * u) for x, u in ((z, v), (z_hat, v_hat))
            )
            v, v_hat = _held(v + _STEP_S * (a + worse), b), _held(v_hat + _STEP_S * a_hat, b)
        z, z_hat = z + _STEP_S * v, z_hat + _STEP_S * v_hat
        measured = camera.measured(off if hostile else None, p)
        c, q = _flown(c, q, camera.v, camera.w)
        c_hat, q_hat = _flown(c_hat, q_hat, *measured)
    return kept


def _held(v: Array, b: TargetErrors) -> Array:
    """Velocities no faster than the bound."""
    speed = np.linalg.norm(v, axis=1, keepdims=True)
    return np.asarray(v * np.minimum(1.0, b.speed_bound_mps / np.maximum(speed, 1e-12)))


def _flown(c: Array, q: Array, v: Array, w: Array) -> tuple[Array, Array]:
    """Camera's place and turn a step later, by velocities in its own axes."""
    middle = multiply(q, exp(0.5 * _STEP_S * w))
    return c + _STEP_S * rotate(middle, v), normalise(multiply(q, exp(_STEP_S * w)))
