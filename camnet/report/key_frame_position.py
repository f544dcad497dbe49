"""Figures and page of the key-frame experiment (bell2019, figures 4-6, 4-7, 4-11 to 4-18)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from matplotlib.figure import Figure

from camnet.report.html import picture, table, write_page
from camnet.report.style import figure_style, save
from camnet.types import Array, BoolArray

__all__ = ["write_key_frame_position"]

_COLOURS = {
    "dead_reckoning": "#2a9d5c",
    "printed": "#3a5ba0",
    "augmented": "#e0a526",
    "augmented_reuse": "#222222",
}


class _Run(Protocol):
    """What is drawn of one run; `camnet.experiments.key_frame_position_run.PositionRun` has it."""

    @property
    def t_s(self) -> Array: ...
    @property
    def truth_m(self) -> Array: ...
    @property
    def path_m(self) -> Mapping[str, Array]: ...
    @property
    def error_m(self) -> Mapping[str, Array]: ...
    @property
    def landmark(self) -> BoolArray: ...
    @property
    def usable(self) -> BoolArray: ...


def write_key_frame_position(
    runs: Mapping[str, Mapping[str, Sequence[_Run]]], result: Mapping[str, Any], folder: Path
) -> None:
    """Write figures and ``page.html``.

    Parameters
    ----------
    runs : by case and gate, the runs; paths and errors over time are those of the first
    result : the summary with ``cases`` and ``published``
    folder : where to write; it is made if need be
    """
    folder.mkdir(parents=True, exist_ok=True)
    pictures = []
    with figure_style():
        for case, by_gate in runs.items():
            for gate, several in by_gate.items():
                name = f"{case}_{gate}"
                _paths(several[0], folder / f"paths_{name}.png")
                _errors(several[0], folder / f"errors_{name}.png")
                _histograms(result["cases"][case][gate]["key_frames"], folder / f"distances_{name}.png")
                pictures += [f"{kind}_{name}.png" for kind in ("paths", "errors", "distances")]
    _page(result, folder, pictures)


def _states(run: _Run) -> list[tuple[str, BoolArray, str]]:
    """Return states in the published colours: landmark in view red, predictor green, observer blue."""
    observer = run.usable & ~run.landmark
    return [
        ("predictor", np.asarray(~run.landmark & ~observer), "#2a9d5c"),
        ("observer", np.asarray(observer), "#3a5ba0"),
        ("landmark", run.landmark, "#c1121f"),
    ]


def _paths(run: _Run, path: Path) -> None:
    figure = Figure(figsize=(11.0, 4.5), layout="constrained")
    for axis, row in zip(figure.subplots(1, 2), ("printed", _best(run)), strict=True):
        axis.plot(*run.truth_m.T, color="black", linewidth=0.8, label="true")
        if row == "printed":
            for name, mask, colour in _states(run):
                axis.plot(*run.path_m[row][mask].T, ".", color=colour, markersize=1.0, label=name)
        else:
            axis.plot(
                *run.path_m[row].T, color=_COLOURS[row], linewidth=0.8, linestyle="--", label="estimated"
            )
        axis.set(xlabel="x (m)", ylabel="y (m)", aspect="equal", title=row.replace("_", " "))
        axis.legend(markerscale=6.0, fontsize=8)
    save(figure, path)


def _best(run: _Run) -> str:
    """Return the last of our rows that was run."""
    return [row for row in _COLOURS if row in run.path_m][-1]


def _errors(run: _Run, path: Path) -> None:
    figure = Figure(figsize=(9.0, 4.0), layout="constrained")
    axis = figure.subplots()
    for row, values in run.error_m.items():
        axis.plot(run.t_s, values, color=_COLOURS[row], linewidth=0.9, label=row.replace("_", " "))
    high = max(float(np.max(values)) for values in run.error_m.values())
    for name, mask, colour in _states(run)[1:]:
        axis.fill_between(
            run.t_s,
            0.0,
            0.03 * high,
            where=mask.tolist(),
            color=colour,
            linewidth=0.0,
            label=f"{name} (printed)",
        )
    axis.set(xlabel="time (s)", ylabel="position error (m)")
    axis.legend(ncols=2, fontsize=8)
    save(figure, path)


def _histograms(frames: Mapping[str, Any], path: Path) -> None:
    figure = Figure(figsize=(9.0, 3.0), layout="constrained")
    for axis, part in zip(figure.subplots(1, 2), ("before", "after"), strict=True):
        axis.hist(frames[f"{part}_all_pct"], bins=20, color="#3a5ba0")
        axis.set(xlabel="RMS distance error of a key frame (%)", title=f"{part} the dwell time")
    save(figure, path)


def _page(result: Mapping[str, Any], folder: Path, pictures: Sequence[str]) -> None:
    body = [
        "<h1>Camera position over long paths, landmark seen now and then (bell2019, section 4.6)</h1>",
        f"<p>Means over {result['seeds']} runs of {result['config']['world']['loops']} loops of 42.6 m; input: "
        f"{result['input']}. Published is one run of a robot over about 250 m; "
        "its odometry's errors are not known, so that its figures stand beside every case.</p>",
    ]
    for case, by_gate in result["cases"].items():
        for gate, part in by_gate.items():
            published = result["published"].get(gate, {"rows": {}, "key_frames": {}})
            body += _section(f"{case.replace('_', ' ')}, gate {gate}", part, published)
    body += [picture(folder / name, name) for name in pictures]
    write_page(folder / "page.html", "camnet: position by key frames", "\n".join(body))


def _section(title: str, part: Mapping[str, Any], published: Mapping[str, Any]) -> list[str]:
    rows = []
    for row, cells in part["rows"].items():
        print_ = published["rows"].get(row, {})
        interval = cells["rms_m"]["ci95"]
        rows.append(
            (
                row.replace("_", " "),
                cells["rms_m"]["mean"],
                None if interval is None else f"{interval[0]:.3f} to {interval[1]:.3f}",
                cells["after_first_loop_m"]["mean"],
                cells["max_m"],
                print_.get("rms_m"),
                print_.get("max_m"),
            )
        )
    names = {
        "passed_share": "share that pass",
        "whole_pct": "distance error, %",
        "before_pct": "before the dwell time, %",
        "after_pct": "after it, %",
        "after_median_pct": "after it, median, %",
    }
    frames = [
        (words, part["key_frames"][key], published["key_frames"].get(key)) for key, words in names.items()
    ]
    off = part["key_frames"]["off_view"]
    frames.append(("features out of view that were predicted", off["count"], None))
    frames.append(("of these beyond the sound bound", off["broken"], None))
    head = ["", "RMS, m", "95 % interval", "after the first loop, m", "mean of the loops' largest, m"]
    return [
        f"<h2>{title}</h2>",
        table([*head, "published RMS", "published largest"], rows),
        table(["key frames", "ours", "published"], frames),
    ]
