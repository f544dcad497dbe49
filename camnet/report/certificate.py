"""The report of a certificate: ``map.png`` and ``report.html`` with a map whose lines tell their margins."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Polygon

from camnet.report.certificate_map import (
    CAMERA,
    SOLID,
    VERDICT_COLOURS,
    VIEW,
    MapLine,
    aims,
    map_frame,
    svg_map,
)
from camnet.report.certificate_text import page_head, page_tail
from camnet.report.html import table, write_page
from camnet.report.style import figure_style, save
from camnet.types import Array

__all__ = ["VERDICT_COLOURS", "MapLine", "learned_table", "unseen_table", "write_certificate"]

_LEGEND = {
    "certified": "unseen, within what is allowed",
    "not certified": "unseen for too long",
    "unsatisfiable": "cannot be certified",
    "seen": "ways",
}
_ARROW = {"arrowstyle": "->", "color": CAMERA, "linewidth": 1.4}
#: pages list at most this many transitions; the JSON file has all of them
_MOST_ROWS = 500


def write_certificate(
    folder: Path,
    report: dict[str, Any],
    views: Sequence[tuple[str, Array]],
    lines: Sequence[MapLine],
    solids: Sequence[tuple[str, Array]] = (),
    design: Sequence[str] = (),
) -> None:
    """Write map and page of a report into ``folder``; ``views`` and ``solids`` are names and outlines (K, 2), m.

    ``design`` is what the page says of a design, as HTML, between the transitions and the cameras.
    """
    _write_map(folder / "map.png", report, views, lines, solids)
    title = str(report["network"].get("name", "certificate"))
    body = [*page_head(report, title), svg_map(views, lines, solids, report.get("cameras") or ())]
    shown_rows = report["transitions"][:_MOST_ROWS]
    if shown_rows:
        body += ["<h2>From view to view</h2>", table(*unseen_table(shown_rows))]
    if any("learned" in t for t in shown_rows):
        body += ["<h2>Whether the estimate survives it: learned</h2>", table(*learned_table(shown_rows))]
    if len(report["transitions"]) > _MOST_ROWS:
        body.append(f"<p>{len(report['transitions'])} transitions in all: see certificate.json.</p>")
    body += [*design, *page_tail(report)]
    write_page(folder / "report.html", f"camnet: certificate of {title}", "\n".join(body))


def unseen_table(transitions: Sequence[dict[str, Any]]) -> tuple[list[str], list[list[object]]]:
    """Return head and rows of the table of transitions: how long out of view, and the verdict of ``sound``."""
    claim = any("unseen" in t for t in transitions)
    keys = ("verdict", "margin_m", "margin_s", "binding") if claim else ()
    head = ["transition", "gap (m)"]
    head += ["unseen", "margin (m)", "margin (s)", "binding"] if claim else []
    rows: list[list[object]] = [
        [
            f"{t['from']} → {t['to']}",
            t["gap_m"],
            *(t.get("unseen", {}).get(k) for k in keys),
            t.get("sound", {}).get("verdict"),
        ]
        for t in transitions
    ]
    return [*head, "sound"], rows


def learned_table(transitions: Sequence[dict[str, Any]]) -> tuple[list[str], list[list[object]]]:
    """Return head and rows of the table of what ``learned`` says of transitions."""
    head = ["transition", "learned", "margin (m)", "margin (s)", "binding", "trust (s)", "largest e_v (m/s)"]
    keys = ("verdict", "margin_m", "margin_s", "binding", "trust_horizon_s", "largest_model_error_mps")
    return head, [
        [f"{t['from']} → {t['to']}", *(t["learned"].get(k) for k in keys)]
        for t in transitions
        if "learned" in t
    ]


def _write_map(
    path: Path,
    report: dict[str, Any],
    views: Sequence[tuple[str, Array]],
    lines: Sequence[MapLine],
    solids: Sequence[tuple[str, Array]],
) -> None:
    with figure_style():
        figure = Figure(figsize=(8.6, 7.6))
        axes = figure.add_subplot()
        for _, outline in solids:
            axes.add_patch(Polygon(outline, facecolor=SOLID, alpha=0.6, edgecolor=SOLID, zorder=1))
        for name, outline in views:
            axes.add_patch(Polygon(outline, facecolor=VIEW, alpha=0.12, edgecolor=VIEW, zorder=1))
            if len(views) <= 40:
                axes.annotate(
                    name,
                    tuple(outline.mean(axis=0)),
                    color=VIEW,
                    fontsize=7,
                    ha="center",
                    clip_on=True,
                    annotation_clip=True,
                )
        for verdict, colour in VERDICT_COLOURS.items():
            chosen = [line.points for line in lines if line.verdict == verdict]
            width = 1.2 if verdict == "seen" else 2.2
            axes.add_collection(
                LineCollection(chosen, colors=colour, linewidths=width, zorder=2 if verdict == "seen" else 3)
            )
        for x, y, along_x, along_y in aims(report.get("cameras") or ()):
            axes.plot([x], [y], marker="o", markersize=5, color=CAMERA, zorder=5)
            axes.annotate("", (x + along_x, y + along_y), (x, y), arrowprops=_ARROW, zorder=5)
        axes_of = [np.array([[x, y], [x + dx, y + dy]]) for x, y, dx, dy in aims(report.get("cameras") or ())]
        site = [line.points for line in lines] + [outline for _, outline in solids]
        shapes = [*site, *(outline for _, outline in views), *axes_of]
        if shapes:
            low, high = map_frame(shapes, site)
            edge = 0.04 * max(float((high - low).max()), 1e-6)
            axes.set(xlim=(low[0] - edge, high[0] + edge), ylim=(low[1] - edge, high[1] + edge))
        axes.set_aspect("equal")
        axes.set(xlabel="x (m)", ylabel="y (m)")
        axes.legend(
            handles=_legend(report, lines),
            loc="upper left",
            bbox_to_anchor=(1.01, 1.0),
        )
        promise = report.get("promise")
        words = ", ".join(f"{k}: {v['verdict']}" for k, v in report["certificates"].items())
        axes.set_title(
            words if promise is None else f"{report['network'].get('name', '')}: {promise['verdict']}"
        )
        save(figure, path)


def _legend(report: dict[str, Any], lines: Sequence[MapLine]) -> list[Line2D]:
    """Return what is on the map, and nothing else."""
    drawn = {line.verdict for line in lines}
    handles = [
        Line2D([], [], color=c, linewidth=2, label=_LEGEND[v])
        for v, c in VERDICT_COLOURS.items()
        if v in drawn
    ]
    if report.get("cameras"):
        handles.append(Line2D([], [], color=CAMERA, marker="o", linewidth=1, label="cameras"))
    return handles
