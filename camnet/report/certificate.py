"""The report of a certificate: ``map.png`` and ``report.html`` with a map whose lines tell their margins."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Polygon

from camnet.report.html import table, write_page
from camnet.report.markup import shown
from camnet.report.style import figure_style, save
from camnet.types import Array

__all__ = ["VERDICT_COLOURS", "MapLine", "certificate_table", "write_certificate"]

VERDICT_COLOURS = {
    "certified": "#2a9d5c",
    "not certified": "#c1121f",
    "unsatisfiable": "#9a9a9a",
    "seen": "#c9d8e8",
}
_VIEW = "#0072b2"
#: pages list at most this many transitions; the JSON file has all of them
_MOST_ROWS = 500
_WIDTH_PX = 900.0


@dataclass(frozen=True, eq=False)
class MapLine:
    """One line of the map: points (n, 2) in m, a verdict or ``seen``, and the words shown over it."""

    points: Array
    verdict: str
    words: str


def write_certificate(
    folder: Path, report: dict[str, Any], views: Sequence[tuple[str, Array]], lines: Sequence[MapLine]
) -> None:
    """Write map and page of a report into ``folder``; ``views`` are names and outlines (K, 2), m."""
    _write_map(folder / "map.png", report, views, lines)
    network = report["network"]
    title = str(network.get("name", "certificate"))
    body = [
        f"<h1>{shown(title)}</h1><p>{shown(network['cameras'])} cameras, {shown(network['regions'])} regions; "
        f"targets: {shown(report['target_class'])}</p>",
        "<h2>Certificates</h2>",
        table(
            ("certificate", "verdict", "reason"),
            [(k, v["verdict"], v["reason"]) for k, v in report["certificates"].items()],
        ),
        "<h2>Map</h2><p>Green: certified, red: not certified, grey: unsatisfiable. "
        "Hold the pointer over a line or a view for its details.</p>",
        _svg(views, lines),
    ]
    if report["transitions"]:
        rows = table(*certificate_table(report["transitions"][:_MOST_ROWS]))
        body += ["<h2>Transitions</h2>", rows]
    if len(report["transitions"]) > _MOST_ROWS:
        body.append(f"<p>{len(report['transitions'])} transitions in all: see certificate.json.</p>")
    if report.get("assumptions"):
        items = "".join(f"<li>{shown(a)}</li>" for a in report["assumptions"])
        body.append(f"<h2>Assumptions of sound</h2><ul>{items}</ul>")
    write_page(folder / "report.html", f"camnet: certificate of {title}", "\n".join(body))


def certificate_table(transitions: Iterable[dict[str, Any]]) -> tuple[list[str], list[list[object]]]:
    """Return head and rows of the table of transitions."""
    head = ["transition", "gap (m)"]
    for name in ("sound", "learned"):
        head += [name, "margin (m)", "margin (s)", "binding"]
    head += ["trust (s)", "largest e_v (m/s)"]
    rows: list[list[object]] = []
    for t in transitions:
        row: list[object] = [f"{t['from']} → {t['to']}", t["gap_m"]]
        for name in ("sound", "learned"):
            v = t.get(name, {})
            row += [v.get(k) for k in ("verdict", "margin_m", "margin_s", "binding")]
        trust = t.get("learned", t.get("sound", {})).get("trust_horizon_s")
        rows.append([*row, trust, t.get("learned", {}).get("largest_model_error_mps")])
    return head, rows


def _write_map(
    path: Path, report: dict[str, Any], views: Sequence[tuple[str, Array]], lines: Sequence[MapLine]
) -> None:
    with figure_style():
        figure = Figure(figsize=(8.6, 7.6))
        axes = figure.add_subplot()
        for name, outline in views:
            axes.add_patch(Polygon(outline, facecolor=_VIEW, alpha=0.12, edgecolor=_VIEW, zorder=1))
            if len(views) <= 40:
                axes.annotate(name, tuple(outline.mean(axis=0)), color=_VIEW, fontsize=7, ha="center")
        for verdict, colour in VERDICT_COLOURS.items():
            chosen = [line.points for line in lines if line.verdict == verdict]
            width = 1.2 if verdict == "seen" else 2.2
            axes.add_collection(
                LineCollection(chosen, colors=colour, linewidths=width, zorder=2 if verdict == "seen" else 3)
            )
        axes.autoscale_view()
        axes.set_aspect("equal")
        axes.set(xlabel="x (m)", ylabel="y (m)")
        axes.legend(
            handles=[Line2D([], [], color=c, linewidth=2, label=v) for v, c in VERDICT_COLOURS.items()],
            loc="upper left",
            bbox_to_anchor=(1.01, 1.0),
        )
        words = ", ".join(f"{k}: {v['verdict']}" for k, v in report["certificates"].items())
        axes.set_title(words)
        save(figure, path)


def _svg(views: Sequence[tuple[str, Array]], lines: Sequence[MapLine]) -> str:
    """Return the map as an inline picture whose parts carry their words."""
    shapes = [outline for _, outline in views] + [line.points for line in lines]
    if not shapes:
        return "<p>Nothing to draw.</p>"
    points = np.concatenate(shapes)
    low, high = points.min(axis=0), points.max(axis=0)
    scale = _WIDTH_PX / max(float((high - low).max()), 1e-6)

    def place(outline: Array) -> str:
        xy = np.c_[outline[:, 0] - low[0], high[1] - outline[:, 1]] * scale + 10.0
        return " ".join(f"{x:.1f},{y:.1f}" for x, y in xy)

    parts = [
        f'<polygon points="{place(o)}" fill="{_VIEW}" fill-opacity="0.12" stroke="{_VIEW}">'
        f"<title>{shown(name)}</title></polygon>"
        for name, o in views
    ]
    order = sorted(lines, key=lambda line: line.verdict != "seen")
    parts += [
        f'<polyline points="{place(line.points)}" fill="none" stroke="{VERDICT_COLOURS[line.verdict]}" '
        f'stroke-width="{2 if line.verdict == "seen" else 4}"><title>{shown(line.words)}</title></polyline>'
        for line in order
    ]
    w, h = ((high - low) * scale + 20.0).tolist()
    style = "max-width:100%;height:auto;background:#fff;border:1px solid #ddd"
    return f'<svg viewBox="0 0 {w:.0f} {h:.0f}" width="{w:.0f}" style="{style}">{"".join(parts)}</svg>'
