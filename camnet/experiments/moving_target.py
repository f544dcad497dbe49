"""A target of unknown size that moves before a moving camera and goes out of view (bell2019, chapter 5).

The paper has no experiment for this chapter; this is the first. `moving_target_scene` has the set-up. Each seed is run
with every pixel noise and three ways: the same lap again and again, laps whose speed varies, and laps that fork.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from camnet.errors import ConfigError
from camnet.experiments.kept_runs import KeptRuns
from camnet.experiments.moving_target_gaps import Gap, predict_gaps
from camnet.experiments.moving_target_run import learn_structure, scene_tracks, stretches
from camnet.experiments.moving_target_scale import NeverAtRest, at_rest, never_at_rest
from camnet.experiments.moving_target_scene import MovingSetUp, Way, make_moving_scene
from camnet.experiments.moving_target_seen import SeenErrors, seen_errors
from camnet.experiments.moving_target_summary import SPANS_S, OneRun, ScaleRun, summarise
from camnet.processes.place import LOCAL, Place
from camnet.report.moving_target import write_moving_target

__all__ = ["EXPERIMENT", "print_table", "run"]

EXPERIMENT = "moving-target"
_WAYS: tuple[Way, ...] = ("same", "speed", "branch")
#: odometry's scale error in the second figure of the scale at rest
_SCALE_SD = 0.01


def run(
    seeds: int = 6,
    out_dir: Path | str | None = None,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
    setup: MovingSetUp | None = None,
    jobs: int = 2,
    place: Place = LOCAL,
) -> dict[str, Any]:
    """Run the experiment for ``seeds`` seeds from ``seed`` on; with ``out_dir`` also write figures and a page there.

    Runs are kept beside ``out_dir`` (`kept_runs`); ``jobs`` workers of ``place`` do them.

    Raises
    ------
    ConfigError
        If ``seeds`` is not positive.
    """
    if seeds < 1:
        raise ConfigError(f"seeds: {seeds!r} is not a number of runs; give at least 1")
    setup = setup or MovingSetUp()
    numbers = range(seed, seed + seeds)
    ways = [_Job(number, noise, way) for number in numbers for noise in setup.noises_px for way in _WAYS]
    scales = [_Job(seed + k, noise, None) for k in range(setup.scale_seeds) for noise in setup.noises_px]
    kept = KeptRuns(EXPERIMENT, setup, _one, [OneRun, SeenErrors, Gap, ScaleRun, NeverAtRest])
    found = kept.results([*ways, *scales], _name, out_dir, progress, jobs, place)
    runs: list[OneRun] = [r for r in found if isinstance(r, OneRun)]
    still = never_at_rest(setup, setup.noises_px[0], SPANS_S, seed, still=True)
    content = {
        "experiment": EXPERIMENT,
        "seeds": seeds,
        **summarise(setup, runs, [r for r in found if isinstance(r, ScaleRun)], still),
        "config": setup.model_dump(mode="json"),
    }
    if out_dir is not None:
        gaps = {str(way): [g for r in runs if r.way == way for g in r.gaps if g.lap > 0] for way in _WAYS}
        write_moving_target(gaps, content, Path(out_dir))
    return content


class _Job(NamedTuple):
    """One run of a way, or with no way the scales of one target."""

    seed: int
    noise_px: float
    way: Way | None


def _name(job: _Job) -> str:
    return f"{job.way or 'scale'}-{job.noise_px:g}px-{job.seed}"


def _one(setup: MovingSetUp, job: _Job) -> OneRun | ScaleRun:
    if job.way is None:
        return ScaleRun(
            at_rest(setup, job.noise_px, 0.0, job.seed),
            at_rest(setup, job.noise_px, _SCALE_SD, job.seed),
            never_at_rest(setup, job.noise_px, SPANS_S, job.seed),
        )
    scene = make_moving_scene(setup, job.noise_px, job.way, np.random.default_rng(job.seed))
    learned = learn_structure(setup, scene)
    tracks = scene_tracks(scene, learned)
    parts = stretches(setup, scene, tracks)
    return OneRun(
        job.noise_px,
        job.way,
        seen_errors(setup, scene, learned, tracks, parts),
        predict_gaps(scene, tracks, parts, setup.replay, setup.frame_hz),
    )


def print_table(result: dict[str, Any]) -> None:
    """Print the figures beside their limits, and the gaps."""
    _say(f"{'':62s} {'figure':>10s} {'limit':>10s}")
    for row in result["acceptance"]:
        verdict = "" if row["reached"] else "NOT REACHED"
        _say(f"{row['what']:62s} {_cell(row['value'])} {_cell(row['limit'])}  {verdict}")
    _say("error at re-sighting after gaps of 10 to 20 s, m: median (90 %)")
    for part in ("gaps", "first_lap", "varied_speed", "branch"):
        rows = {k: v for k, v in result[part].items() if isinstance(v, dict) and "median_m" in v}
        count = next(iter(rows.values()))["count"] if rows else 0
        _say(f"  {part}, {count} gaps")
        for name, row in rows.items():
            _say(f"    {name:20s} {row['median_m']:7.3f} ({row['p90_m']:.3f})")
    _say(f"never at rest, still camera: scale {result['never_at_rest']['still_camera']}")
    _say(f"{result['seeds']} seeds")


def _cell(value: float | None) -> str:
    return f"{'-':>10s}" if value is None else f"{value:10.3g}"


def _say(line: str) -> None:
    sys.stdout.write(line + "\n")
