"""First experiment of parikh2018 (VII-A): a robot on a vector field, seen by a fixed camera, now and then.

The world is the simulator's (PyBullet, one fixed camera, pose sensing at 60 Hz). Root mean square errors after 200 s,
over on and off periods together, as published; a row's confidence interval is over the seeds (Student's t).

Why the row of the published settings differs from the published figures, as far as can be told from here: the field,
the marker's noise and the robot's slip are not the paper's; and in the stacked form a quaternion that is kept
continuous returns with the other sign after each turn, so its rates cannot be learned as a function of position (see
`motion_learning_published`). What our settings change is in `motion_learning_rows`.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy import stats

from camnet.errors import ConfigError
from camnet.experiments.kept_runs import digest
from camnet.experiments.motion_learning_rows import ROWS, SCORED_FROM_S
from camnet.experiments.motion_learning_runs import read_trace, run_seeds, trace_file
from camnet.experiments.motion_learning_scene import SceneSettings
from camnet.report.experiments import write_motion_learning

__all__ = ["EXPERIMENT", "PUBLISHED", "interval", "print_table", "run"]

EXPERIMENT = "motion-learning"
#: parikh2018, section VII-A
PUBLISHED = {
    "learned": {"position_rmse_m": 0.25, "orientation_rmse_deg": 24.4},
    "ideal": {"position_rmse_m": 0.03, "orientation_rmse_deg": 1.2},
    "ekf": {"position_rmse_m": 1.67, "orientation_rmse_deg": 57.5},
}
NOTES = {
    "sensing": "pose; rows *_image: images of a fiducial marker, found by OpenCV's ArUco, pose by PnP",
    "scored_from_s": SCORED_FROM_S,
    "learned_published": (
        "settings as published: one window of 0.1 s a second, stacked form, continuous quaternions. Differs from the "
        "published figures because field, marker noise and slip are ours, and because a continuous quaternion comes "
        "back with the other sign after every turn, so that its rates are no function of position"
    ),
    "learned_published_fixed_sign": (
        "the same with quaternions kept at q0 >= 0: one jump a turn, between which rates are learned"
    ),
}


def interval(values: Sequence[float], confidence: float = 0.95) -> dict[str, Any]:
    """Mean of a sample and the confidence interval of that mean (Student's t); without spread for one value."""
    sample = np.asarray(values, dtype=float)
    mean = float(sample.mean())
    if len(sample) < 2:
        return {"mean": mean, "ci95": [mean, mean]}
    half = float(
        stats.t.ppf(0.5 + 0.5 * confidence, len(sample) - 1) * sample.std(ddof=1) / np.sqrt(len(sample))
    )
    return {"mean": mean, "ci95": [mean - half, mean + half]}


def run(
    seeds: int = 10,
    out_dir: Path | str | None = None,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
    scene: SceneSettings | None = None,
) -> dict[str, Any]:
    """Run the experiment for ``seeds`` seeds from ``seed`` on; with ``out_dir`` also draw the figures there.

    Results of single seeds are kept beside ``out_dir`` in ``.motion-learning-seeds``.

    Raises
    ------
    ConfigError
        If ``seeds`` is not positive.
    """
    if seeds < 1:
        raise ConfigError(f"seeds: {seeds!r} is not a number of runs; give at least 1")
    scene = scene or SceneSettings()
    numbers = range(seed, seed + seeds)
    kept = None
    if out_dir is not None:
        kept = Path(out_dir).parent / f".{EXPERIMENT}-seeds" / digest(scene)
    results = run_seeds(numbers, scene, kept, progress)
    if out_dir is not None and kept is not None:
        Path(out_dir).mkdir(parents=True, exist_ok=True)
        write_motion_learning(read_trace(trace_file(kept, seed)), Path(out_dir), SCORED_FROM_S)
    rows = {
        name: {
            measure: interval([r["rows"][name][measure] for r in results])
            for measure in results[0]["rows"][name]
        }
        for name in ROWS
    }
    return {
        "experiment": EXPERIMENT,
        "seeds": seeds,
        "rows": rows,
        "published": PUBLISHED,
        "notes": NOTES,
        "runs": results,
    }


def print_table(result: dict[str, Any]) -> None:
    """Print the rows beside the published figures."""
    _say(f"{'':30s} {'position RMSE (m)':28s} {'orientation RMSE (deg)':28s} {'unseen (m)':>10s}   published")
    for name, row in result["rows"].items():
        position, orientation = row["position_rmse_m"], row["orientation_rmse_deg"]
        published = result["published"].get(name.replace("learned_published", "learned"), {})
        beside = (
            ""
            if name not in ("learned_published", "ideal", "ekf") or not published
            else "{position_rmse_m:g} m, {orientation_rmse_deg:g} deg".format(**published)
        )
        _say(
            f"{name:30s} {_with_interval(position):28s} {_with_interval(orientation):28s} "
            f"{row['position_rmse_unseen_m']['mean']:10.3f}   {beside}"
        )
    _say(f"{result['seeds']} seeds; 95 % confidence intervals of the means")


def _with_interval(entry: dict[str, Any]) -> str:
    low, high = entry["ci95"]
    return f"{entry['mean']:.3f}  [{low:.3f}, {high:.3f}]"


def _say(line: str) -> None:
    sys.stdout.write(line + "\n")
