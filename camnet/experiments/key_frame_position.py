"""A camera's position over long paths with a landmark now and then (bell2019, section 4.6; figures 4-6 to 4-18).

Three cases of odometry errors (`key_frame_setup.CASES`), each with the gates at 3 and at 10 pixels; one set-up
(`key_frame_setup.SetUp`) for all. ``augmented`` includes the visual rotation of key frames.

Where ours differ from print: corners are simulated points with a drift that is chosen so that about as many key frames
pass their dwell time as published; relative poses are refined about the expected one instead of averaged over several
decompositions; the gains of the pose observer are not published and are 3 /s.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import t as student

from camnet.errors import ConfigError
from camnet.estimation.structure.key_frames.augmented_filter import FilterRun
from camnet.estimation.structure.odometry import OdometryErrors
from camnet.experiments.kept_runs import KeptRuns
from camnet.experiments.key_frame_images import RenderedKeyFrames, image_setup
from camnet.experiments.key_frame_position_run import ROWS, KeyFrameSummary, PositionRun, run_scene
from camnet.experiments.key_frame_setup import CASES, SetUp, make_scene
from camnet.experiments.key_frame_tracks import SimulatedKeyFrames, TrackedKeyFrame
from camnet.geometry.pinhole import Pinhole
from camnet.processes.place import LOCAL, Place
from camnet.report.key_frame_position import write_key_frame_position

__all__ = ["EXPERIMENT", "PUBLISHED", "print_table", "run"]

EXPERIMENT = "key-frame-position"
#: share of the work that is drawing, where images are drawn
_DRAWING = 0.8
#: bell2019, section 4.6: one run of 560 s; distance errors of the key frames that passed
PUBLISHED: Mapping[str, Any] = {
    "3px": {
        "rows": {
            "dead_reckoning": {"rms_m": 0.63, "max_m": 1.09},
            "printed": {"rms_m": 0.58, "max_m": 1.0},
        },
        "key_frames": {
            "passed_share": 83.0 / 246.0, "whole_pct": 15.6, "before_pct": 19.4, "after_pct": 4.2,
            "after_median_pct": 3.4,
        },
    },
    "10px": {
        "rows": {
            "dead_reckoning": {"rms_m": 0.63, "max_m": 1.09},
            "printed": {"rms_m": 0.65, "max_m": 1.21},
        },
        "key_frames": {"passed_share": 147.0 / 246.0, "after_pct": 6.6, "after_median_pct": 5.5},
    },
}  # fmt: skip


def run(
    seeds: int = 5,
    out_dir: Path | str | None = None,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
    setup: SetUp | None = None,
    images: bool = False,
    jobs: int = 2,
    place: Place = LOCAL,
) -> dict[str, Any]:
    """Run every case for ``seeds`` seeds from ``seed`` on; with ``out_dir`` also write figures and a page there.

    With ``images`` corners are found and followed in rendered images of two loops (`key_frame_images`), without map
    reuse: nothing recognises a place in them. Runs are kept beside ``out_dir`` (`kept_runs`); ``jobs`` workers of
    ``place`` do them.

    Raises
    ------
    ConfigError
        If ``seeds`` is not positive.
    """
    if seeds < 1:
        raise ConfigError(f"seeds: {seeds!r} is not a number of runs; give at least 1")
    setup = setup or (image_setup(SetUp()) if images else SetUp())
    numbers = range(seed, seed + seeds)
    drawn = _drawn(setup, numbers, out_dir, progress) if images else {}
    tasks = [_Job(case, number, drawn.get(number)) for case in CASES for number in numbers]
    runs = KeptRuns(EXPERIMENT, setup, _one, [PositionRun, KeyFrameSummary, FilterRun])
    share = _DRAWING if images else 0.0
    found = runs.results(tasks, _name, out_dir, _part(progress, share, 1.0), jobs, place)
    results: dict[str, dict[str, list[PositionRun]]] = {case: {} for case in CASES}
    for job, by_gate in zip(tasks, found, strict=True):
        for gate, one in by_gate.items():
            results[job.case].setdefault(gate, []).append(one)
    content = {
        "experiment": EXPERIMENT,
        "seeds": seeds,
        "input": "rendered images" if images else "simulated tracks",
        "cases": {
            case: {gate: summary(runs) for gate, runs in by_gate.items()} for case, by_gate in results.items()
        },
        "published": PUBLISHED,
        "config": setup.model_dump(mode="json"),
    }
    if out_dir is not None:
        write_key_frame_position(results, content, Path(out_dir))
    return content


class _Job(NamedTuple):
    """A case with one seed; ``drawn`` stands for simulated tracks."""

    case: str
    seed: int
    drawn: list[TrackedKeyFrame] | None


def _one(setup: SetUp, job: _Job) -> dict[str, PositionRun]:
    return run_case(setup, job.case, job.seed, drawn=job.drawn)


def _name(job: _Job) -> str:
    return f"{job.case}-{job.seed}" + ("" if job.drawn is None else "-images")


def _drawn(
    setup: SetUp, numbers: Sequence[int], out_dir: Path | str | None, progress: Callable[[float], None] | None
) -> dict[int, list[TrackedKeyFrame]]:
    """Key frames read from rendered images, by seed."""
    drawing = KeptRuns(EXPERIMENT, setup, draw_key_frames, [TrackedKeyFrame])
    found = drawing.results(numbers, "drawn-{}".format, out_dir, _part(progress, 0.0, _DRAWING))
    return dict(zip(numbers, found, strict=True))


def _part(
    progress: Callable[[float], None] | None, start: float, end: float
) -> Callable[[float], None] | None:
    """Return what is to be told of the shares of a part of the work."""
    return None if progress is None else lambda share: progress(start + (end - start) * share)


def run_case(
    setup: SetUp,
    case: str,
    seed: int,
    progress: Callable[[float], None] | None = None,
    drawn: list[TrackedKeyFrame] | None = None,
) -> dict[str, PositionRun]:
    """Run a case once; results by the name of the gate, such as ``3px``; ``drawn`` stands for simulated tracks."""
    scene_rng, tracks_rng, rng = np.random.default_rng(seed).spawn(3)
    scene = make_scene(setup.world, CASES[case], scene_rng)
    if drawn is not None:
        return _named(setup, run_scene(setup, scene, drawn, rng, None, progress))
    camera = Pinhole.from_settings(setup.world.camera)
    tracks = SimulatedKeyFrames(
        scene.points_world, scene.truth, camera, setup.key_frames, setup.noise, tracks_rng
    )
    return _named(setup, run_scene(setup, scene, tracks, rng, tracks.visible, progress))


def _named(setup: SetUp, runs: Mapping[float, PositionRun]) -> dict[str, PositionRun]:
    """Name gates in pixels of the full resolution, at which the focal length is the default."""
    full = SetUp().world.camera.fx_px / setup.world.camera.fx_px
    return {f"{full * gate:.4g}px": one for gate, one in runs.items()}


def draw_key_frames(setup: SetUp, seed: int) -> list[TrackedKeyFrame]:
    """Key frames read from rendered images; the path is the same for all cases."""
    scene_rng, _, _ = np.random.default_rng(seed).spawn(3)
    scene = make_scene(setup.world, OdometryErrors(), scene_rng)
    return list(RenderedKeyFrames(setup, scene, np.random.default_rng([seed, 1])))


def summary(runs: Sequence[PositionRun]) -> dict[str, Any]:
    """Figures of one case and gate."""
    rows: dict[str, Any] = {}
    for row in (name for name in ROWS if name in runs[0].error_m):
        rows[row] = {
            "rms_m": _mean([r.rms(row) for r in runs]),
            "max_m": float(np.mean([r.maximum(row) for r in runs])),
            "after_first_loop_m": _mean([r.rms_after_first_loop(row) for r in runs]),
        }
    frames = [k for r in runs for k in r.key_frames]
    passed = [k for k in frames if k.usable]
    turns = [(k.turn_error, k.turn_sd) for k in frames]
    return {
        "rows": rows,
        "key_frames": {
            "count": len(frames) / len(runs),
            "passed_share": len(passed) / len(frames),
            "whole_pct": _average([k.whole_pct for k in passed]),
            "before_pct": _average([k.before_pct for k in passed]),
            "after_pct": _average([k.after_pct for k in passed]),
            "after_median_pct": float(np.median([k.after_pct for k in passed])) if passed else None,
            "after_all_pct": [k.after_pct for k in passed],
            "before_all_pct": [k.before_pct for k in passed],
            "active_share": float(np.mean([np.mean(r.usable) for r in runs])),
            "turn_rms_mrad": 1e3 * float(np.sqrt(np.mean([e * e for e, _ in turns]))),
            "off_view": {
                "count": sum(k.off_view for k in frames),
                "broken": sum(k.off_view_broken for k in frames),
                "largest_share": max((k.off_view_share for k in frames if k.off_view), default=None),
            },
            "turn_nis": float(np.mean([(e / sd) ** 2 for e, sd in turns])),
        },
    }


def _average(values: Sequence[float]) -> float | None:
    there = [v for v in values if math.isfinite(v)]
    return float(np.mean(there)) if there else None


def _mean(values: Sequence[float]) -> dict[str, Any]:
    """Mean and its 95 % interval by Student's t; no interval of one run."""
    there = [v for v in values if math.isfinite(v)]
    if not there:
        return {"mean": None, "ci95": None}
    mean = float(np.mean(there))
    if len(there) < 2:
        return {"mean": mean, "ci95": None}
    half = float(student.ppf(0.975, len(there) - 1) * np.std(there, ddof=1) / math.sqrt(len(there)))
    return {"mean": mean, "ci95": [mean - half, mean + half]}


