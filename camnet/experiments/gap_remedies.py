"""The gap problem in one table: each remedy alone, none, and combinations, on four worlds.

| row | estimator |
| --- | --- |
| ``none`` | the published predictor: no prior mean, nothing learned across gaps |
| ``prior`` | 1 alone: constant turn where the model has no data |
| ``across`` | 2 alone: the path across a gap, reconstructed at the re-sighting, is learned |
| ``roads`` | 3 alone: along the known road at the speed of the exit, at its lateral offset; kernels know the heading |
| ``experience`` | 4 alone: where and when earlier crossings came out |
| ``prior_across`` | 1 and 2 |
| ``roads_across`` | 2 and 3 |
| ``all`` | 1 to 4: 2 and 3 (whose prior is 1 off the roads), and 4 by the record of both |
| ``ekf`` | constant velocity, for comparison |

In the simulated worlds all rows get the same measurements: the default estimator steers the cameras. A *first* crossing
is one between a pair of cameras that no target has crossed before, in that direction; all others are *later* ones.
Place: distance between prediction and truth at the re-sighting. Time: when the row, at the exit, expected the target in
the next region, less when it was seen there; `foreseen` is the share of gaps for which it expected it in any region
at all within the horizon, and `next_camera` the share for which the region was right.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from camnet.config.load import load_scenario
from camnet.config.models import Scenario
from camnet.errors import ConfigError
from camnet.estimation.learning_estimator import LearningEstimator
from camnet.estimation.placement import place_basis
from camnet.estimation.protocol import TargetFilter
from camnet.estimation.settings import EstimatorSettings, GapSettings
from camnet.experiments.gap_experience import ExperienceFilter, LessonBook, scale_of
from camnet.experiments.gap_remedies_recorded import run_recorded_remedies
from camnet.experiments.kinematic_world import KinematicWorld
from camnet.report.experiments import write_gap_remedies
from camnet.simulation.filters import TargetTruth
from camnet.simulation.gaps import Gap
from camnet.simulation.loop import FilterMaker, NetworkSimulation, Setpoints
from camnet.simulation.network import Network, build_network
from camnet.simulation.run import decide, setpoints_for
from camnet.world.protocol import World
from camnet.world.pybullet import PyBulletWorld

__all__ = ["ROWS", "WORLDS", "print_table", "run", "run_world"]

ROWS = ("none", "prior", "across", "roads", "experience", "prior_across", "roads_across", "all", "ekf")
#: world: its overrides, the run's length (s), whether targets travel roads both ways
WORLDS: Mapping[str, tuple[tuple[str, ...], float, bool]] = {
    "quickstart": ((), 360.0, False),
    "stationary_loop": ((), 500.0, False),
    "patrol": (
        (
            "estimator.basis.spacing_m=2.0",
            "estimator.basis.width_m=2.0",
            "estimator.basis.heading_scale_m=4.0",
            "handoff.lookahead_s=60",
        ),
        700.0,
        True,
    ),
}


def _settings(base: EstimatorSettings, both_ways: bool, **gap: Any) -> EstimatorSettings:  # noqa: ANN401 - GapSettings
    inputs = {"inputs": "position_heading"} if both_ways else {}
    return base.model_copy(
        update={
            "gap": GapSettings.model_validate({**base.gap.model_dump(), **gap}),
            "basis": base.basis.model_copy(update=inputs),
        }
    )


def row_makers(both_ways: bool) -> dict[str, FilterMaker]:
    """Rows by name; ``both_ways`` lets remedy 3 tell the two directions of a road apart."""
    plain = {
        "none": (False, {"prior": "none", "learn_across": False}),
        "prior": (False, {"prior": "constant_turn", "learn_across": False}),
        "across": (False, {"prior": "none", "learn_across": True}),
        "roads": (both_ways, {"prior": "road", "learn_across": False}),
        "prior_across": (False, {"prior": "constant_turn", "learn_across": True}),
        "roads_across": (both_ways, {"prior": "road", "learn_across": True}),
    }
    makers = {name: _maker(heading, gap, None) for name, (heading, gap) in plain.items()}
    makers["experience"] = _maker(*plain["none"], False)
    makers["all"] = _maker(*plain["roads_across"], True)
    return makers


def _maker(both_ways: bool, gap: Mapping[str, Any], experience: bool | None) -> FilterMaker:
    def make(network: Network, truths: Sequence[TargetTruth]) -> list[TargetFilter]:
        scenario = network.scenario
        settings = _settings(scenario.estimator, both_ways, **gap)
        basis = place_basis(settings.basis, scenario.roads, *network.bounds)
        made = [
            LearningEstimator(
                settings,
                basis,
                len(network.regions),
                scenario.sensing.rate_hz,
                network.bounds,
                roads=scenario.roads,
            )
            for _ in truths
        ]
        if experience is None:
            return list(made)
        book = LessonBook(scale_of(network.half_widths))
        return [ExperienceFilter(one, book, experience, "experience") for one in made]

    return make


def run_world(
    name: str, seed: int, duration_s: float | None = None, progress: Callable[[float], None] | None = None
) -> list[Gap]:
    """Run one world once; returns its gaps with every row's predictions."""
    overrides, full_s, both_ways = WORLDS[name]
    scenario = load_scenario(name, list(overrides))
    if not isinstance(scenario, Scenario):
        raise ConfigError(f"{name!r} is no network")
    network = build_network(scenario)
    physical = bool(scenario.agents)
    world: World = (PyBulletWorld if physical else KinematicWorld)(network.description)
    simulation = NetworkSimulation(network, world, ("learned", *ROWS), seed, row_makers(both_ways))
    nobody = Setpoints(np.zeros((0, 3)), np.zeros((0, 2)))
    steps = round((full_s if duration_s is None else duration_s) * scenario.run.decision_hz)
    for k in range(steps):
        simulation.advance(setpoints_for(simulation, decide(simulation)) if physical else nobody)
        if progress is not None and k % 100 == 0:
            progress(k / steps)
    world.close()
    return [gap for recorder in simulation.gaps for gap in recorder.gaps]


