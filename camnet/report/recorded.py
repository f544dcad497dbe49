"""Pictures and page of a recorded network: ``map.png``, ``errors.png``, ``report.html``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from camnet.report.html import picture, table, write_page
from camnet.report.markup import shown
from camnet.report.style import CAMERA_COLOURS, FILTER_COLOURS, figure_style, save
from camnet.types import Array, BoolArray

__all__ = ["MapData", "write_error_curves", "write_recorded_map", "write_recorded_report"]

_COLOURS = {**FILTER_COLOURS, "last_seen": "#777777"}
_LABELS = {"learned": "learned", "ekf": "EKF, constant velocity", "last_seen": "last seen place"}


class MapData(Protocol):
    """What a map needs; all in metres in the local frame (see `camnet.experiments.recorded.RecordedMap`)."""

    @property
    def cameras(self) -> tuple[str, ...]:
        """Names of the C cameras."""

    @property
    def camera_p_world(self) -> Array:
        """Optical centres (C, 3)."""

    @property
    def footprints(self) -> Sequence[Sequence[Array]]:
        """Outlines (n, 2) of the ground that each camera sees."""

    @property
    def fixes(self) -> Array:
        """All recorded fixes (n, 2)."""

    @property
    def seen(self) -> BoolArray:
        """Which of them a camera saw (n,)."""

    @property
    def entries(self) -> Array:
        """Places of re-sighting (gaps, 2)."""

    @property
    def predicted(self) -> Array:
        """Where the learned model expected them (gaps, 2)."""


def write_recorded_map(data: MapData, path: Path) -> None:
    """Draw views, fixes and, for every gap, a line from the predicted to the actual place of re-sighting."""
    with figure_style():
        figure = Figure(figsize=(10, 9))
        axes = figure.add_subplot()
        for mask, colour, words in ((~data.seen, "#b9b3a5", "unseen"), (data.seen, "#4a4a4a", "seen")):
            axes.plot(*data.fixes[mask].T, ".", color=colour, markersize=0.6, label=f"recorded fix, {words}")
        for k, (name, p_world) in enumerate(zip(data.cameras, data.camera_p_world, strict=True)):
            colour = CAMERA_COLOURS[k % len(CAMERA_COLOURS)]
            for outline in data.footprints[k]:
                axes.add_patch(Polygon(outline, facecolor=colour, edgecolor=colour, alpha=0.22, zorder=2))
            axes.plot(*p_world[:2], marker="s", color=colour, markersize=5, zorder=4)
            axes.annotate(
                name, p_world[:2], textcoords="offset points", xytext=(5, 5), color=colour, zorder=5
            )
        lines = list(np.stack([data.predicted, data.entries], axis=1))
        axes.add_collection(
            LineCollection(lines, colors=_COLOURS["learned"], linewidths=0.4, alpha=0.12, zorder=3)
        )
        axes.plot([], [], color=_COLOURS["learned"], linewidth=0.8, label="predicted to actual re-sighting")
        watched = np.concatenate([outline for outlines in data.footprints for outline in outlines])
        low, high = watched.min(axis=0) - 40.0, watched.max(axis=0) + 40.0
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), xlabel="east (m)", ylabel="north (m)")
        axes.set_aspect("equal")
        legend = axes.legend(loc="upper left", markerscale=12)
        legend.set_zorder(6)
        save(figure, path)


def write_error_curves(errors_m: Mapping[str, Array], path: Path) -> None:
    """Plot, for each predictor, the share of gaps whose error at re-sighting is below a distance."""
    with figure_style():
        figure = Figure(figsize=(7.5, 4.6))
        axes = figure.add_subplot()
        for name, errors in errors_m.items():
            ordered = np.sort(errors)
            share = (np.arange(len(ordered)) + 1) / len(ordered)
            label = f"{_LABELS.get(name, name)} (median {np.median(errors):.1f} m)"
            axes.step(ordered, share, color=_COLOURS.get(name), where="post", label=label)
        axes.axhline(0.5, color="#bbbbbb", linewidth=0.8, linestyle="--")
        axes.set(xlim=(0, 100), ylim=(0, 1), xlabel="error at re-sighting (m)", ylabel="share of gaps")
        axes.legend(loc="lower right")
        save(figure, path)


def write_recorded_report(folder: Path, title: str, words: str, summary: dict[str, Any]) -> None:
    """Write the page of a recorded run whose pictures lie in ``folder`` already."""
    gaps = summary["gaps"]
    accuracy = gaps["next_camera_accuracy"]
    names = [name for name in ("learned", "ekf", "last_seen") if name in gaps]
    rows = [
        [_LABELS[n], gaps[n]["median_error_m"], gaps[n]["p90_error_m"], f"{accuracy[n]:.1%}"] for n in names
    ]
    head = ("predictor", "median error (m)", "90 % below (m)", "next camera right")
    parts = [
        f"<h1>{shown(title)}</h1><p>{shown(words)}</p>",
        f"<p>{shown(gaps['count'])} gaps: a person leaves every view and is seen again. Each prediction uses only what "
        "cameras saw before the person left.</p>",
        table(head, rows),
        picture(folder / "errors.png", "share of gaps below an error"),
        "<h2>The site</h2>",
        picture(folder / "map.png", "map of views and re-sightings"),
        "<h2>The recording</h2>",
        table(("quantity", "value"), list(summary["recording"].items())),
    ]
    write_page(folder / "report.html", f"camnet: {title}", "\n".join(parts))
