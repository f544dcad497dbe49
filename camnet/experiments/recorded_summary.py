"""Figures of a run on recorded tracks, with confidence intervals from the bootstrap over targets.

Gaps of one target are alike, so not gaps but targets are drawn anew (cluster bootstrap, Davison and Hinkley 1997,
sec. 3.8); a quantile under redrawn targets is a weighted quantile, with a gap's weight the times its target was drawn.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from camnet.types import Array, BoolArray, IntArray

__all__ = ["Row", "summarise"]

_DRAWS = 1000
_HEADLINE = ("learned", "ekf", "last_seen")
_LEVELS = (0.025, 0.975)


@dataclass(frozen=True, eq=False, slots=True)
class Row:
    """One predictor's errors at re-sighting (n,) in m and whether its next camera was right (n,)."""

    error_m: Array
    right_camera: BoolArray


def summarise(rows: Mapping[str, Row], target: IntArray, rng: np.random.Generator) -> dict[str, Any]:
    """Summarise gaps.

    Parameters
    ----------
    rows : ``learned``, ``ekf``, ``last_seen``, ``learned_at_exit`` (its cameras alone count) and any others
    target : (n,) whose gap each is
    rng : draws targets

    Returns
    -------
    summary
        Errors in m at re-sighting by row, ``next_camera_accuracy`` by row, ``ci95`` intervals of both and of the
        learned row's advantage, and ``others`` for rows beyond those.
    """
    weights = _draws(target, rng)
    figures = {name: _figures(row) for name, row in rows.items() if name != "learned_at_exit"}
    accuracy = {name: float(np.mean(row.right_camera)) for name, row in rows.items()}
    medians = {
        name: _weighted_medians(row.error_m, weights) for name, row in rows.items() if name in _HEADLINE
    }
    shares = {
        name: weights @ row.right_camera / weights.sum(axis=1)
        for name, row in rows.items()
        if name in _HEADLINE
    }
    others = {
        name: {**row, "next_camera_accuracy": accuracy[name]}
        for name, row in figures.items()
        if name not in _HEADLINE
    }
    return {
        "count": len(target),
        **{name: figures[name] for name in _HEADLINE},
        "next_camera_accuracy": {name: accuracy[name] for name in (*_HEADLINE, "learned_at_exit")},
        "ci95": {
            "median_error_m": {name: _interval(medians[name]) for name in _HEADLINE},
            "median_error_below_last_seen_m": _interval(medians["last_seen"] - medians["learned"]),
            "median_error_below_ekf_m": _interval(medians["ekf"] - medians["learned"]),
            "next_camera_accuracy": {name: _interval(shares[name]) for name in _HEADLINE},
            "next_camera_accuracy_above_last_seen": _interval(shares["learned"] - shares["last_seen"]),
        },
        **({"others": others} if others else {}),
    }


def _figures(row: Row) -> dict[str, float]:
    return {
        "median_error_m": float(np.median(row.error_m)),
        "p90_error_m": float(np.quantile(row.error_m, 0.9)),
        "mean_error_m": float(np.mean(row.error_m)),
    }


def _draws(target: IntArray, rng: np.random.Generator) -> Array:
    """Weights (draws, n) of gaps: how often each one's target is drawn."""
    present, index = np.unique(target, return_inverse=True)
    drawn = rng.multinomial(len(present), np.full(len(present), 1.0 / len(present)), size=_DRAWS)
    return np.asarray(drawn[:, index], dtype=np.float64)


def _weighted_medians(error_m: Array, weights: Array) -> Array:
    """Median (draws,) of errors (n,) under weights (draws, n)."""
    order = np.argsort(error_m)
    share = np.cumsum(weights[:, order], axis=1)
    half = np.argmax(share >= 0.5 * share[:, -1:], axis=1)
    return np.asarray(error_m[order][half])


def _interval(values: Array) -> list[float]:
    return [float(v) for v in np.quantile(values, _LEVELS)]
