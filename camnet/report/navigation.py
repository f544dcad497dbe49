"""Figures of the navigation experiment: what was flown and planned, from above and in height, and convergence."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse

from camnet.report.style import figure_style, save
from camnet.types import Array

__all__ = ["plot_convergence", "plot_voyage"]

_FLOWN, _PLANNED, _WAYPOINT, _OBSTACLE = "#14365d", "#c05fa8", "#56b4e9", "#a02c2c"


def _shadow(shape: Array, center: Array, plane: tuple[int, int], scale: float, **style: Any) -> Ellipse:  # noqa: ANN401 - style of the patch
    """Outline of an ellipsoid with shape matrix (3,3) (covariance-like) seen along the third axis."""
    part = shape[np.ix_(plane, plane)]
    values, vectors = np.linalg.eigh(part)
    angle = float(np.degrees(np.arctan2(vectors[1, 1], vectors[0, 1])))
    long, short = 2.0 * scale * np.sqrt(values[1]), 2.0 * scale * np.sqrt(values[0])
    return Ellipse((center[plane[0]], center[plane[1]]), long, short, angle=angle, **style)


def plot_voyage(
    flown: Array, plans: Sequence[Array], waypoints: Array, covariance: Array, rows: Array, path: Path
) -> None:
    """Draw one world from above and from the side.

    Parameters
    ----------
    flown : (n,3) path, m
    plans : some of the plans on the way, each (k,3)
    waypoints, covariance : (w,3) and (3,3); their two-sigma regions are drawn
    rows : (K,19) ellipsoids, packed as in `camnet.control.planner.distance_kernel`
    path : image file to write
    """
    with figure_style():
        figure = Figure(figsize=(10.0, 9.0), layout="constrained")
        FigureCanvasAgg(figure)
        axes = figure.subplots(2, 1, height_ratios=[2.0, 1.0])
        for axis, plane, label in zip(axes, ((0, 1), (0, 2)), ("y (m)", "z (m)"), strict=True):
            for k, plan in enumerate(plans):
                words = "plans, every tenth" if k == 0 else None
                axis.plot(
                    plan[:, plane[0]], plan[:, plane[1]], color=_PLANNED, lw=0.9, alpha=0.7, label=words
                )
            axis.plot(flown[:, plane[0]], flown[:, plane[1]], color=_FLOWN, lw=1.8, label="flown")
            for point in waypoints:
                axis.add_patch(_shadow(covariance, point, plane, 2.0, color=_WAYPOINT, alpha=0.5, lw=0))
            for row in rows:
                turn = row[7:16].reshape(3, 3)
                shape = turn @ np.diag(row[16:19] ** 2) @ turn.T
                axis.add_patch(_shadow(shape, row[1:4], plane, 1.0, color=_OBSTACLE, alpha=0.6, lw=0))
            axis.set(xlabel="x (m)", ylabel=label)
            axis.set_aspect("equal", adjustable="datalim")
        axes[0].set_title("Navigation: obstacles red, two-sigma regions of the waypoints blue")
        axes[0].legend()
        save(figure, path)


def plot_convergence(steps: Sequence[Sequence[Sequence[float]]], path: Path) -> None:
    """Largest move of a sample against the step of a re-plan, median and 95 % over all worlds.

    Parameters
    ----------
    steps : by world, by plan, the largest move (m) of every iteration
    path : image file to write
    """
    plans = [np.asarray(p) for world in steps for p in world if len(p)]
    longest = max(len(p) for p in plans)
    table = np.full((len(plans), longest), np.nan)
    for row, plan in zip(table, plans, strict=True):
        row[: len(plan)] = np.maximum(plan, 1e-6)
    with figure_style():
        figure = Figure(figsize=(9.0, 3.6), layout="constrained")
        FigureCanvasAgg(figure)
        left, right = figure.subplots(1, 2)
        number = np.arange(1, longest + 1)
        left.semilogy(number, np.nanmedian(table, axis=0), "o-", ms=3, label="median")
        left.semilogy(number, np.nanpercentile(table, 95, axis=0), "s-", ms=3, label="95 %")
        left.set(
            xlabel="step in a re-plan", ylabel="largest move of a sample (m)", title="re-plans still at work"
        )
        left.set_xticks(np.arange(1, longest + 1))
        left.legend()
        right.hist([len(p) for p in plans], bins=np.arange(0.5, longest + 1.5), color=_FLOWN)
        right.set(xlabel="steps in a re-plan", ylabel="re-plans", yscale="log", title="all re-plans")
        right.set_xticks(np.arange(1, longest + 1))
        save(figure, path)
