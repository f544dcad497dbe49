"""A target that follows any law of motion (`camnet.motion.field_law`): its path is integrated once, and replayed.

    p' = f(p, t)                or        p'' = a(p, p', t)

Dormand and Prince's method of order 8 (scipy's DOP853) gives places and velocities every ``_KNOT_S``; between two of
them the path is the cubic with both ends' places and velocities. So each back end, and the certificate, has the very
same path. It ends where the target is on the ground again, or stands still.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

from camnet.errors import ConfigError, WorldError
from camnet.motion.field_law import FieldLaw
from camnet.motion.replay import ReplayMotion, TrackPath
from camnet.motion.settings import FieldTarget, TargetSettings
from camnet.types import Array, Twist

__all__ = ["FieldMotion", "build_field"]

#: between two knots of the path, s, and most of them
_KNOT_S, _MOST_KNOTS = 0.05, 400_000
#: tolerances of the integration: relative, and absolute in m and m/s
_RELATIVE, _ABSOLUTE = 1e-9, 1e-9
#: calls of a law in a second of motion that are too many: it jumps, or is stiff
_MOST_CALLS_PER_S = 20_000
#: below this speed, m/s, the heading is held
_STILL_MPS = 1e-3
#: a step for the slopes of a law, m
_SLOPE_STEP_M = 1e-4
#: what a speed between two knots may exceed those at the knots by
_BETWEEN = 1.0 + 1e-4


@dataclass(frozen=True, eq=False, slots=True)
class FieldMotion(ReplayMotion):
    """The target; its path as a record, and the law that made it.

    Attributes
    ----------
    law : the law of motion
    rests_s : from when on it stands; infinity if it did not as long as it was followed
    lipschitz_per_s : bound of the slope of the velocity over the place, where it is stated
    """

    law: FieldLaw | None = None
    rests_s: float = math.inf
    lipschitz_per_s: float | None = None

    def velocity(self, p_world: Array, q_world: Array, t_s: float) -> Twist | None:
        """Return the law's velocity at a place, and how fast its direction turns; None if the place does not decide.

        The heading is along the velocity, so that the pose's orientation has no say.
        """
        law = self.law
        if law is None or not law.by_place or t_s >= self.rests_s:
            return None
        d = law.dimensions
        p = np.asarray(p_world, dtype=float)[None, :d]
        v = law.velocity(p)[0]
        ahead = law.velocity(p + 1e-5 * v)[0]
        speed2 = float(v[0] ** 2 + v[1] ** 2)
        turn = float(v[0] * ahead[1] - v[1] * ahead[0]) / 1e-5 / speed2 if speed2 > _STILL_MPS**2 else 0.0
        if not np.isfinite(v).all() or not math.isfinite(turn):
            return None
        return Twist(np.array([*v, 0.0])[:3], np.array([0.0, 0.0, turn]))


def build_field(target: TargetSettings, motion: FieldTarget, law: FieldLaw, horizon_s: float) -> FieldMotion:
    """Integrate a target's path for ``horizon_s`` and check it against the target's own bounds.

    Raises
    ------
    WorldError
        The start is missing, the law is not defined somewhere on the way, or the motion exceeds ``v_max_mps`` or
        ``lipschitz_per_s``.
    """
    d = law.dimensions
    start = _start(target, motion, law)
    t, p, v, rests = _integrate(target, law, start, horizon_s)
    fastest = int(np.argmax(np.linalg.norm(v, axis=1)))
    speed = float(np.linalg.norm(v[fastest]))
    if speed > target.v_max_mps * _BETWEEN:
        raise WorldError(
            f"target {target.name!r}: its law moves it at {speed:.4g} m/s near {_spot(p[fastest])} after "
            f"{t[fastest]:.4g} s, above v_max_mps = {target.v_max_mps:g}; raise v_max_mps or change the law"
        )
    _check_slope(target, motion, law, p)
    if d == 2:
        p, v = (np.column_stack([a, np.zeros(len(a))]) for a in (p, v))
        p[:, 2] = motion.start_height_m
    pieces = _hermite(t, p, v)
    path = TrackPath(t.tolist(), pieces, None, p[-1])
    return FieldMotion(
        path,
        0.0,
        _STILL_MPS,
        target.v_max_mps,
        target.w_max_radps,
        target.start_heading_rad,
        law,
        rests,
        motion.lipschitz_per_s,
    )


def _start(target: TargetSettings, motion: FieldTarget, law: FieldLaw) -> Array:
    if target.start_m is None:
        raise WorldError(
            f"target {target.name!r}: start_m is missing: a target of kind 'field' begins somewhere, such as [0, 0]"
        )
    place = [*target.start_m, motion.start_height_m][: law.dimensions]
    if not law.accelerates:
        if motion.start_velocity_mps is not None:
            raise WorldError(
                f"target {target.name!r}: motion.start_velocity_mps = {list(motion.start_velocity_mps)}: its law "
                "states the velocity already; leave it out, or give acceleration_mps2"
            )
        return np.array(place, dtype=float)
    speed = motion.start_velocity_mps
    if speed is None or len(speed) != law.dimensions:
        raise WorldError(
            f"target {target.name!r}: motion.start_velocity_mps = {speed}: {law.dimensions} numbers were expected, as "
            "the law states accelerations"
        )
    return np.array([*place, *speed], dtype=float)


def _integrate(
    target: TargetSettings, law: FieldLaw, start: Array, horizon_s: float
) -> tuple[Array, Array, Array, float]:
    """Return times (n,), places and velocities (n, d), and from when on the target stands."""
    d, calls = law.dimensions, 0
    if horizon_s / _KNOT_S > _MOST_KNOTS:
        raise WorldError(
            f"target {target.name!r}: a path of {horizon_s:g} s is too long: at most {_KNOT_S * _MOST_KNOTS:g} s"
        )

    def rate(t_s: float, state: Array) -> Array:
        nonlocal calls
        calls += 1
        if calls > _MOST_CALLS_PER_S * max(horizon_s, 1.0):
            raise WorldError(
                f"target {target.name!r}: its law cannot be followed beyond {t_s:.4g} s near {_spot(state[:d])}: it "
                "jumps or is stiff there; make it smoother"
            )
        p, v = state[None, :d], state[None, d:] if law.accelerates else np.zeros((1, d))
        value = law.of(p, v, t_s)[0]
        if not np.isfinite(value).all():
            raise WorldError(
                f"target {target.name!r}: its law has no value at {_spot(state[:d])} after {t_s:.4g} s (outside its "
                "grid, or a division by zero); change the start or the law"
            )
        return np.concatenate([v[0], value]) if law.accelerates else value

    def landed(t_s: float, state: Array) -> float:
        return float(state[2]) if t_s > 0.0 else 1.0

    landed.terminal, landed.direction = True, -1.0  # type: ignore[attr-defined]
    try:
        found = solve_ivp(
            rate,
            (0.0, horizon_s),
            start,
            method="DOP853",
            rtol=_RELATIVE,
            atol=_ABSOLUTE,
            dense_output=True,
            events=[landed] if d == 3 else None,
        )
    except ConfigError as error:
        raise WorldError(f"target {target.name!r}: {error}") from error
    if not found.success:
        raise WorldError(
            f"target {target.name!r}: its law cannot be followed beyond {float(found.t[-1]):.4g} s near "
            f"{_spot(found.y[:d, -1])}: {found.message}"
        )
    end = float(found.t[-1])
    t = np.linspace(0.0, end, max(2, math.ceil(end / _KNOT_S - 1e-9) + 1))
    states = found.sol(t).T
    p = states[:, :d]
    if law.accelerates:
        v = states[:, d:]
    elif law.by_place:
        v = law.velocity(p)
    else:
        v = np.array([rate(a, b) for a, b in zip(t.tolist(), p, strict=True)])
    moving = np.flatnonzero(np.linalg.norm(v, axis=1) > 1e-6)
    last = int(moving[-1]) + 1 if len(moving) else 0
    rests = end if end < horizon_s - 1e-9 else (float(t[last]) if last < len(t) - 1 else math.inf)
    return t, p, v, rests


def _check_slope(target: TargetSettings, motion: FieldTarget, law: FieldLaw, p: Array) -> None:
    """Compare the slope of the velocity along the path with the bound that is stated."""
    stated = motion.lipschitz_per_s
    if stated is None:
        return
    if not law.by_place:
        raise WorldError(
            f"target {target.name!r}: motion.lipschitz_per_s = {stated:g}: the place alone does not decide its "
            "velocity, so it has no slope over the place; leave it out"
        )
    parts = []
    for k in range(law.dimensions):
        shift = np.zeros(law.dimensions)
        shift[k] = _SLOPE_STEP_M
        parts.append((law.velocity(p + shift) - law.velocity(p - shift)) / (2.0 * _SLOPE_STEP_M))
    slopes = np.linalg.norm(np.stack(parts, axis=2), ord=2, axis=(1, 2))
    worst = int(np.nanargmax(slopes))
    if slopes[worst] > stated * (1.0 + 1e-6):
        raise WorldError(
            f"target {target.name!r}: the slope of its velocity is {slopes[worst]:.4g} 1/s near {_spot(p[worst])}, "
            f"above motion.lipschitz_per_s = {stated:g}; raise it"
        )


def _hermite(t: Array, p: Array, v: Array) -> Array:
    """Return the coefficients (n - 1, 4, 3) of the cubics with places and velocities at both ends."""
    h = np.diff(t)[:, None]
    slope = np.diff(p, axis=0) / h
    a = (v[:-1] + v[1:] - 2.0 * slope) / h**2
    b = (3.0 * slope - 2.0 * v[:-1] - v[1:]) / h
    return np.ascontiguousarray(np.stack([a, b, v[:-1], p[:-1]], axis=1))


def _spot(p: Array) -> str:
    return "(" + ", ".join(f"{x:.3g}" for x in p.tolist()) + ") m"
