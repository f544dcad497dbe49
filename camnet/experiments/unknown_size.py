"""A vehicle of unknown size, followed through a region lap after lap: its size by the agent's own motion.

Each run takes the vehicle for larger or smaller than it is, and says how far the size is off at the end and after 30 s
in view, and how far the estimate of its place is off in the second half of the run.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from camnet.config.load import load_scenario
from camnet.config.models import Scenario
from camnet.errors import ConfigError
from camnet.simulation.run import run_network

__all__ = ["ASSUMED", "print_table", "run"]

WORLD = "unknown_size"
#: what the vehicle is taken for, run after run, as a share of its size
ASSUMED = (1.4, 0.7, 1.2, 0.6, 2.0)
_EARLY_S = 30.0


def run(
    *,
    seeds: int = 10,
    out_dir: Path | None = None,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> dict[str, Any]:
    """Follow the vehicle in ``seeds`` runs."""
    rows = []
    for k in range(seeds):
        rows.append(_one(ASSUMED[k % len(ASSUMED)], seed + k))
        if progress is not None:
            progress((k + 1) / seeds)
    off = np.array([row["error_pct"] for row in rows])
    early = np.array([row["early_error_pct"] for row in rows if row["early_error_pct"] is not None])
    shares = np.array([row["error_sd"] for row in rows])
    return {
        "world": WORLD,
        "seeds": seeds,
        "runs": rows,
        "error_pct": {"rms": _rms(off), "largest": float(np.abs(off).max())},
        "after_30s_pct": {"rms": _rms(early), "largest": float(np.abs(early).max())} if len(early) else None,
        "within_2_sd": float(np.mean(shares <= 2.0)),
        "position_rmse_m": _rms(np.array([row["position_rmse_m"] for row in rows])),
        "region_exits": sum(row["region_exits"] for row in rows),
    }


def _rms(x: Any) -> float:  # noqa: ANN401 - an array
    return float(np.sqrt(np.mean(np.square(x))))


def _one(assumed: float, seed: int) -> dict[str, Any]:
    scenario = load_scenario(WORLD, (f"targets.vehicle.assumed_size={assumed}",))
    if not isinstance(scenario, Scenario):
        raise ConfigError(f"{WORLD}: a network was expected")
    result = run_network(scenario, seed, ("learned",))
    columns, values = result.log.columns, result.log.values
    size, sd, seen, t = (
        values[:, columns.index(name)]
        for name in ("vehicle.size", "vehicle.size_sd", "vehicle.seen_by", "t_s")
    )
    known = np.isfinite(sd)
    in_view = np.cumsum(seen >= 0) * float(t[1] - t[0])
    early = np.flatnonzero(known & (in_view >= _EARLY_S))
    where = [columns.index(f"vehicle.{who}p_{axis}_m") for who in ("", "learned.") for axis in "xyz"]
    p, late = values[:, where], known & (seen >= 0) & (t > 0.5 * t[-1])
    error = np.linalg.norm(p[:, 3:] - p[:, :3], axis=1)[late]
    return {
        "assumed": assumed,
        "scale": float(size[-1]),
        "error_pct": 100.0 * float(size[-1] - 1.0),
        "error_sd": abs(float(size[-1] - 1.0)) / float(size[-1] * sd[-1]),
        "early_error_pct": 100.0 * float(size[early[0]] - 1.0) if len(early) else None,
        "position_rmse_m": _rms(error),
        "region_exits": result.summary["region_exits"],
    }


def print_table(result: dict[str, Any]) -> None:
    """Print sizes and errors of all runs."""
    out = sys.stdout
    out.write(
        f"{'taken for':>10s} {'size found':>11s} {'error':>8s} {'after 30 s in view':>19s} {'position':>9s}\n"
    )
    for row in result["runs"]:
        early = "-" if row["early_error_pct"] is None else f"{row['early_error_pct']:+.1f} %"
        out.write(
            f"{row['assumed']:10.2f} {row['scale']:11.4f} {row['error_pct']:+6.2f} % {early:>19s} "
            f"{row['position_rmse_m']:7.3f} m\n"
        )
    e = result["error_pct"]
    out.write(f"size: RMS {e['rms']:.2f} %, largest {e['largest']:.2f} %\n")
