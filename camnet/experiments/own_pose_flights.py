"""The own-pose filter alone: many flights at 1 m/s, calibrated before an outage or not, without a network."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from camnet.compiled import cached_njit
from camnet.estimation.own_pose import (
    OwnErrors,
    OwnModel,
    advance_own,
    draw_errors,
    fix_own,
    own_model,
    start_own,
)
from camnet.sensing.own_pose_settings import PoseSource
from camnet.types import Array, IntArray

__all__ = ["MARKS_S", "WAYS", "fly_alone"]

#: the error is taken so long into the outage, s
MARKS_S = (10.0, 30.0, 60.0, 119.0)
_SPEED_MPS, _DT_S, _BEFORE_S, _FLIGHTS = 1.0, 0.05, 100.0, 100
#: half of a leg of the search pattern, m
_LEG_M = 3.0


def _straight(t_s: Array) -> Array:
    return np.column_stack([_SPEED_MPS * t_s, np.zeros_like(t_s)])


def _lawn(t_s: Array) -> Array:
    """Legs across a field: to and fro over 6 m, 2 m further after each."""
    lap = 2.0 * (2.0 * _LEG_M + 2.0)
    s = np.mod(_SPEED_MPS * t_s, lap)
    x = np.interp(
        s, [0.0, 2 * _LEG_M, 2 * _LEG_M + 2, 4 * _LEG_M + 2, lap], [-_LEG_M, _LEG_M, _LEG_M, -_LEG_M, -_LEG_M]
    )
    y = np.interp(s, [0.0, 2 * _LEG_M, 2 * _LEG_M + 2, 4 * _LEG_M + 2, lap], [0.0, 0.0, 2.0, 2.0, 4.0])
    return np.column_stack([x, y + 4.0 * np.floor(_SPEED_MPS * t_s / lap)])


#: ways flown at 1 m/s; each (K,2) at times (K,)
WAYS: dict[str, Callable[[Array], Array]] = {"straight on": _straight, "search pattern": _lawn}


def fly_alone(
    source: PoseSource, way: str, seed: int, flights: int = _FLIGHTS
) -> dict[str, dict[str, float]]:
    """Return what 95 % of the errors of position are below, m, by time into the outage, calibrated and raw.

    Each flight begins with 100 s of external pose; both versions have the same noise.
    """
    errors: dict[str, list[list[float]]] = {"calibrated": [], "raw": []}
    rng = np.random.default_rng([seed, sorted(WAYS).index(way)])
    for _ in range(flights):
        state = rng.bit_generator.state
        for kind, found in errors.items():
            rng.bit_generator.state = state
            found.append(_fly(source.model_copy(update={"calibrate": kind == "calibrated"}), WAYS[way], rng))
    return {
        kind: {f"{m:g}": float(p) for m, p in zip(MARKS_S, np.percentile(found, 95.0, axis=0), strict=True)}
        for kind, found in errors.items()
    }


def _fly(source: PoseSource, way: Callable[[Array], Array], rng: np.random.Generator) -> list[float]:
    """Fly once and return the errors at the marks, m."""
    model, errors = own_model(source, _DT_S), draw_errors(source, rng)
    count = round((_BEFORE_S + MARKS_S[-1]) / _DT_S)
    t: Array = _DT_S * np.arange(count + 1, dtype=np.float64)
    poses = np.column_stack([way(t), np.zeros(count + 1)])
    draws = rng.standard_normal((count + 1, 6))
    x, cov = np.zeros(9), np.zeros((9, 9))
    start_own(x, cov, model, poses[0], draws[0, 3:])
    every = max(1, round(1.0 / (source.fixes.rate_hz * _DT_S)))
    marks = np.array([round((_BEFORE_S + m) / _DT_S) for m in MARKS_S])
    _steps(
        x,
        cov,
        model,
        errors,
        poses,
        draws,
        round(_BEFORE_S / _DT_S),
        every,
        marks,
        found := np.empty(len(marks)),
    )
    return found.tolist()


@cached_njit
def _steps(
    x: Array, cov: Array, model: OwnModel, errors: OwnErrors, poses: Array, draws: Array, fixes: int, every: int,
    marks: IntArray, found: Array,
) -> None:  # fmt: skip
    """Fly along ``poses`` (K,3); fixes come ``every`` so many steps until step ``fixes``."""
    for k in range(1, len(poses)):
        advance_own(x, cov, model, errors, poses[k - 1], poses[k], _DT_S, draws[k, :3], np.nan)
        if k <= fixes and k % every == 0:
            fix_own(x, cov, model, poses[k], draws[k, 3:])
        for i in range(len(marks)):
            if k == marks[i]:
                found[i] = np.hypot(x[0] - poses[k, 0], x[1] - poses[k, 1])
