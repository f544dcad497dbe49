"""Figures and page of the distance-observer experiment (bell2019, figures 3-2 to 3-4, tables 3-1 to 3-3)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

from matplotlib.figure import Figure

from camnet.report.html import picture, table, write_page
from camnet.report.style import figure_style, save
from camnet.types import Array, BoolArray

__all__ = ["write_distance_observers"]

_COLOURS = {
    "estimator_1": "#c1121f",
    "estimator_2": "#cc79a7",
    "estimator_3": "#2a9d5c",
    "ekf": "#3a5ba0",
    "bundle": "#222222",
    "bundle_depth_prior": "#e0a526",
}
_PARTS = {"whole": "whole run", "before": "before learning", "after": "after learning"}


class _Run(Protocol):
    """What is drawn of one run; `camnet.experiments.distance_observers_run.RunResult` has it."""

    @property
    def t_s(self) -> Array: ...
    @property
    def error_m(self) -> Mapping[str, Array]: ...
    @property
    def bound_m(self) -> Mapping[str, Array]: ...
    @property
    def position_m(self) -> Array: ...
    @property
    def learned(self) -> BoolArray: ...
    @property
    def path(self) -> Array: ...


def write_distance_observers(runs: Sequence[_Run], result: Mapping[str, Any], folder: Path) -> None:
    """Write ``paths.png`` (figure 3-2), ``errors.png`` (3-3), ``position.png`` (3-4) and ``page.html``.

    Parameters
    ----------
    runs : results of the runs; errors over time are those of the first
    result : the summary with ``rows``, ``published``, ``bound``, ``position_m``
    folder : where to write; it is made if need be
    """
    folder.mkdir(parents=True, exist_ok=True)
    with figure_style():
        _paths(runs, folder / "paths.png")
        _errors(runs[0], folder / "errors.png")
        _position(runs[0], folder / "position.png")
    _page(result, folder)


def _paths(runs: Sequence[_Run], path: Path) -> None:
    figure = Figure(figsize=(6.0, 4.0), layout="constrained")
    axis = figure.subplots()
    for run in runs:
        axis.plot(*run.path.T, linewidth=0.8)
    axis.plot([0.0, 0.0], [-0.21, 0.21], color="black", linewidth=3.0, label="board")
    axis.set(xlabel="x (m)", ylabel="y (m)", aspect="equal", title="paths of the camera, from above")
    axis.legend()
    save(figure, path)


def _errors(run: _Run, path: Path) -> None:
    figure = Figure(figsize=(9.0, 4.5), layout="constrained")
    axis = figure.subplots()
    for name, values in run.error_m.items():
        axis.semilogy(run.t_s, values, color=_COLOURS[name], linewidth=0.9, label=name.replace("_", " "))
    for name, style in (("start_prior", ":"), ("depth_prior", "--")):
        axis.semilogy(
            run.t_s, run.bound_m[name], style, color="#777777", label=f"bound, {name.replace('_', ' ')}"
        )
    _mark_learned(axis, run)
    axis.set(xlabel="time (s)", ylabel="sum of |z error| over 48 features (m)")
    axis.yaxis.set_major_formatter("{x:g}")
    axis.legend(ncols=2, fontsize=8)
    save(figure, path)


def _position(run: _Run, path: Path) -> None:
    figure = Figure(figsize=(9.0, 3.0), layout="constrained")
    axis = figure.subplots()
    axis.plot(run.t_s, run.position_m, color=_COLOURS["estimator_2"], linewidth=0.9)
    _mark_learned(axis, run)
    axis.set(xlabel="time (s)", ylabel="camera position error (m)", title="estimator 2")
    save(figure, path)


def _mark_learned(axis: Any, run: _Run) -> None:  # noqa: ANN401 - matplotlib's axes
    if run.learned.any():
        axis.axvline(run.t_s[run.learned.argmax()], color="black", linewidth=0.8)


def _page(result: Mapping[str, Any], folder: Path) -> None:
    published = result["published"]["rows"]
    rows = []
    for name, row in result["rows"].items():
        cells = [_cell(row[p], published.get(name, {}).get(p)) for p in _PARTS]
        rows.append((name.replace("_", " "), *cells))
    bound = result["bound"]
    rows.append(("Cramer-Rao-type figure", *(bound[p] for p in _PARTS)))
    rows.append(("the same with the depth prior", *(bound["depth_prior"][p] for p in _PARTS)))
    ours, print_ = result["position_m"], result["published"]["position_m"]
    body = [
        "<h1>Distances to a checkerboard's corners (bell2019, section 3.4)</h1>",
        f"<p>Root mean square over time of the sum over 48 features of |z error|, m; means over {result['seeds']} "
        "runs; in small letters standard deviation and published figure. All rows are split at estimator 2's last "
        "tau_i.</p>",
        table(["", *_PARTS.values()], rows),
        "<h2>Camera position, m</h2>",
        table(["", *_PARTS.values()], [("ours", *ours.values()), ("published", *print_.values())]),
        *(picture(folder / name, name) for name in ("errors.png", "position.png", "paths.png")),
    ]
    write_page(folder / "page.html", "camnet: distance observers", "\n".join(body))


def _cell(entry: Mapping[str, float | None], published: float | None) -> str | None:
    if entry["mean"] is None:
        return None
    more = [] if entry["sd"] is None else [f"SD {entry['sd']:.2f}"]
    more += [] if published is None else [f"published {published:.2f}"]
    return f"{entry['mean']:.2f}" + ("\n" + ", ".join(more) if more else "")
