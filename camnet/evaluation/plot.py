"""Scores at a glance: a point and its 95 % interval for every agent, one panel a figure."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from camnet.evaluation.scores import METRICS
from camnet.report.style import FILTER_COLOURS, figure_style, save

__all__ = ["draw_scores"]

_PANELS = ("return", "time_in_view", "handoff_success", "position_rmse_unseen_m")
_WORDS = {
    "return": "return",
    "time_in_view": "share of time in view",
    "handoff_success": "handoffs completed / attempted",
    "position_rmse_unseen_m": "RMSE while unseen (m)",
}


def draw_scores(path: Path, entry: dict[str, Any], reference: str) -> None:
    """Draw one world's scores: agents from the best return down, the reference with a line through it.

    Parameters
    ----------
    path : where the picture goes
    entry : one of ``worlds`` of `camnet.evaluation.evaluate.evaluate`
    reference : agent that the others are compared with
    """
    agents = sorted(entry["agents"], key=lambda a: float(entry["agents"][a]["return"]["mean"]))
    with figure_style():
        figure = Figure(figsize=(10.5, 1.2 + 0.32 * len(agents)), layout="constrained")
        panels = figure.subplots(1, len(_PANELS), sharey=True)
        for axes, name in zip(panels, _PANELS, strict=True):
            _panel(axes, entry, agents, name, reference)
        panels[0].set_yticks(range(len(agents)), [Path(a).name for a in agents])
        figure.suptitle(
            f"{entry['world']}, {entry['episodes']} episodes: mean and 95 % interval", fontsize=10
        )
        save(figure, path)


def _panel(axes: Axes, entry: dict[str, Any], agents: list[str], name: str, reference: str) -> None:
    """Draw one figure of all agents."""
    for row, agent in enumerate(agents):
        figure, colour = entry["agents"][agent][name], FILTER_COLOURS.get(agent, "#666666")
        if figure is None:
            continue
        mean, (low, high) = figure["mean"], figure["ci95"]
        axes.plot([low, high], [row, row], color=colour, linewidth=3, solid_capstyle="butt", alpha=0.5)
        axes.plot(mean, row, "o", color=colour, markersize=5)
        if agent == reference:
            axes.axvline(mean, color=colour, linewidth=0.8, linestyle=":")
    means = [f["mean"] for f in (entry["agents"][a][name] for a in agents) if f is not None]
    if name == "position_rmse_unseen_m" and means and max(means) > 20.0 * float(np.median(means)):
        axes.set_xscale("symlog", linthresh=0.1)
    else:
        axes.locator_params(axis="x", nbins=4)
    better = "more" if METRICS[name].more_is_better else "less"
    axes.set_xlabel(f"{_WORDS[name]}\n({better} is better)")
    axes.grid(axis="y", visible=False)
