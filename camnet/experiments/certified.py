"""What every way of certifying returns, and the dwell times that are proven."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from camnet.certification.promise import Promise
from camnet.report.certificate import MapLine
from camnet.simulation.certificates import network_certificates, premise_faults
from camnet.simulation.network import Network
from camnet.types import Array

__all__ = ["Certified", "dwell_times", "lyapunov_off"]

#: a time in view that stands for "as long as one likes", s
_LONG_S = 1e6


@dataclass(frozen=True, eq=False)
class Certified:
    """A report ready for JSON, and what its map shows: views as (name, outline (K, 2)) and lines.

    ``solids`` are occluders, names and outlines; ``promise`` is that of the report as data, None where it has none.
    """

    report: dict[str, Any]
    views: list[tuple[str, Array]]
    lines: list[MapLine] = field(default_factory=list)
    promise: Promise | None = None
    solids: list[tuple[str, Array]] = field(default_factory=list)


def dwell_times(network: Network) -> tuple[float | None, float | None, str]:
    """Return (Dt_off, Dt_on) that the estimator's analysis proves, s, None where there are none, and their source."""
    source = "Lyapunov analysis of the estimator, model learned"
    off, on = lyapunov_off(network), network_certificates(network).sound.on_min(h=True).seconds
    return (
        (None, None, source) if off is None or on is None else (off, on, source)
    )  # one without the other is none


def lyapunov_off(network: Network) -> float | None:
    """Return the longest time out of view that the estimator's analysis allows, model learned, s; None if none."""
    if premise_faults(network):
        return None
    bounds = network_certificates(network).sound
    times = [bounds.off_max(_LONG_S, 0.5 * _LONG_S, d=True, h=h).seconds for h in (False, True)]
    known = [t for t in times if t is not None]
    return max(known) if known else None
