"""Figures and page of the moving-target experiment (bell2019, chapter 5)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from matplotlib.figure import Figure

from camnet.report.html import picture, table, write_page
from camnet.report.style import figure_style, save
from camnet.types import Array

__all__ = ["write_moving_target"]

_COLOURS = {
    "replay": "#222222",
    "velocity_field": "#2a9d5c",
    "acceleration": "#cc79a7",
    "constant_velocity": "#c1121f",
    "coordinated_turn": "#3a5ba0",
    "hold": "#999999",
}
_TITLES = {"same": "the same lap", "speed": "lap speed varied by 20 %", "branch": "a way that forks"}
_PARTS = {
    "gaps": "Gaps after the first lap",
    "first_lap": "Gaps in the first lap",
    "varied_speed": "Lap speed varied by 20 %, after the first lap",
    "branch": "A way that forks, after the first lap",
}


class _Gap(Protocol):
    """What is drawn of one gap; `camnet.experiments.moving_target_gaps.Gap` has it."""

    @property
    def span_s(self) -> float: ...
    @property
    def error_m(self) -> Mapping[str, float]: ...
    @property
    def truth(self) -> Array: ...
    @property
    def predicted(self) -> Array: ...


def write_moving_target(gaps: Mapping[str, Sequence[_Gap]], result: Mapping[str, Any], folder: Path) -> None:
    """Write ``gaps.png``, ``places.png`` and ``page.html``.

    Parameters
    ----------
    gaps : by way, the gaps after the first lap of all runs
    result : the summary
    folder : where to write; it is made if need be
    """
    folder.mkdir(parents=True, exist_ok=True)
    there = {way: some for way, some in gaps.items() if some}
    pictures = []
    if there:
        with figure_style():
            _errors(there, folder / "gaps.png")
            _places(there, folder / "places.png")
        pictures = [picture(folder / name, name) for name in ("gaps.png", "places.png")]
    _page(result, pictures, folder)


def _errors(gaps: Mapping[str, Sequence[_Gap]], path: Path) -> None:
    figure = Figure(figsize=(10.0, 3.6), layout="constrained")
    axes = figure.subplots(1, len(gaps), squeeze=False, sharey=True)[0]
    for axis, (way, some) in zip(axes, gaps.items(), strict=True):
        for name, colour in _COLOURS.items():
            if name in some[0].error_m:
                errors = np.sort([g.error_m[name] for g in some])
                share = np.arange(1, len(errors) + 1) / len(errors)
                axis.step(errors, share, where="post", color=colour, label=name.replace("_", " "))
        axis.set(xscale="log", xlabel="error at re-sighting (m)", title=_TITLES.get(way, way))
        axis.xaxis.set_major_formatter("{x:g}")
    axes[0].set_ylabel("share of the gaps")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=6, fontsize=8)
    save(figure, path)


def _places(gaps: Mapping[str, Sequence[_Gap]], path: Path) -> None:
    figure = Figure(figsize=(10.0, 3.8), layout="constrained")
    axes = figure.subplots(1, len(gaps), squeeze=False, sharey=True)[0]
    for axis, (way, some) in zip(axes, gaps.items(), strict=True):
        for gap in some:
            axis.plot(*np.array([gap.truth, gap.predicted]).T, color="#999999", linewidth=0.8)
        axis.plot(*np.array([g.truth for g in some]).T, "o", color="#3a5ba0", markersize=3, label="true")
        axis.plot(
            *np.array([g.predicted for g in some]).T, "x", color="#222222", markersize=4, label="replay"
        )
        axis.set(aspect="equal", xlabel="x (m)", title=_TITLES.get(way, way))
    axes[0].set_ylabel("y (m)")
    axes[0].legend(fontsize=8)
    save(figure, path)


def _page(result: Mapping[str, Any], pictures: Sequence[str], folder: Path) -> None:
    checks = [(r["what"], r["value"], r["limit"], r["reached"]) for r in result["acceptance"]]
    body = [
        "<h1>A target of unknown size, seen now and then (bell2019, chapter 5)</h1>",
        f"<p>{result['seeds']} seeds; the paper has no experiment for this chapter.</p>",
        table(["", "figure", "limit", "reached"], checks),
    ]
    for part, title in _PARTS.items():
        there = {k: v for k, v in result[part].items() if isinstance(v, dict) and "median_m" in v}
        rows = [(k.replace("_", " "), *v.values()) for k, v in there.items()]
        body += [f"<h2>{title}</h2>", table(["error at re-sighting", "median m", "90 % m", "gaps"], rows)]
    body += pictures
    seen = result["seen"]["by_noise"]
    names = {
        "position_m": "position, m",
        "velocity_mps": "velocity, m/s",
        "heading_deg": "heading, degrees",
        "velocity_chi_mps": "velocity by chi, corrected, m/s",
        "velocity_chi_printed_mps": "velocity by chi, as printed, m/s",
    }
    rows = [(words, *(row[key] for row in seen.values())) for key, words in names.items()]
    body += ["<h2>While in view, RMS</h2>", table(["", *seen], rows)]
    never = result["never_at_rest"]
    body += [
        "<h2>Targets that never rest</h2>",
        f"<p>Scale by no lateral slip: {_words(never['30s_pct'])} RMS in 30 s, {_words(never['150s_pct'])} in 150 s; "
        f"with a still camera {never['still_camera']}. From a size known to 1 cm {_words(never['known_size_pct'])}, "
        f"from a height known to 1 cm {_words(never['known_height_pct'])}.</p>",
    ]
    write_page(folder / "page.html", "camnet: moving target", "\n".join(body))


def _words(percent: float | None) -> str:
    return "no result" if percent is None else f"{percent:.2f} %"
