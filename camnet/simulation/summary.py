"""The figures of a run, in the form that others rely on."""

from __future__ import annotations

from typing import Any

from camnet.estimation.structure.moving.size_from_motion import SizeFromMotion
from camnet.simulation.certificates import network_report
from camnet.simulation.gaps import summarise_gaps
from camnet.simulation.loop import NetworkSimulation

__all__ = ["summarise"]


def summarise(simulation: NetworkSimulation, wall_s: float, interrupted: bool) -> dict[str, Any]:
    """Put the figures of one run together.

    Returns
    -------
    dict
        Ready for JSON. RMSE rows pool all targets; ``unseen`` is taken from the third lap on.
    """
    statistics, simulated_s = simulation.statistics, simulation.snapshot.t_s
    return {
        **statistics.episode(simulation),
        "estimator_in_charge": simulation.filter_names[0],
        "baselines": statistics.baselines(simulation),
        "dwell": _dwell(simulation),
        "controller": simulation.disturbance.summary(),
        "gaps": summarise_gaps([gap for recorder in simulation.gaps for gap in recorder.gaps]),
        "collision_list": [{"t_s": t, "bodies": [a, b]} for t, a, b in statistics.collisions],
        "estimator": {
            target: _finite(filter_.diagnostics())
            for target, filter_ in zip(simulation.world.target_names, simulation.driving, strict=True)
        },
        **_own_poses(simulation),
        "simulated_s": simulated_s,
        "interrupted": interrupted,
        "real_time_factor": simulated_s / wall_s if wall_s > 0 else None,
    }


def _own_poses(simulation: NetworkSimulation) -> dict[str, Any]:
    """Return what came of own poses and exit budgets; nothing where no agent has such."""
    out: dict[str, Any] = {}
    if simulation.statistics.outages is not None:
        out["own_pose"] = simulation.statistics.outages.summary()
    if simulation.exits is not None:
        out["exits"] = simulation.exits.summary()
    if simulation.sizes:
        names = simulation.world.target_names
        out["sizes"] = {names[m]: size_record(size) for m, size in simulation.sizes.items()}
    return out


def size_record(size: SizeFromMotion) -> dict[str, Any]:
    """Return what is known of a target's size at the end, as a share of the true one (1: right)."""
    found = size.estimate
    return {
        "assumed": size.assumed,
        "scale": size.scale if found is not None else None,
        "sd": size.scale * size.sd if found is not None else None,
        "sightings": size.sightings,
    }


def _dwell(simulation: NetworkSimulation) -> dict[str, Any]:
    """Return the certificates' report, with what each of them saw in this run and the violations of both."""
    report: dict[str, Any] = network_report(simulation.network)
    summaries = [monitor.summary() for monitor in simulation.statistics.dwell]
    for name in ("published", "sound"):
        report[name]["run"] = [summary[name] for summary in summaries]
    report["violations"] = sum(int(str(summary["violations"])) for summary in summaries)
    for name in ("broken", "certificate_violations", "overdue"):
        report[name] = sum(int(str(summary[name])) for summary in summaries)
    report["intervals"] = [
        {
            key: summary[key]
            for key in ("intervals_on", "intervals_off", "longest_off_s", "shortest_on_s", "excited_at_s")
        }
        for summary in summaries
    ]
    return report


def _finite(values: dict[str, float]) -> dict[str, float | None]:
    return {key: value if abs(value) < float("inf") else None for key, value in values.items()}