def print_table(result: dict[str, Any]) -> None:
    """Print the rows beside the published figures."""
    _say(
        "position RMS, m (95 % interval of the mean over runs); largest error of a loop, m; RMS after the first loop"
    )
    for case, by_gate in result["cases"].items():
        for gate, part in by_gate.items():
            published = result["published"].get(gate, {"rows": {}, "key_frames": {}})
            _say(f"{case}, gate {gate}")
            for row, cells in part["rows"].items():
                print_ = published["rows"].get(row)
                beside = (
                    "" if print_ is None else f"   published {print_['rms_m']:.2f}; {print_['max_m']:.2f}"
                )
                _say(
                    f"  {row:16s} {_cell(cells['rms_m'])}; {cells['max_m']:.2f}; "
                    f"{_cell(cells['after_first_loop_m'])}{beside}"
                )
            frames, print_ = part["key_frames"], published["key_frames"]
            _say(
                f"  key frames       {frames['count']:.0f}, {100.0 * frames['passed_share']:.0f} % pass; "
                f"distance error {_number(frames['before_pct'])} % before, {_number(frames['after_pct'])} % after"
                + (f"   published {_shares(print_)}" if print_ else "")
            )
            off = frames["off_view"]
            share = None if off["largest_share"] is None else 100.0 * off["largest_share"]
            _say(
                f"  out of view      {off['count']} features predicted; sound bound of the error's growth broken by "
                f"{off['broken']}, at most {_number(share)} % of it reached"
            )
    _say(f"{result['seeds']} seeds")


def _shares(print_: Mapping[str, float]) -> str:
    before = f"{print_['before_pct']:.1f} % before, " if "before_pct" in print_ else ""
    return f"{100.0 * print_['passed_share']:.0f} % pass; {before}{print_['after_pct']:.1f} % after"


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.1f}"


def _cell(entry: Mapping[str, Any]) -> str:
    if entry["mean"] is None:
        return "-"
    interval = "" if entry["ci95"] is None else f" ({entry['ci95'][0]:.3f} to {entry['ci95'][1]:.3f})"
    return f"{entry['mean']:.3f}{interval}"


def _say(line: str) -> None:
    sys.stdout.write(line + "\n")
