"""The report of a certificate: ``map.png`` and ``report.html`` with a map whose lines tell their margins."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Polygon

from camnet.report.certificate_text import page_head, page_tail
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
_LEGEND = {
    "certified": "unseen, within what is allowed",
    "not certified": "unseen for too long",
    "unsatisfiable": "cannot be certified",
    "seen": "ways",
}
_VIEW, _SOLID, _CAMERA = "#0072b2", "#6b6b6b", "#7b3294"
#: length of the arrow of a camera that looks level, m
_ARROW_M = 3.0
_ARROW = {"arrowstyle": "->", "color": _CAMERA, "linewidth": 1.4}
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
    body = [*page_head(report, title), _svg(views, lines, solids, report.get("cameras") or ())]
    if report["transitions"]:
        rows = table(*certificate_table(report["transitions"][:_MOST_ROWS]))
        body += ["<h2>From view to view</h2>", rows]
    if len(report["transitions"]) > _MOST_ROWS:
        body.append(f"<p>{len(report['transitions'])} transitions in all: see certificate.json.</p>")
    body += [*design, *page_tail(report)]
    write_page(folder / "report.html", f"camnet: certificate of {title}", "\n".join(body))


def certificate_table(transitions: Sequence[dict[str, Any]]) -> tuple[list[str], list[list[object]]]:
    """Return head and rows of the table of transitions; certificates that none of them has are left out."""
    claims = [name for name in ("unseen", "learned") if any(name in t for t in transitions)]
    head = ["transition", "gap (m)"]
    for name in claims:
        head += [name, "margin (m)", "margin (s)", "binding"]
    head += ["sound"]
    if "learned" in claims:
        head += ["trust (s)", "largest e_v (m/s)"]
    rows: list[list[object]] = []
    for t in transitions:
        row: list[object] = [f"{t['from']} → {t['to']}", t["gap_m"]]
        for name in claims:
            row += [t.get(name, {}).get(k) for k in ("verdict", "margin_m", "margin_s", "binding")]
        row.append(t.get("sound", {}).get("verdict"))
        if "learned" in claims:
            row += [t.get("learned", {}).get(k) for k in ("trust_horizon_s", "largest_model_error_mps")]
        rows.append(row)
    return head, rows


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
            axes.add_patch(Polygon(outline, facecolor=_SOLID, alpha=0.6, edgecolor=_SOLID, zorder=1))
        for name, outline in views:
            axes.add_patch(Polygon(outline, facecolor=_VIEW, alpha=0.12, edgecolor=_VIEW, zorder=1))
            if len(views) <= 40:
                axes.annotate(
                    name,
                    tuple(outline.mean(axis=0)),
                    color=_VIEW,
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
        for x, y, along_x, along_y in _aims(report.get("cameras") or ()):
            axes.plot([x], [y], marker="o", markersize=5, color=_CAMERA, zorder=5)
            axes.annotate("", (x + along_x, y + along_y), (x, y), arrowprops=_ARROW, zorder=5)
        aims = [np.array([[x, y], [x + dx, y + dy]]) for x, y, dx, dy in _aims(report.get("cameras") or ())]
        site = [line.points for line in lines] + [outline for _, outline in solids]
        shapes = [*site, *(outline for _, outline in views), *aims]
        if shapes:
            low, high = _frame(shapes, site)
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
        handles.append(Line2D([], [], color=_CAMERA, marker="o", linewidth=1, label="cameras"))
    return handles


def _aims(cameras: Sequence[dict[str, Any]]) -> list[tuple[float, float, float, float]]:
    """Return place x, y and a level arrow along the optical axis, m; the arrow of one that looks down is short."""
    out = []
    for camera in cameras:
        pan, tilt = math.radians(camera["pan_deg"]), math.radians(camera["tilt_deg"])
        length = _ARROW_M * math.cos(tilt)
        out.append((camera["x_m"], camera["y_m"], length * math.cos(pan), length * math.sin(pan)))
    return out


def _svg(
    views: Sequence[tuple[str, Array]],
    lines: Sequence[MapLine],
    solids: Sequence[tuple[str, Array]],
    cameras: Sequence[dict[str, Any]] = (),
) -> str:
    """Return the map as an inline picture whose parts carry their words."""
    shapes = [outline for _, outline in (*views, *solids)] + [line.points for line in lines]
    aims = _aims(cameras)
    shapes += [np.array([[x, y], [x + dx, y + dy]]) for x, y, dx, dy in aims]
    if not shapes:
        return "<p>Nothing to draw.</p>"
    low, high = _frame(shapes, [line.points for line in lines] + [outline for _, outline in solids])
    scale = _WIDTH_PX / max(float((high - low).max()), 1e-6)

    def place(outline: Array) -> str:
        xy = np.c_[outline[:, 0] - low[0], high[1] - outline[:, 1]] * scale + 10.0
        return " ".join(f"{x:.1f},{y:.1f}" for x, y in xy)

    parts = [
        f'<polygon points="{place(o)}" fill="{_SOLID}" fill-opacity="0.6"><title>{shown(name)}</title></polygon>'
        for name, o in solids
    ]
    parts += [
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
    for (x, y, dx, dy), camera in zip(aims, cameras, strict=True):
        (at,) = place(np.array([[x, y]])).split()
        parts.append(
            f'<polyline points="{place(np.array([[x, y], [x + dx, y + dy]]))}" stroke="{_CAMERA}" stroke-width="2"/>'
            f'<circle cx="{at.split(",")[0]}" cy="{at.split(",")[1]}" r="5" fill="{_CAMERA}">'
            f"<title>{shown(camera['name'])}</title></circle>"
        )
    w, h = ((high - low) * scale + 20.0).tolist()
    parts.append(_scale_and_north(scale, w, h))
    h += 40.0
    style = "max-width:100%;height:auto;background:#fff;border:1px solid #ddd"
    return f'<svg viewBox="0 0 {w:.0f} {h:.0f}" width="{w:.0f}" style="{style}">{"".join(parts)}</svg>'


def _frame(shapes: Sequence[Array], site: Sequence[Array]) -> tuple[Array, Array]:
    """Return the lower and upper corner of the map: the site, and what is nearer to it than its own size."""
    points = np.concatenate(list(site) or list(shapes))
    size = float(np.ptp(points, axis=0).max())
    least, most = points.min(axis=0) - size, points.max(axis=0) + size
    near = [s for s in shapes if (s.max(axis=0) >= least).all() and (s.min(axis=0) <= most).all()]
    points = np.concatenate(near)
    return np.maximum(points.min(axis=0), least), np.minimum(points.max(axis=0), most)


def _scale_and_north(scale: float, width: float, height: float) -> str:
    """Return a scale bar of a round length and an arrow to the north (y grows upwards), below the map."""
    wanted = 0.2 * width / scale
    unit = 10.0 ** np.floor(np.log10(wanted))
    length = float(max(k * unit for k in (1.0, 2.0, 5.0) if k * unit <= wanted))
    x, y, end = 10.0, height + 18.0, 10.0 + length * scale
    north = width - 20.0
    return (
        f'<path d="M{x:.1f} {y - 5:.1f}V{y:.1f}H{end:.1f}V{y - 5:.1f}" fill="none" stroke="#222"/>'
        f'<text x="{end + 8:.1f}" y="{y:.1f}" font-size="13">{length:g} m</text>'
        f'<path d="M{north:.1f} {y + 8:.1f}V{y - 14:.1f}l-4 8m4 -8l4 8" fill="none" stroke="#222"/>'
        f'<text x="{north - 22:.1f}" y="{y + 6:.1f}" font-size="13">N</text>'
    )
