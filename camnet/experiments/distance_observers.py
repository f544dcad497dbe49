"""Distances to a checkerboard's corners from a moving camera (bell2019, section 3.4; tables 3-1 to 3-3).

One set-up for all rows (`distance_observers_scene`), all split at estimator 2's ``max tau_i``. Beside the published
estimators stand our bundle adjustment from the same start of 0.5 m, the same with a depth prior (another problem: it
is told about how far the board is), and a Cramer-Rao-type figure.

Where ours differ from print: estimator 3 and the EKF depend on how the optical flow was formed and on whether Q is per
second or per step, neither of which is published. From a start far too near, estimator 3 is driven away by its
quadratic term while the camera moves forward, faster than its gain of 100 corrects it.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from camnet.errors import ConfigError
from camnet.estimation.structure.tracks import FeatureTracks, SimulatedTracks
from camnet.experiments.distance_observers_images import board_tracks
from camnet.experiments.distance_observers_run import PARTS, ROWS, RunResult, run_scene
from camnet.experiments.distance_observers_scene import BoardScene, SetUp, make_scene
from camnet.experiments.kept_runs import KeptRuns
from camnet.processes.place import LOCAL, Place
from camnet.report.structure import write_distance_observers

__all__ = ["EXPERIMENT", "PUBLISHED", "print_table", "run"]

EXPERIMENT = "distance-observers"
#: bell2019, tables 3-1 to 3-3: means over 15 runs, m
PUBLISHED = {
    "rows": {
        "estimator_1": {"whole": 75.578, "before": 134.790, "after": 11.998},
        "estimator_2": {"whole": 59.068, "before": 105.455, "after": 2.547},
        "estimator_3": {"whole": 64.862, "before": 113.073, "after": 17.539},
        "ekf": {"whole": 59.141, "before": 104.287, "after": 10.897},
    },
    "position_m": {"whole": 0.026, "before": 0.005, "after": 0.031},
}


def run(
    seeds: int = 15,
    out_dir: Path | str | None = None,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
    setup: SetUp | None = None,
    images: bool = False,
    jobs: int = 2,
    place: Place = LOCAL,
) -> dict[str, Any]:
    """Run the experiment for ``seeds`` seeds from ``seed`` on; with ``out_dir`` also write figures and a page there.

    With ``images`` the corners come from rendered images instead of projections with noise. Runs are kept beside
    ``out_dir`` (`kept_runs`); ``jobs`` workers of ``place`` do them.

    Raises
    ------
    ConfigError
        If ``seeds`` is not positive.
    """
    if seeds < 1:
        raise ConfigError(f"seeds: {seeds!r} is not a number of runs; give at least 1")
    setup = setup or SetUp()
    tasks = [(seed + k, images) for k in range(seeds)]
    runs = KeptRuns(EXPERIMENT, setup, _one, [RunResult])
    results = runs.results(tasks, _name, out_dir, progress, jobs, place)
    content = {**_summary(setup, results), "input": "rendered images" if images else "simulated tracks"}
    if out_dir is not None:
        write_distance_observers(results, content, Path(out_dir))
    return content


def _one(setup: SetUp, job: tuple[int, bool]) -> RunResult:
    """One run: its seed, and whether images are rendered."""
    return run_scene(setup, *_scene(setup, *job))


def _name(job: tuple[int, bool]) -> str:
    return f"seed-{job[0]}" + ("-images" if job[1] else "")


def _scene(setup: SetUp, seed: int, images: bool = False) -> tuple[BoardScene, FeatureTracks]:
    """Scene and tracks of one seed."""
    scene_rng, noise_rng = np.random.default_rng(seed).spawn(2)
    scene = make_scene(setup, scene_rng)
    if images:
        return scene, board_tracks(setup, scene, noise_rng)
    return scene, SimulatedTracks(
        scene.points_world, scene.path, scene.camera, scene.t_s, setup.noise_px, noise_rng
    )


def _summary(setup: SetUp, results: Sequence[RunResult]) -> dict[str, Any]:
    runs: list[dict[str, Any]] = [
        {
            "rows": {name: r.parts(r.error_m[name]) for name in ROWS},
            "position_m": r.parts(r.position_m),
            "bound": {name: r.parts(values) for name, values in r.bound_m.items()},
            "learned_from_s": float(r.t_s[np.argmax(r.learned)]) if r.learned.any() else None,
            "duration_s": float(r.t_s[-1]),
        }
        for r in results
    ]
    bound = {
        name: {part: _mean([run["bound"][name][part] for run in runs]) for part in PARTS}
        for name in results[0].bound_m
    }
    return {
        "experiment": EXPERIMENT,
        "seeds": len(results),
        "rows": {
            name: {part: _spread([run["rows"][name][part] for run in runs]) for part in PARTS}
            for name in ROWS
        },
        "position_m": {part: _mean([run["position_m"][part] for run in runs]) for part in PARTS},
        "published": PUBLISHED,
        "bound": {
            **bound["start_prior"],
            "depth_prior": bound["depth_prior"],
            "what": "sqrt(2/pi) times the sum over the features of the least standard deviation of z (Cramer-Rao, "
            "linearised at the truth, all images so far, the estimators' priors on odometry and depth)",
        },
        "config": setup.model_dump(mode="json"),
        "runs": runs,
    }


def _mean(values: Sequence[float | None]) -> float | None:
    there = [v for v in values if v is not None]
    return float(np.mean(there)) if there else None


def _spread(values: Sequence[float | None]) -> dict[str, float | None]:
    """Mean and standard deviation over the runs in which the part is not empty."""
    there = [v for v in values if v is not None]
    sd = float(np.std(there, ddof=1)) if len(there) > 1 else None
    return {"mean": float(np.mean(there)) if there else None, "sd": sd}


def print_table(result: dict[str, Any]) -> None:
    """Print the rows beside the published figures."""
    _say("RMS over time of the sum over 48 features of |z error|, m: ours (SD over runs), published")
    _say(f"{'':20s} {'whole run':>24s} {'before learning':>24s} {'after learning':>24s}")
    for name, row in result["rows"].items():
        published = result["published"]["rows"].get(name)
        _say(f"{name:20s} " + " ".join(_cell(row[p], published and published[p]) for p in PARTS))
    for name, values in (("bound", result["bound"]), ("bound, depth prior", result["bound"]["depth_prior"])):
        _say(f"{name:20s} " + " ".join(_cell({"mean": values[p], "sd": None}, None) for p in PARTS))
    ours, print_ = result["position_m"], result["published"]["position_m"]
    _say("camera position, m   " + "; ".join(f"{p} {ours[p]:.3f} (published {print_[p]:.3f})" for p in PARTS))
    _say(f"{result['seeds']} seeds")


def _cell(entry: dict[str, float | None], published: float | None) -> str:
    mean, sd = entry["mean"], entry["sd"]
    if mean is None:
        return f"{'-':>24s}"
    words = f"{mean:.2f}" + ("" if sd is None else f" ({sd:.2f})")
    return f"{words + ('' if published is None else f', {published:.2f}'):>24s}"


def _say(line: str) -> None:
    sys.stdout.write(line + "\n")
