"""``estimates.png``: states and errors of every estimator over time, shaded where nobody sees the target."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from camnet.geometry.rotations import angle_between, yaw_of
from camnet.report.run_data import RunData, spans
from camnet.report.style import FILTER_COLOURS, FILTER_LABELS, UNSEEN, figure_style, plain_ticks, save
from camnet.types import Array, BoolArray

__all__ = ["write_estimates"]


def write_estimates(run: RunData, path: Path) -> None:
    """Plot x, y, heading, position error and orientation error of the first target over time."""
    target = run.targets[0]
    with figure_style():
        figure = Figure(figsize=(12, 10))
        axes = figure.subplots(5, 1, sharex=True, gridspec_kw={"hspace": 0.12})
        seen: BoolArray = np.asarray(run.columns[f"{target}.seen_by"] >= 0)
        for a in axes:
            for start, end in spans(run.t_s, ~seen):
                a.axvspan(start, end, color=UNSEEN, zorder=0, linewidth=0)
        _states(axes, run, target)
        _errors(axes[3], axes[4], run, target)
        handles, labels = axes[0].get_legend_handles_labels()
        handles.append(Patch(color=UNSEEN))
        figure.legend(
            handles, [*labels, "nobody sees it"], loc="upper center", ncols=6, bbox_to_anchor=(0.5, 0.93)
        )
        axes[-1].set_xlabel("time (s)")
        axes[-1].set_xlim(run.t_s[0], run.t_s[-1])
        save(figure, path)


def _states(axes: Array, run: RunData, target: str) -> None:
    truth, yaw = run.vector(target), np.degrees(yaw_of(run.quaternion(target)))
    for axis, name in enumerate(("x (m)", "y (m)")):
        axes[axis].plot(run.t_s, truth[:, axis], color="black", linewidth=1.4, label="true")
        axes[axis].set_ylabel(name)
    axes[2].plot(run.t_s, yaw, ".", color="black", markersize=1.5)
    axes[2].set(ylabel="heading (deg)", ylim=(-185, 185), yticks=(-180, -90, 0, 90, 180))
    for name in run.filters:
        estimate = run.vector(f"{target}.{name}")
        style = {"color": FILTER_COLOURS[name], "linewidth": 0.9}
        for axis in range(2):
            axes[axis].plot(run.t_s, estimate[:, axis], label=FILTER_LABELS[name], **style)
        heading = np.degrees(yaw_of(run.quaternion(f"{target}.{name}")))
        axes[2].plot(run.t_s, heading, ".", color=FILTER_COLOURS[name], markersize=1.2)
    low, high = truth[:, :2].min(axis=0) - 1.0, truth[:, :2].max(axis=0) + 1.0
    for axis in range(2):
        axes[axis].set_ylim(low[axis], high[axis])


def _errors(position: Axes, orientation: Axes, run: RunData, target: str) -> None:
    truth, q_true = run.vector(target), run.quaternion(target)
    for name in run.filters:
        who = f"{target}.{name}"
        distance = np.linalg.norm(run.vector(who) - truth, axis=1)
        angle = np.degrees(angle_between(run.quaternion(who), q_true))
        colour = FILTER_COLOURS[name]
        position.semilogy(run.t_s, np.maximum(distance, 1e-4), color=colour, linewidth=0.9)
        orientation.semilogy(run.t_s, np.maximum(angle, 1e-2), color=colour, linewidth=0.9)
    plain_ticks(position)
    plain_ticks(orientation)
    position.set_ylabel("position error (m)")
    orientation.set_ylabel("orientation\nerror (deg)")
