"""Whether stated probabilities come true: reliability curve and expected calibration error.

The stated values are sorted and cut into bins of equal count; a bin's error is the difference of the mean stated
probability and the share that came true, and the expected calibration error is their mean, weighted by count (Naeini,
Cooper and Hauskrecht 2015, eq. 3; equal-count bins as in Nguyen and O'Connor 2015).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from camnet.types import Array, BoolArray

__all__ = ["calibration_error", "reliability"]


def reliability(stated: Array, true: BoolArray, bins: int = 10) -> list[dict[str, Any]]:
    """Return for bins of equal count: ``count``, mean ``stated`` (n,) and the share ``right`` of ``true`` (n,)."""
    order = np.argsort(stated, kind="stable")
    parts = [part for part in np.array_split(order, bins) if len(part)]
    return [
        {"count": len(k), "stated": float(np.mean(stated[k])), "right": float(np.mean(true[k]))}
        for k in parts
    ]


def calibration_error(stated: Array, true: BoolArray, bins: int = 10) -> float:
    """Return the expected calibration error of probabilities (n,) of what came true (n,); NaN without any."""
    rows = reliability(stated, true, bins)
    if not rows:
        return float("nan")
    return float(sum(r["count"] * abs(r["stated"] - r["right"]) for r in rows) / len(stated))