def tabulate(runs: Sequence[Sequence[Gap]]) -> dict[str, Any]:
    """Figures of every row over the gaps of several runs, first and later crossings apart."""
    first: list[Gap] = []
    later: list[Gap] = []
    for gaps in runs:
        known: set[tuple[int, int]] = set()
        for gap in sorted(gaps, key=lambda g: g.seen_s):
            pair = (gap.from_camera, gap.to_camera)
            (later if pair in known else first).append(gap)
            known.add(pair)
    return {
        "gaps": {"first": len(first), "later": len(later)},
        "rows": {name: {"first": _figures(first, name), "later": _figures(later, name)} for name in ROWS},
    }


def _figures(gaps: Sequence[Gap], name: str) -> dict[str, float | None]:
    if not gaps:
        return dict.fromkeys(("place_median_m", "place_rms_m", "time_median_s", "foreseen", "next_camera"))
    place = np.array([gap.error_m[name] for gap in gaps])
    late = np.array([gap.expected_s[name] - gap.seen_s for gap in gaps])
    foreseen = np.isfinite(late)
    return {
        "place_median_m": float(np.median(place)),
        "place_rms_m": float(np.sqrt(np.mean(place**2))),
        "time_median_s": float(np.median(np.abs(late[foreseen]))) if foreseen.any() else None,
        "foreseen": float(foreseen.mean()),
        "next_camera": float(np.mean([gap.next_camera[name] == gap.to_camera for gap in gaps])),
    }


def run(
    seeds: int = 3,
    out_dir: Path | str | None = None,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
    data: Path | None = None,
    worlds: Sequence[str] = tuple(WORLDS),
) -> dict[str, Any]:
    """Run all worlds; with ``data`` (a folder with MEVA's ``cameras`` and ``tracks.csv.gz``) the recording too.

    Raises
    ------
    ConfigError
        If ``seeds`` is not positive.
    """
    if seeds < 1:
        raise ConfigError(f"seeds: {seeds!r} is not a number of runs; give at least 1")
    total, done = len(worlds) * seeds + (data is not None), 0
    tables: dict[str, Any] = {}
    for name in worlds:
        runs = []
        for number in range(seed, seed + seeds):
            start = done / total
            runs.append(
                run_world(
                    name,
                    number,
                    progress=None if progress is None else lambda share, a=start: progress(a + share / total),  # type: ignore[misc]
                )
            )
            done += 1
        tables[name] = tabulate(runs)
    content: dict[str, Any] = {"experiment": "gap-remedies", "seeds": seeds, "worlds": tables}
    if data is None:
        content["meva"] = {"skipped": "no recording: give --data DIR with cameras/*.krtd and tracks.csv.gz"}
    else:
        content["meva"] = run_recorded_remedies(data, seed)
    if progress is not None:
        progress(1.0)
    if out_dir is not None:
        Path(out_dir).mkdir(parents=True, exist_ok=True)
        write_gap_remedies(tables, ROWS, Path(out_dir) / "remedies.png")
    return content


def print_table(result: dict[str, Any]) -> None:
    """Print one block a world: place (median, m), time (median of its absolute value, s), next camera."""
    for world, table in result["worlds"].items():
        gaps = table["gaps"]
        _say(f"{world}: {gaps['first']} first crossings, {gaps['later']} later ones")
        head = f"{'place':>13s} {'time':>8s} {'camera':>7s}"
        _say(f"  {'first, later':14s} {head}   {head}")
        for name, row in table["rows"].items():
            _say(f"  {name:14s} {_cells(row['first'])}   {_cells(row['later'])}")
    meva = result["meva"]
    if "skipped" in meva:
        _say(f"meva: skipped, {meva['skipped']}")
        return
    _say(f"meva: {meva['gaps']['first']} first crossings, {meva['gaps']['later']} later ones; medians")
    for name, row in meva["rows"].items():
        _say(f"  {name:18s} {_cells(row['first'])}   {_cells(row['later'])}")


def _cells(figures: Mapping[str, float | None]) -> str:
    place, time_s, camera = (figures.get(k) for k in ("place_median_m", "time_median_s", "next_camera"))
    return (
        f"{'-' if place is None else f'{place:.3f} m':>13s} {'-' if time_s is None else f'{time_s:.2f} s':>8s} "
        f"{'-' if camera is None else f'{camera:.0%}':>7s}"
    )


def _say(line: str) -> None:
    sys.stdout.write(line + "\n")
