"""Maps of coverage: blind spots with views, buildings and roads, and pixels per metre at every place."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, PathPatch, Polygon
from matplotlib.path import Path as Outline

from camnet.geometry.pixel_classes import PIXEL_CLASSES
from camnet.report.style import CAMERA_COLOURS, figure_style, save
from camnet.types import Array

__all__ = ["CoverageDrawing", "write_blind_map", "write_pixel_map"]

_BLIND, _SOLID, _ROAD, _AREA = "#c1121f", "#6b6b6b", "#444444", "#222222"
#: colours of places by class, the coarsest first; before it: seen with fewer pixels
_CLASS_COLOURS = ("#e3dfd5", "#c7dcef", "#8fbfe0", "#4a94c8", "#1c5f99", "#0b2f57")
#: cameras that are named on a map
_MOST_NAMES = 30


@dataclass(frozen=True, eq=False)
class CoverageDrawing:
    """What the maps show, in the site's metres.

    Attributes
    ----------
    title : of the site
    area : what is counted
    cameras : names, places (2,) and directions of view (2,), of unit length or 0
    views : what each camera sees
    blind : what none of them sees of the area
    solids, lines : occluders (outlines) and roads
    extent : left, right, bottom and top of the places
    px_per_m : (rows, columns) of each place, 0 where unseen, NaN where nothing is counted; None: unknown
    unseen : what blind spots are
    """

    title: str
    area: shapely.Geometry
    cameras: Sequence[tuple[str, Array, Array]]
    views: Sequence[shapely.Geometry]
    blind: Sequence[shapely.Polygon]
    solids: Sequence[tuple[str, Array]]
    lines: Sequence[Array]
    extent: tuple[float, float, float, float]
    px_per_m: Array | None
    unseen: str = "seen by no camera"


def write_blind_map(path: Path, drawing: CoverageDrawing, words: str) -> None:
    """Write the map of blind spots; ``words`` are its title."""
    with figure_style():
        figure, axes = _axes(drawing)
        for k, view in enumerate(drawing.views):
            colour = CAMERA_COLOURS[k % len(CAMERA_COLOURS)]
            _fill(axes, view, facecolor=colour, alpha=0.16, edgecolor="none", zorder=1)
            _fill(axes, view, facecolor="none", edgecolor=colour, linewidth=0.9, zorder=2)
        for part in drawing.blind:
            _fill(axes, part, facecolor=_BLIND, alpha=0.35, edgecolor=_BLIND, linewidth=0.6, zorder=3)
        _site(axes, drawing)
        handles = [
            Patch(facecolor=_BLIND, alpha=0.35, edgecolor=_BLIND, label=drawing.unseen),
            Patch(
                facecolor=CAMERA_COLOURS[0], alpha=0.3, edgecolor=CAMERA_COLOURS[0], label="view of a camera"
            ),
        ]
        _finish(figure, axes, drawing, handles, words, path)


def write_pixel_map(path: Path, drawing: CoverageDrawing, words: str) -> None:
    """Write the map of pixels per metre, the best of all cameras at every place."""
    if drawing.px_per_m is None:
        raise ValueError("the cameras have no pixels per metre")
    limits = list(PIXEL_CLASSES.values())
    with figure_style():
        figure, axes = _axes(drawing)
        shown = np.where(drawing.px_per_m > 0.0, drawing.px_per_m, np.nan)
        colours = ListedColormap(list(_CLASS_COLOURS))
        norm = BoundaryNorm([0.0, *limits, 1e9], len(_CLASS_COLOURS))
        axes.imshow(
            shown,
            origin="lower",
            extent=drawing.extent,
            cmap=colours,
            norm=norm,
            interpolation="nearest",
            zorder=1,
        )
        blind = np.where(drawing.px_per_m == 0.0, 1.0, np.nan)
        axes.imshow(
            blind,
            origin="lower",
            extent=drawing.extent,
            cmap=ListedColormap([_BLIND]),
            alpha=0.35,
            interpolation="nearest",
            zorder=1,
        )
        _site(axes, drawing)
        names = [f"{name}: {least:g} px/m or more" for name, least in PIXEL_CLASSES.items()]
        names = [f"seen with less than {limits[0]:g} px/m", *names]
        handles = [
            Patch(facecolor=c, edgecolor="#888888", label=n)
            for c, n in zip(_CLASS_COLOURS, names, strict=True)
        ]
        handles.insert(0, Patch(facecolor=_BLIND, alpha=0.35, label=drawing.unseen))
        _finish(figure, axes, drawing, handles, words, path)


def _axes(drawing: CoverageDrawing) -> tuple[Figure, Axes]:
    x0, y0, x1, y1 = _bounds(drawing)
    ratio = (y1 - y0) / max(x1 - x0, 1e-9)
    figure = Figure(figsize=(8.6, min(max(8.6 * ratio, 3.6), 10.5)))
    axes = figure.add_subplot()
    axes.set_aspect("equal")
    axes.set(xlabel="x (m)", ylabel="y (m)", xlim=(x0, x1), ylim=(y0, y1))
    axes.grid(zorder=0)
    return figure, axes


def _bounds(drawing: CoverageDrawing) -> tuple[float, float, float, float]:
    """Return what is counted and a little around it."""
    x0, y0, x1, y1 = drawing.area.bounds
    edge = 0.03 * max(x1 - x0, y1 - y0)
    return x0 - edge, y0 - edge, x1 + edge, y1 + edge


def _site(axes: Axes, drawing: CoverageDrawing) -> None:
    """Draw roads, occluders, the border of what is counted, and the cameras."""
    axes.add_collection(
        LineCollection(list(drawing.lines), colors=_ROAD, linewidths=1.0, linestyles="dashed", zorder=4)
    )
    for _, outline in drawing.solids:
        axes.add_patch(
            Polygon(outline, facecolor=_SOLID, alpha=0.75, edgecolor=_SOLID, zorder=4, label="_occluder")
        )
    _fill(axes, drawing.area, facecolor="none", edgecolor=_AREA, linewidth=0.8, linestyle=":", zorder=4)
    x0, y0, x1, y1 = _bounds(drawing)
    arm = 0.025 * max(x1 - x0, y1 - y0)
    for k, (name, place, ahead) in enumerate(drawing.cameras):
        colour = CAMERA_COLOURS[k % len(CAMERA_COLOURS)]
        tip = place + arm * ahead
        axes.plot([place[0], tip[0]], [place[1], tip[1]], color=colour, linewidth=1.6, zorder=5)
        axes.plot(*place, marker="o", markersize=4, color=colour, markeredgecolor="white", zorder=6)
        if len(drawing.cameras) <= _MOST_NAMES:
            axes.annotate(
                name, tuple(place), (4, 4), textcoords="offset points", fontsize=7, zorder=7, annotation_clip=True
            )  # fmt: skip


def _finish(
    figure: Figure, axes: Axes, drawing: CoverageDrawing, handles: list[Patch], words: str, path: Path
) -> None:
    more: list[Patch | Line2D] = [*handles]
    if drawing.solids:
        more.append(Patch(facecolor=_SOLID, alpha=0.75, label="building or other occluder"))
    if drawing.lines:
        more.append(Line2D([], [], color=_ROAD, linewidth=1.0, linestyle="dashed", label="road"))
    more.append(Line2D([], [], color=_ROAD, marker="o", markersize=4, label="camera, direction of view"))
    more.append(Line2D([], [], color=_AREA, linewidth=0.8, linestyle=":", label="border of what is counted"))
    axes.legend(handles=more, loc="upper left", bbox_to_anchor=(1.01, 1.0))
    _scale_and_north(axes)
    axes.set_title(words)
    save(figure, path)


def _scale_and_north(axes: Axes) -> None:
    """Draw a scale bar of a round length and an arrow to the north (y grows upwards), beside the map."""
    left, right = axes.get_xlim()
    wanted = 0.2 * (right - left)
    unit = 10.0 ** math.floor(math.log10(wanted))
    length = max(k * unit for k in (1.0, 2.0, 5.0) if k * unit <= wanted)
    share = length / (right - left)
    axes.plot(
        [1.04, 1.04 + share],
        [0.06, 0.06],
        transform=axes.transAxes,
        color=_AREA,
        linewidth=2.5,
        clip_on=False,
        solid_capstyle="butt",
    )
    axes.text(1.04 + 0.5 * share, 0.075, f"{length:g} m", transform=axes.transAxes, ha="center", va="bottom")
    axes.annotate(
        "",
        (1.10 + share, 0.14),
        (1.10 + share, 0.05),
        xycoords="axes fraction",
        textcoords="axes fraction",
        annotation_clip=False,
        arrowprops={"arrowstyle": "-|>", "color": _AREA, "shrinkA": 0.0, "shrinkB": 0.0},
    )
    axes.text(1.10 + share, 0.145, "N", transform=axes.transAxes, ha="center", va="bottom")


def _fill(axes: Axes, shape: shapely.Geometry, **style: object) -> None:
    """Draw polygons, holes left open."""
    for part in _parts(shape):
        rings = [np.asarray(ring.coords) for ring in (part.exterior, *part.interiors)]
        codes = [[Outline.MOVETO, *[Outline.LINETO] * (len(r) - 2), Outline.CLOSEPOLY] for r in rings]
        axes.add_patch(PathPatch(Outline(np.concatenate(rings), np.concatenate(codes)), **style))


def _parts(shape: shapely.Geometry) -> Iterable[shapely.Polygon]:
    turned = shapely.get_parts(shapely.get_parts(shape)).tolist()
    return [shapely.geometry.polygon.orient(p) for p in turned if isinstance(p, shapely.Polygon)]
