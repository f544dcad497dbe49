"""Runs of the motion-learning experiment, one seed each: in two processes, kept on disk as they finish.

A seed's result is a file whose folder's name is a digest of the package's sources: a run that was stopped goes on where
it was, more seeds add to those there, and nothing of an older program is taken for a result.
"""

from __future__ import annotations

import logging
import math
import os
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from camnet.errors import DataError
from camnet.estimation.observation import measured_world_pose
from camnet.experiments.motion_learning_rows import Trace, build_rows, follow, score
from camnet.experiments.motion_learning_scene import Recording, SceneSettings, record
from camnet.geometry import rotations
from camnet.processes import Workers
from camnet.storage.archive import read_archive, write_archive
from camnet.storage.json_file import read_json
from camnet.storage.seal import seal_of
from camnet.storage.whole_file import write_json
from camnet.types import Array

__all__ = ["read_trace", "run_seed", "run_seeds", "trace_file"]

_LOG = logging.getLogger(__name__)
#: every how many frames a pose is kept for the figures
KEEP_EVERY = 6
WORKERS = 2


def trace_file(folder: Path, seed: int) -> Path:
    """Where the poses of one seed are kept for the figures."""
    return folder / f"seed-{seed}.npz"


def run_seed(seed: int, scene: SceneSettings, folder: Path | None, keep_trace: bool) -> dict[str, Any]:
    """Errors of every row for one seed, from ``folder`` if they are there already."""
    kept = None if folder is None else _kept(folder, seed, keep_trace)
    if kept is not None:
        return kept
    recording = record(scene, seed)
    rows = build_rows(recording, scene)
    traces = follow(recording, rows)
    result = {
        "seed": seed,
        "visible_share": float(np.mean([m is not None for m in recording.measurements])),
        "marker_found_share": _found_share(recording),
        "image_noise": image_noise(recording),
        "rows": {name: score(recording, trace) for name, trace in traces.items()},
        "diagnostics": {
            name: {k: v for k, v in row.diagnostics().items() if np.isfinite(v)} for name, row in rows.items()
        },
    }
    if folder is not None:
        if keep_trace:
            _write_trace(trace_file(folder, seed), recording, traces)
        write_json(_result_file(folder, seed), {**result, "seal": seal_of(result)})
    return result


def _found_share(recording: Recording) -> float:
    """Share of the frames looked at in which the marker was found."""
    return float(np.mean([recording.images[k] is not None for k in np.flatnonzero(recording.on)]))


def image_noise(recording: Recording) -> dict[str, float]:
    """Scatter of the poses read from images about the truth, calibration errors (constant in the camera) taken out."""
    away, turned = [], []
    for k, image in enumerate(recording.images):
        if image is not None:
            p, q = measured_world_pose(image)
            away.append(p - recording.p_world[k])
            turned.append(rotations.log(rotations.multiply(rotations.conjugate(recording.q_world[k]), q)))
    if not away:
        return {}
    steps = [np.diff(np.array(x), axis=0) for x in (away, turned)]
    # from frame to frame a constant error drops out, and white noise counts twice
    p_std, q_std = (float(np.sqrt(0.5 * np.mean(x**2))) for x in steps)
    p_far, q_far = (float(np.percentile(np.linalg.norm(x, axis=1), 99.9)) for x in steps)
    return {
        "position_std_m": p_std,
        "orientation_std_deg": math.degrees(q_std),
        "position_step_p999_m": p_far,
        "orientation_step_p999_deg": math.degrees(q_far),
    }


def _result_file(folder: Path, seed: int) -> Path:
    return folder / f"seed-{seed}.json"


def _kept(folder: Path, seed: int, with_trace: bool) -> dict[str, Any] | None:
    """Return the result of a seed that ran before; None, with a message if it is damaged, where it is to run again."""
    path = _result_file(folder, seed)
    if not os.path.lexists(path) or (with_trace and not os.path.lexists(trace_file(folder, seed))):
        return None
    try:
        content = read_json(path)
        seal = content.pop("seal", None) if isinstance(content, dict) else None
        if seal != seal_of(content) or content.get("seed") != seed:
            raise DataError(f"{path}: its content is not what was written (its seal does not fit)")
        if with_trace:
            read_trace(trace_file(folder, seed))
    except DataError as error:
        _LOG.warning("%s; seed %d is run again", error, seed)
        return None
    return dict(content)


def read_trace(path: Path) -> dict[str, Array]:
    """Return the poses kept of one seed (DataError: not what was written)."""
    archive = read_archive(path, "camnet traces", 1)
    return {name: np.asarray(array) for name, array in archive.arrays.items()}


def _write_trace(path: Path, recording: Recording, traces: Mapping[str, Trace]) -> None:
    """Truth and estimates at every `KEEP_EVERY`-th frame."""
    seen = np.array([m is not None for m in recording.measurements])
    arrays: dict[str, Any] = {"t_s": recording.t_s, "seen": seen}
    arrays |= {"truth.p_world": recording.p_world, "truth.q_world": recording.q_world}
    for name, trace in traces.items():
        arrays |= {f"{name}.p_world": trace.p_world, f"{name}.q_world": trace.q_world}
    shown = {name: np.asarray(value)[::KEEP_EVERY] for name, value in arrays.items()}
    write_archive(path, "camnet traces", 1, {}, shown)


def run_seeds(
    seeds: Sequence[int],
    scene: SceneSettings,
    folder: Path | None,
    progress: Callable[[float], None] | None,
    workers: int = WORKERS,
) -> list[dict[str, Any]]:
    """Results in the order of ``seeds``; the first seed's poses are kept for the figures.

    Each seed has its own generators, so results do not depend on how many processes share the work.
    """
    if folder is not None:
        folder.mkdir(parents=True, exist_ok=True)
    job = partial(_run_one, first=seeds[0], scene=scene, folder=folder)
    done: dict[int, dict[str, Any]] = {}
    with Workers(workers) as pool:
        for k, result in pool.finished(job, seeds):
            done[k] = result
            if progress is not None:
                progress(len(done) / len(seeds))
    return [done[k] for k in range(len(seeds))]


def _run_one(seed: int, first: int, scene: SceneSettings, folder: Path | None) -> dict[str, Any]:
    return run_seed(seed, scene, folder, keep_trace=seed == first)
