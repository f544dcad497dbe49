"""The map of a certificate's page as an inline picture: axes, scale, north, and parts that carry their words."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from camnet.report.markup import shown
from camnet.types import Array

__all__ = ["CAMERA", "SOLID", "VERDICT_COLOURS", "VIEW", "MapLine", "aims", "map_frame", "svg_map"]

VERDICT_COLOURS = {
    "certified": "#2a9d5c",
    "not certified": "#c1121f",
    "unsatisfiable": "#9a9a9a",
    "seen": "#c9d8e8",
}
VIEW, SOLID, CAMERA = "#0072b2", "#6b6b6b", "#7b3294"
#: length of the arrow of a camera that looks level, m
_ARROW_M = 3.0
_WIDTH_PX = 900.0
#: room for the axes at the left and below, and beside the map, px
_LEFT, _BELOW, _BESIDE = 56.0, 62.0, 12.0
#: a letter of a name is about as wide, a line as high, px
_LETTER_PX, _LINE_PX = 7.0, 14.0
#: ticks of an axis, about; names of cameras are written up to so many
_TICKS, _MOST_NAMES = 6, 60


@dataclass(frozen=True, eq=False)
class MapLine:
    """One line of the map: points (n, 2) in m, a verdict or ``seen``, and the words shown over it."""

    points: Array
    verdict: str
    words: str


def aims(cameras: Sequence[dict[str, Any]]) -> list[tuple[float, float, float, float]]:
    """Return place x, y and a level arrow along the optical axis, m; the arrow of one that looks down is short."""
    out = []
    for camera in cameras:
        pan, tilt = math.radians(camera["pan_deg"]), math.radians(camera["tilt_deg"])
        length = _ARROW_M * math.cos(tilt)
        out.append((camera["x_m"], camera["y_m"], length * math.cos(pan), length * math.sin(pan)))
    return out


def map_frame(shapes: Sequence[Array], site: Sequence[Array]) -> tuple[Array, Array]:
    """Return the lower and upper corner of the map: the site, and what is nearer to it than its own size."""
    points = np.concatenate(list(site) or list(shapes))
    size = float(np.ptp(points, axis=0).max())
    least, most = points.min(axis=0) - size, points.max(axis=0) + size
    near = [s for s in shapes if (s.max(axis=0) >= least).all() and (s.min(axis=0) <= most).all()]
    points = np.concatenate(near)
    return np.maximum(points.min(axis=0), least), np.minimum(points.max(axis=0), most)


def svg_map(
    views: Sequence[tuple[str, Array]],
    lines: Sequence[MapLine],
    solids: Sequence[tuple[str, Array]],
    cameras: Sequence[dict[str, Any]] = (),
) -> str:
    """Return the map as an inline picture; ``views`` and ``solids`` are names and outlines (K, 2), m."""
    arrows = aims(cameras)
    shapes = [outline for _, outline in (*views, *solids)] + [line.points for line in lines]
    shapes += [np.array([[x, y], [x + dx, y + dy]]) for x, y, dx, dy in arrows]
    if not shapes:
        return "<p>Nothing to draw.</p>"
    low, high = map_frame(shapes, [line.points for line in lines] + [outline for _, outline in solids])
    edge = 0.02 * max(float((high - low).max()), 1e-6)
    low, high = low - edge, high + edge
    scale = _WIDTH_PX / float((high - low).max())
    w, h = ((high - low) * scale).tolist()

    def place(outline: Array) -> str:
        xy = np.c_[outline[:, 0] - low[0], high[1] - outline[:, 1]] * scale
        return " ".join(f"{x:.1f},{y:.1f}" for x, y in xy)

    parts = [_grid(low, high, scale, w, h)]
    parts += [
        f'<polygon points="{place(o)}" fill="{SOLID}" fill-opacity="0.6"><title>{shown(name)}</title></polygon>'
        for name, o in solids
    ]
    parts += [
        f'<polygon points="{place(o)}" fill="{VIEW}" fill-opacity="0.12" stroke="{VIEW}">'
        f"<title>{shown(name)}</title></polygon>"
        for name, o in views
    ]
    parts += [
        f'<polyline points="{place(line.points)}" fill="none" stroke="{VERDICT_COLOURS[line.verdict]}" '
        f'stroke-width="{2 if line.verdict == "seen" else 4}"><title>{shown(line.words)}</title></polyline>'
        for line in sorted(lines, key=lambda line: line.verdict != "seen")
    ]
    known = {str(camera["name"]) for camera in cameras}
    regions = [(name, o) for name, o in views if name not in known]
    if len(regions) <= _MOST_NAMES:  # a camera's name stands where it does
        parts += [_name(place(o.mean(axis=0)[None]), name) for name, o in regions]
    labels: list[str] = []
    taken: list[tuple[float, float, float]] = []
    for (x, y, dx, dy), camera in zip(arrows, cameras, strict=True):
        ends = place(np.array([[x, y], [x + dx, y + dy]]))
        parts.append(_camera(ends, str(camera["name"])))
        if len(cameras) <= _MOST_NAMES:
            labels.append(_label(ends, str(camera["name"]), dx >= 0.0, taken))
    parts += labels
    inside = (
        f'<svg x="{_LEFT:.0f}" y="{_BESIDE:.0f}" width="{w:.1f}" height="{h:.1f}" '
        f'viewBox="0 0 {w:.1f} {h:.1f}">{"".join(parts)}</svg>'
    )
    frame = _axes(low, high, scale, w, h) + _scale_and_north(scale, w, h)
    width, height = w + _LEFT + _BESIDE, h + _BELOW + _BESIDE + 26.0
    style = "max-width:100%;height:auto;background:#fff;border:1px solid #ddd"
    return (
        f'<svg viewBox="0 0 {width:.0f} {height:.0f}" width="{width:.0f}" style="{style}" role="img" '
        f'aria-label="map">{inside}{frame}</svg>'
    )


def _name(at: str, name: str) -> str:
    """Return the name of an operating region in its middle."""
    x, y = at.split(",")
    return (
        f'<text x="{x}" y="{y}" text-anchor="middle" font-size="12" fill="{VIEW}" stroke="#fff" stroke-width="3" '
        f'paint-order="stroke">{shown(name)}</text>'
    )


def _camera(ends: str, name: str) -> str:
    """Return a camera: its place, and the level part of its axis."""
    x, y = ends.split(" ", maxsplit=1)[0].split(",")
    return (
        f'<polyline points="{ends}" stroke="{CAMERA}" stroke-width="2"/>'
        f'<circle cx="{x}" cy="{y}" r="5" fill="{CAMERA}"><title>{shown(name)}</title></circle>'
    )


def _label(ends: str, name: str, looks_right: bool, taken: list[tuple[float, float, float]]) -> str:
    """Return a camera's name beside it, on the side where it does not look, below names that are there already.

    ``taken`` are the left and right end and the height of these, px; the name's own are added.
    """
    x, y = (float(v) for v in ends.split(" ", maxsplit=1)[0].split(","))
    wide, y = _LETTER_PX * len(name), y + 4.0
    left = x - 8.0 - wide if looks_right else x + 8.0
    while any(abs(y - h) < _LINE_PX and left < r and left + wide > begin for begin, r, h in taken):
        y += _LINE_PX
    taken.append((left, left + wide, y))
    at, anchor = (x - 8.0, "end") if looks_right else (x + 8.0, "start")
    return (
        f'<text x="{at:.1f}" y="{y:.1f}" text-anchor="{anchor}" font-size="12" fill="{CAMERA}" '
        f'stroke="#fff" stroke-width="3" paint-order="stroke">{shown(name)}</text>'
    )


def _ticks(low: float, high: float) -> list[float]:
    """Return round values between two, about as many as an axis has ticks."""
    step = _round_length((high - low) / _TICKS)
    first = math.ceil(low / step - 1e-9)
    return [k * step for k in range(first, math.floor(high / step + 1e-9) + 1)]


def _round_length(wanted: float) -> float:
    """Return the largest of 1, 2 and 5 times a power of ten that is no more than ``wanted``."""
    unit = 10.0 ** math.floor(math.log10(wanted))
    return max(k * unit for k in (1.0, 2.0, 5.0) if k * unit <= wanted * (1.0 + 1e-9))


def _grid(low: Array, high: Array, scale: float, w: float, h: float) -> str:
    across = [(x - low[0]) * scale for x in _ticks(float(low[0]), float(high[0]))]
    up = [(high[1] - y) * scale for y in _ticks(float(low[1]), float(high[1]))]
    lines = [f"M{x:.1f} 0V{h:.1f}" for x in across] + [f"M0 {y:.1f}H{w:.1f}" for y in up]
    return f'<path d="{"".join(lines)}" stroke="#eee" fill="none"/>'


def _axes(low: Array, high: Array, scale: float, w: float, h: float) -> str:
    """Return the frame with the coordinates of its grid lines, m."""
    bottom = _BESIDE + h
    words = [
        f'<text x="{_LEFT + (x - low[0]) * scale:.1f}" y="{bottom + 16:.1f}" text-anchor="middle">{x:g}</text>'
        for x in _ticks(float(low[0]), float(high[0]))
    ]
    words += [
        f'<text x="{_LEFT - 6:.1f}" y="{_BESIDE + (high[1] - y) * scale + 4:.1f}" text-anchor="end">{y:g}</text>'
        for y in _ticks(float(low[1]), float(high[1]))
    ]
    words.append(f'<text x="{_LEFT + 0.5 * w:.1f}" y="{bottom + 34:.1f}" text-anchor="middle">x (m)</text>')
    middle = _BESIDE + 0.5 * h
    words.append(
        f'<text transform="translate(14 {middle:.1f}) rotate(-90)" text-anchor="middle">y (m)</text>'
    )
    box = f'<rect x="{_LEFT:.1f}" y="{_BESIDE:.1f}" width="{w:.1f}" height="{h:.1f}" fill="none" stroke="#999"/>'
    return f'{box}<g font-size="12" fill="#444">{"".join(words)}</g>'


def _scale_and_north(scale: float, w: float, h: float) -> str:
    """Return a scale bar of a round length and an arrow to the north (y grows upwards), below the map."""
    length = _round_length(0.2 * w / scale)
    x, y = _LEFT, _BESIDE + h + _BELOW
    end, north = x + length * scale, _LEFT + w - 12.0
    return (
        f'<path d="M{x:.1f} {y - 5:.1f}V{y:.1f}H{end:.1f}V{y - 5:.1f}" fill="none" stroke="#222"/>'
        f'<text x="{end + 8:.1f}" y="{y:.1f}" font-size="13">{length:g} m</text>'
        f'<path d="M{north:.1f} {y + 8:.1f}V{y - 14:.1f}l-4 8m4 -8l4 8" fill="none" stroke="#222"/>'
        f'<text x="{north - 22:.1f}" y="{y + 6:.1f}" font-size="13">N</text>'
    )
