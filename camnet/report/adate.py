"""Figures of the trajectory estimation experiment: tracks and error over time (li2019, figures 3 and 4)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from camnet.storage.whole_file import whole_file

__all__ = ["plot_error_over_time", "plot_tracks"]

_SHOWN = ("AdaTE-PLS", "EKF-CA", "UKF-PLS", "MAP-CT")


def _sheet(title: str) -> tuple[Figure, list[Any]]:
    figure = Figure(figsize=(15.0, 9.0), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(2, 3)
    figure.suptitle(title)
    return figure, list(axes.ravel())


def plot_tracks(data: Mapping[str, Mapping[str, Any]], path: Path) -> None:
    """Truth, observations and smoothed tracks of one draw of every group, seen from above.

    Parameters
    ----------
    data : for each group ``truth`` (n,3), ``observations`` (n,m,3), ``seen`` (n,) and ``tracks`` by method, each with
        ``smoothed`` (n,3), all in m
    path : image file to write
    """
    figure, axes = _sheet("Estimated tracks")
    for axis, (name, group) in zip(axes, data.items(), strict=False):
        seen = group["observations"][group["seen"]]
        for j in range(seen.shape[1]):
            colour = "tab:red" if j == 0 else "0.6"
            axis.plot(seen[:, j, 0], seen[:, j, 1], ".", ms=1.5, color=colour, alpha=0.35, zorder=0)
        axis.plot(*group["truth"][:, :2].T, "k-", lw=2.5, label="truth")
        for method in _SHOWN:
            if method in group["tracks"]:
                axis.plot(*group["tracks"][method].smoothed[:, :2].T, lw=1.2, label=method)
        low, high = group["truth"][:, :2].min(axis=0), group["truth"][:, :2].max(axis=0)
        centre, half = 0.5 * (low + high), 0.55 * float((high - low).max()) + 20.0
        axis.set(title=name.replace("_", ", "), xlabel="x (m)", ylabel="y (m)", aspect="equal")
        axis.set_xlim(centre[0] - half, centre[0] + half)
        axis.set_ylim(centre[1] - half, centre[1] + half)
    axes[0].legend(fontsize=8)
    with whole_file(path) as temporary:
        figure.savefig(temporary, dpi=110)


def plot_error_over_time(data: Mapping[str, Mapping[str, Any]], path: Path) -> None:
    """Normalised error of the trajectory so far against time, by method.

    Parameters
    ----------
    data : for each group ``scale_m`` (RMSE of the observations) and ``tracks`` by method, each with
        ``error_so_far`` (n,)
    path : image file to write
    """
    figure, axes = _sheet("RMSE of the trajectory so far / RMSE of the observations")
    for axis, (name, group) in zip(axes, data.items(), strict=False):
        for method, track in group["tracks"].items():
            value = track.error_so_far / group["scale_m"]
            axis.plot(
                np.arange(1, len(value) + 1), value, lw=2.0 if method == "AdaTE-PLS" else 1.0, label=method
            )
        gaps = np.flatnonzero(~group["seen"])
        if len(gaps):
            axis.axvspan(gaps[0] + 1, gaps[-1] + 1, color="0.9", zorder=0)
        axis.set(title=name.replace("_", ", "), xlabel="step", yscale="log")
        axis.grid(alpha=0.3)
    axes[0].legend(fontsize=8)
    with whole_file(path) as temporary:
        figure.savefig(temporary, dpi=110)
