"""Summary of the moving-target experiment: what the runs found, as the result states it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from camnet.experiments.moving_target_acceptance import acceptance
from camnet.experiments.moving_target_gaps import PREDICTORS, Gap
from camnet.experiments.moving_target_identities import identity_errors
from camnet.experiments.moving_target_scale import NeverAtRest
from camnet.experiments.moving_target_scene import MovingSetUp, Way
from camnet.experiments.moving_target_seen import SeenErrors
from camnet.types import Array

__all__ = ["SPANS_S", "OneRun", "ScaleRun", "summarise"]

#: durations for targets that never rest, s
SPANS_S = (30.0, 150.0)


@dataclass(frozen=True, eq=False, slots=True)
class OneRun:
    """One run of one way with one pixel noise."""

    noise_px: float
    way: Way
    seen: SeenErrors
    gaps: list[Gap]


@dataclass(frozen=True, slots=True)
class ScaleRun:
    """Scales of one target: (relative error, shape error m) at rest, without and with an odometry scale error.

    ``moving``: the same target, never at rest.
    """

    at_rest: tuple[float, float]
    at_rest_scaled: tuple[float, float]
    moving: NeverAtRest


def summarise(
    setup: MovingSetUp, runs: Sequence[OneRun], scales: Sequence[ScaleRun], still: NeverAtRest
) -> dict[str, Any]:
    """Return the result's figures and what they are held against; ``still``: never at rest before a still camera."""
    worst, printed = identity_errors()
    later = {
        way: [g for r in runs if r.way == way for g in r.gaps if g.lap > 0]
        for way in ("same", "speed", "branch")
    }
    content = {
        "identities_max_error": worst,
        "printed_velocity_error_mps": printed,
        "scale": {
            "rms_pct": _rms_pct([s for s, _ in (r.at_rest for r in scales)]),
            "rms_pct_odometry_1pct": _rms_pct([s for s, _ in (r.at_rest_scaled for r in scales)]),
            "shape_mm": 1e3 * _rms(np.array([shape for _, shape in (r.at_rest for r in scales)])),
            "runs": len(scales),
        },
        "seen": _seen(setup, runs),
        "gaps": _gap_rows(later["same"]),
        "first_lap": _gap_rows([g for r in runs for g in r.gaps if g.lap == 0]),
        "varied_speed": _gap_rows(later["speed"]),
        "branch": _branch(setup, later["branch"]),
        "never_at_rest": _never([r.moving for r in scales], still),
    }
    return {**content, "acceptance": acceptance(content)}


def _rms(x: Array) -> float:
    return float(np.sqrt(np.mean(x * x)))


def _rms_pct(errors: Sequence[float | None]) -> float | None:
    there = [e for e in errors if e is not None]
    return 100.0 * _rms(np.array(there)) if there else None


def _seen(setup: MovingSetUp, runs: Sequence[OneRun]) -> dict[str, Any]:
    """RMS over all instants in view; the bound of the position is 0.03 m + 1.5 % of the range, RMS alike."""

    def row(mine: Sequence[OneRun]) -> dict[str, float]:
        def joined(name: str) -> Array:
            return np.concatenate([getattr(r.seen, name) for r in mine])

        return {
            "position_m": _rms(joined("position")),
            "position_bound_m": _rms(0.03 + 0.015 * joined("range_m")),
            "velocity_mps": _rms(joined("velocity")),
            "heading_deg": float(np.degrees(_rms(joined("heading")))),
            "velocity_chi_mps": _rms(joined("chi")),
            "velocity_chi_printed_mps": _rms(joined("chi_printed")),
            "chi_share": float(np.mean([r.seen.chi_share for r in mine])),
        }

    by_noise = {f"{n:g}px": row([r for r in runs if r.noise_px == n]) for n in setup.noises_px}
    return {**row(runs), "by_noise": by_noise}


def _gap_rows(gaps: Sequence[Gap]) -> dict[str, Any]:
    """Median and 90 % quantile by predictor; empty if there is no such gap."""
    if not gaps:
        return {}
    names = [name for name in PREDICTORS if name in gaps[0].error_m]
    rows = {}
    for name in names:
        errors = np.array([g.error_m[name] for g in gaps])
        median, p90 = np.quantile(errors, [0.5, 0.9]).tolist()
        rows[name] = {"median_m": median, "p90_m": p90, "count": len(gaps)}
    return rows


def _branch(setup: MovingSetUp, gaps: Sequence[Gap]) -> dict[str, Any]:
    """Rows, and in which share one of the stated futures is within ``replay.apart_m`` of the truth."""
    rows = _gap_rows(gaps)
    if gaps:
        rows["holds_true_share"] = float(np.mean([g.nearest_m < setup.replay.apart_m for g in gaps]))
        across = [g.nearest_m < setup.replay.apart_m for g in gaps if g.across_fork]
        rows["across_fork"] = {"holds_true": sum(across), "count": len(across)}
        rows["futures_mean"] = float(np.mean([g.futures for g in gaps]))
    return rows


def _never(runs: Sequence[NeverAtRest], still: NeverAtRest) -> dict[str, Any]:
    found = {span: [r.no_slip[span] for r in runs] for span in SPANS_S}
    unknown = all(x is None for x in still.no_slip.values())
    return {
        **{f"{span:g}s_pct": _rms_pct(x) for span, x in found.items()},
        "runs": len(runs),
        "without_result": {f"{span:g}s": sum(e is None for e in x) for span, x in found.items()},
        "still_camera": "unobservable" if unknown else "observable",
        "known_size_pct": _rms_pct([r.size for r in runs]),
        "known_height_pct": _rms_pct([r.height for r in runs]),
    }
