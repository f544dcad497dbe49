"""Real people (ETH/UCY): 3.2 s observed, 4.8 s predicted, the crowd's flow learned only from what was seen before.

| row | what |
| --- | --- |
| `constant_velocity` | the displacement between the last two samples goes on |
| `ekf` | constant-velocity Kalman filter over the eight samples, then its velocity |
| `flow_field` | others' mean velocity by place and direction, followed; own velocity only to begin with |
| `learned` | constant velocity plus how earlier people who were here and moved alike departed from it |
| `learned_own_velocity` | `learned`, constant velocity, own mean velocities over 2 and 7 steps; weights learned |

ADE is the mean distance over the 12 samples, FDE that at the last; windows are all runs of 20 consecutive samples.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from camnet.errors import DataError
from camnet.estimation.ekf import predict_covariances, update_position
from camnet.experiments.pedestrians_data import (
    FUTURE,
    OBSERVED,
    SAMPLE_S,
    Windows,
    experience_of,
    load,
    windows_of,
)
from camnet.experiments.pedestrians_flow import field_prediction, learned_deviation
from camnet.experiments.pedestrians_mix import better_so_far, mix
from camnet.report.experiments import write_pedestrians
from camnet.types import Array

__all__ = ["ROWS", "ekf", "predictions", "print_table", "run"]

EXPERIMENT = "pedestrians"
ROWS = ("constant_velocity", "ekf", "flow_field", "learned", "learned_own_velocity")
#: constant velocity as measured elsewhere: (ADE, FDE) in m
ELSEWHERE = {"biwi_hotel": (0.319, 0.614), "crowds_zara01": (0.427, 0.952)}
_HORIZON = np.arange(1.0, FUTURE + 1.0)[:, None]
#: noise of an annotated position (m), density of unknown acceleration (m^2/s^3), first uncertainty of the speed (m/s)
_EKF_NOISE_M, _EKF_PSD, _EKF_SPEED = 0.05, 0.5, 1.5


def _straight(windows: Windows, steps: int) -> Array:
    """Displacements (n, 12, 2) at the mean velocity over the last ``steps`` steps, m."""
    v = (windows.seen[:, -1] - windows.seen[:, -1 - steps]) / steps
    return np.asarray(v[:, None, :] * _HORIZON)


def ekf(windows: Windows) -> Array:
    """Displacements (n, 12, 2) from the last position seen, m; all windows share one sequence of gains."""
    cov = np.diag([_EKF_NOISE_M**2, _EKF_SPEED**2])
    p, v = windows.seen[:, 0], np.zeros_like(windows.seen[:, 0])
    for k in range(1, OBSERVED):
        cov, _ = predict_covariances(cov, np.eye(6), np.zeros(3), SAMPLE_S, _EKF_PSD, 1.0)
        p, v, cov = update_position(p + SAMPLE_S * v, v, cov, windows.seen[:, k], _EKF_NOISE_M**2)
    return np.asarray((p - windows.seen[:, -1])[:, None, :] + SAMPLE_S * v[:, None, :] * _HORIZON)


def predictions(path: Path) -> tuple[Windows, dict[str, Array]]:
    """Return the windows of one file and every row's displacements (n, 12, 2), m."""
    walkers = load(path)
    windows, known = windows_of(walkers), experience_of(walkers)
    straight = _straight(windows, 1)
    learned = straight + learned_deviation(windows, known)
    mixed = mix(windows, learned, (straight, _straight(windows, 2), _straight(windows, OBSERVED - 1)))
    return windows, {
        "constant_velocity": straight,
        "ekf": ekf(windows),
        "flow_field": field_prediction(windows, known),
        "learned": _guarded(windows, learned, straight),
        "learned_own_velocity": _guarded(windows, mixed, straight),
    }


def _guarded(windows: Windows, prediction: Array, fallback: Array) -> Array:
    better = better_so_far(windows, prediction, fallback)
    return np.asarray(np.where(better[:, None, None], prediction, fallback))


def _errors(windows: Windows, prediction: Array) -> dict[str, float]:
    distance = np.linalg.norm(prediction - windows.future, axis=2)
    return {"ade_m": float(distance.mean()), "fde_m": float(distance[:, -1].mean())}


def run(
    seeds: int = 1,
    out_dir: Path | str | None = None,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
    data: Path | str = ".",
) -> dict[str, Any]:
    """Predict every person of every ``*.txt`` file in ``data`` (or its folder ``ethucy``); nothing is random.

    Raises
    ------
    DataError
        If there is no such file.
    """
    folder = Path(data)
    files = sorted(folder.glob("*.txt")) or sorted((folder / "ethucy").glob("*.txt"))
    if not files:
        raise DataError(
            f"--data {folder}: holds no *.txt file; the folder of the ETH/UCY tracks was expected"
        )
    scenes: dict[str, dict[str, Any]] = {}
    for k, path in enumerate(files):
        windows, rows = predictions(path)
        scenes[path.stem] = {name: _errors(windows, rows[name]) for name in ROWS} | {
            "windows": len(windows.now)
        }
        if progress is not None:
            progress((k + 1) / len(files))
    if out_dir is not None:
        Path(out_dir).mkdir(parents=True, exist_ok=True)
        write_pedestrians(scenes, Path(out_dir) / "pedestrians.png")
    elsewhere = {name: {"ade_m": a, "fde_m": f} for name, (a, f) in ELSEWHERE.items()}
    return {
        "experiment": EXPERIMENT,
        "seeds": seeds,
        "observed": OBSERVED,
        "predicted": FUTURE,
        "scenes": scenes,
        "published": {"constant_velocity": elsewhere},
    }


def print_table(result: dict[str, Any]) -> None:
    """Print ADE / FDE by scene, and by how much each row's ADE differs from constant velocity's."""
    _say(f"{'ADE / FDE (m)':16s} {'windows':>8s}" + "".join(f"{name:>28s}" for name in ROWS))
    for scene, rows in result["scenes"].items():
        plain = rows["constant_velocity"]["ade_m"]
        cells = ""
        for name in ROWS:
            ade, fde = rows[name]["ade_m"], rows[name]["fde_m"]
            cells += f"{f'{ade:.3f} / {fde:.3f} ({100.0 * (ade / plain - 1.0):+.1f} %)':>28s}"
        _say(f"{scene:16s} {rows['windows']:8d}{cells}")


def _say(line: str) -> None:
    sys.stdout.write(line + "\n")
