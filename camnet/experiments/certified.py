"""What every way of certifying returns, and the dwell times in force."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from camnet.report.certificate import MapLine
from camnet.simulation.certificates import network_certificates
from camnet.simulation.network import Network
from camnet.types import Array

__all__ = ["Certified", "dwell_times", "lyapunov_off"]

#: a time in view that stands for "as long as one likes", s
_LONG_S = 1e6


@dataclass(frozen=True, eq=False)
class Certified:
    """A report ready for JSON, and what its map shows: views as (name, outline (K, 2)) and lines."""

    report: dict[str, Any]
    views: list[tuple[str, Array]]
    lines: list[MapLine] = field(default_factory=list)


def dwell_times(network: Network, may_state: bool = True) -> tuple[float | None, float | None, str]:
    """Return (Dt_off, Dt_on) in force, s, and where they come from."""
    stated = network.scenario.certificate.off_max_s
    if may_state and stated is not None:
        return stated, 0.0, "stated by the designer"
    bounds = network_certificates(network).sound
    off, on = lyapunov_off(network), bounds.on_min(h=True).seconds
    return off, on, "Lyapunov analysis of the estimator, model learned"


def lyapunov_off(network: Network) -> float | None:
    """Return the longest time out of view that the estimator's analysis allows, model learned, s; None if none."""
    bounds = network_certificates(network).sound
    times = [bounds.off_max(_LONG_S, 0.5 * _LONG_S, d=True, h=h).seconds for h in (False, True)]
    known = [t for t in times if t is not None]
    return max(known) if known else None
