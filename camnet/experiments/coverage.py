"""How much of a site its cameras see: of the ground and of the roads, by how many, with how many pixels per metre."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely

from camnet.certification.blind import blind_cameras
from camnet.certification.ground_cover import (
    Grid,
    GroundCover,
    cover_ground,
    lengths_by_cameras,
    stretches_inside,
)
from camnet.certification.ground_outlines import blind_spots, polygons, solid_outline, view_outlines
from camnet.certification.lens_views import Watch
from camnet.certification.sight_lines import Solids
from camnet.errors import CertificateError, ConfigError
from camnet.experiments.coverage_site import CoverageSite
from camnet.geometry.pixel_classes import PIXEL_CLASSES
from camnet.geometry.pixel_density import pixels_per_metre
from camnet.importers.geojson_areas import NamedArea
from camnet.types import Array

__all__ = ["Covered", "cover_site"]

#: sides of places that are tried, m: the smallest with at most so many places
_STEPS_M = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0)
_USUAL_PLACES, _MOST_PLACES = 1_000_000, 25_000_000
#: lengths of road below this (m) are rounding
_CONTACT_M = 1e-6
#: blind spots that are listed
_MOST_SPOTS = 50
#: places that stand for the ground when a camera that sees nothing is explained
_MOST_SAMPLES = 2000


@dataclass(frozen=True, eq=False)
class Covered:
    """A report ready for JSON, the places, and what maps show.

    Attributes
    ----------
    report : plain data
    site, ground : the site and its places
    area : what is counted, in the site's metres; ``areas`` are its named parts
    views : what each camera sees of the ground
    classes : what all of them see by class of pixels per metre
    blind : what none of them sees of the area, the largest first
    """

    report: dict[str, Any]
    site: CoverageSite
    ground: GroundCover
    area: shapely.Geometry
    areas: tuple[NamedArea, ...]
    views: list[shapely.Geometry]
    classes: dict[str, shapely.Geometry]
    blind: list[shapely.Polygon]


def cover_site(
    site: CoverageSite,
    areas: Sequence[NamedArea] = (),
    *,
    height_m: float = 0.0,
    resolution_m: float | None = None,
    margin_m: float | None = None,
    pixel_class: str | None = None,
) -> Covered:
    """Count what a site's cameras see.

    Parameters
    ----------
    site : cameras, roads, occluders
    areas : what counts; none: the box about the site, grown by ``margin_m``
    height_m : height above the ground of what is to be seen
    resolution_m : side of a place; None: 0.1 m, or coarser so that there are at most a million
    pixel_class : only what a camera sees with the pixels of this class counts

    Raises
    ------
    ConfigError
        The cameras have no intrinsics to tell pixels from, there are too many places, or none of them is ground.
    CertificateError
        Places and outlines contradict each other.
    """
    watch = _asked(site, pixel_class)
    area = shapely.union_all([a.shape for a in areas]) if areas else shapely.box(*site.bounds(margin_m))
    grid = Grid.over(area.bounds, _step(area, resolution_m))
    _check_size(grid)
    ground = cover_ground(grid, area, watch, Solids.of(site.parts), height_m)
    if not ground.ground.any():
        raise ConfigError(
            f"no place to count: a grid of {grid.step_m:g} m has none in the area that is no occluder; give a finer "
            "--resolution or another --area"
        )
    views = view_outlines(watch, site.parts, height_m)
    own = [solid_outline(*part, height_m) for part in site.parts]
    blind = blind_spots(area, views, own)
    classes = {} if watch.focal_px is None else _class_outlines(watch, site, height_m)
    report = _report(site, watch, ground, areas, views, blind, height_m, pixel_class)
    _check_agreement(ground, area, views, own)
    return Covered(report, site, ground, area, tuple(areas), views, classes, blind)


def _asked(site: CoverageSite, pixel_class: str | None) -> Watch:
    if pixel_class is None:
        return site.watch
    if site.watch.focal_px is None:
        raise ConfigError(
            f"--class {pixel_class}: of cameras over --roads only the footprint is known, no intrinsics, so they have "
            "no pixels per metre; leave it out"
        )
    return site.watch.capped(pixels_per_metre(pixel_class))


def _step(area: shapely.Geometry, resolution_m: float | None) -> float:
    if resolution_m is not None:
        return resolution_m
    x0, y0, x1, y1 = area.bounds
    box = (x1 - x0) * (y1 - y0)
    return next((step for step in _STEPS_M if box / step**2 <= _USUAL_PLACES), _STEPS_M[-1])


def _check_size(grid: Grid) -> None:
    places = grid.columns * grid.rows
    if places > _MOST_PLACES:
        least = grid.step_m * math.sqrt(places / _MOST_PLACES)
        raise ConfigError(
            f"--resolution {grid.step_m:g}: {places:,} places; at most {_MOST_PLACES:,} are counted, so give "
            f"{least:.2g} m or more, or a smaller --area"
        )


def _class_outlines(watch: Watch, site: CoverageSite, height_m: float) -> dict[str, shapely.Geometry]:
    return {
        name: shapely.union_all(view_outlines(watch.capped(least), site.parts, height_m), grid_size=1e-3)
        for name, least in PIXEL_CLASSES.items()
    }


def _report(
    site: CoverageSite,
    watch: Watch,
    ground: GroundCover,
    areas: Sequence[NamedArea],
    views: Sequence[shapely.Geometry],
    blind: Sequence[shapely.Polygon],
    height_m: float,
    pixel_class: str | None,
) -> dict[str, Any]:
    within = shapely.union_all([a.shape for a in areas]) if areas else None
    roads = _roads(site, watch, height_m, within)
    warnings = [*site.warnings, *_blind_words(site, watch, ground, height_m)]
    return {
        "site": site.name,
        "cameras": len(watch.names),
        "class": pixel_class,
        "height_m": height_m,
        "resolution_m": ground.grid.step_m,
        "places": int(ground.ground.sum()),
        "ground": _summed(ground.shares(), "m2"),
        "roads": roads,
        "classes": _classes(site, watch, ground, height_m, within),
        "areas": [_named(ground, area) for area in areas],
        "blind_spots": [_spot(part) for part in blind[:_MOST_SPOTS]],
        "blind_spots_count": len(blind),
        "camera_list": _cameras(site, watch, ground, views, height_m),
        "warnings": warnings,
        "assumptions": _assumptions(watch, height_m),
    }


def _summed(rows: list[dict[str, float]], unit: str) -> dict[str, Any]:
    """Return the whole, what is seen of it, and both by number of cameras."""
    whole = sum(row[unit] for row in rows)
    seen = whole - rows[0][unit]
    share = seen / whole if whole > 0.0 else 0.0
    return {unit: whole, f"seen_{unit}": seen, "seen_share": share, "by_cameras": rows}


def _named(ground: GroundCover, area: NamedArea) -> dict[str, Any]:
    gx, gy = np.meshgrid(ground.grid.x, ground.grid.y)
    part = np.asarray(shapely.contains_xy(area.shape, gx, gy), dtype=np.bool_)
    if not (part & ground.ground).any():
        raise ConfigError(
            f"area {area.name!r}: a grid of {ground.grid.step_m:g} m has no place in it that is ground; give a finer "
            "--resolution"
        )
    return {"name": area.name, **_summed(ground.shares(part), "m2")}


def _roads(
    site: CoverageSite, watch: Watch, height_m: float, area: shapely.Geometry | None
) -> dict[str, Any] | None:
    """Return the length of road seen, inside an area if given; None where there is no road."""
    found = []
    for part in site.roads:
        inside = None if area is None else stretches_inside(part.arcs, area)
        coverage = part.cover(watch, site.parts, height_m)
        found.append(lengths_by_cameras(coverage, part.arcs.length_m, part.counted, inside))
    if not found or sum(sum(lengths) for lengths in found) <= 0.0:
        return None
    most = max(len(lengths) for lengths in found)
    lengths = [sum(part[k] for part in found if k < len(part)) for k in range(most)]
    whole = sum(lengths)
    while len(lengths) > 1 and lengths[-1] < _CONTACT_M:  # stretches that touch, not overlap
        lengths[-2:] = [lengths[-2] + lengths[-1]]
    return _summed([{"cameras": k, "m": v, "share": v / whole} for k, v in enumerate(lengths)], "m")


def _classes(
    site: CoverageSite,
    watch: Watch,
    ground: GroundCover,
    height_m: float,
    area: shapely.Geometry | None,
) -> list[dict[str, Any]] | None:
    """Return the share of ground and road that some camera sees with the pixels of each class."""
    if ground.px_per_m is None:
        return None
    out = []
    for name, least in PIXEL_CLASSES.items():
        enough = ground.ground & (ground.px_per_m >= least)
        roads = _roads(site, watch.capped(least), height_m, area)
        out.append(
            {
                "class": name,
                "px_per_m": least,
                "ground_m2": ground.area_m2(enough),
                "ground_share": float(enough.sum()) / float(ground.ground.sum()),
                "road_share": None if roads is None else roads["seen_share"],
            }
        )
    return out


def _spot(part: shapely.Polygon) -> dict[str, float]:
    inside = part.representative_point()
    return {"m2": float(part.area), "x_m": float(inside.x), "y_m": float(inside.y)}


def _cameras(
    site: CoverageSite,
    watch: Watch,
    ground: GroundCover,
    views: Sequence[shapely.Geometry],
    height_m: float,
) -> list[dict[str, Any]]:
    """List the cameras: place, pan and tilt of the optical axis, what each sees, and its pixels per metre there."""
    out = []
    first = np.searchsorted(watch.owner, np.arange(len(watch.names)))
    cell = ground.grid.step_m**2
    for k, name in enumerate(watch.names):
        place = dict(zip(("x_m", "y_m", "z_m"), watch.views.position[first[k]].tolist(), strict=True))
        x, y, z = site.axes[k].tolist()
        level = math.hypot(x, y)
        pixels = _pixels(watch, k, views[k], height_m)
        out.append(
            {
                "name": name,
                **place,
                "pan_deg": math.degrees(math.atan2(y, x)) if level > 1e-9 else None,
                "tilt_deg": math.degrees(math.atan2(-z, level)),
                "ground_m2": float(views[k].area),
                "counted_m2": float(ground.seen_by[k]) * cell,
                "px_per_m": pixels,
            }
        )
    return out


def _pixels(watch: Watch, camera: int, view: shapely.Geometry, height_m: float) -> list[float] | None:
    """Return the fewest and the most pixels per metre in a view; its depth is linear, so corners decide."""
    corners = shapely.get_coordinates(view)
    if watch.focal_px is None or len(corners) == 0:
        return None
    density = watch.density(camera, np.c_[corners, np.full(len(corners), height_m)])
    return [float(density.min()), float(density.max())]


def _blind_words(site: CoverageSite, watch: Watch, ground: GroundCover, height_m: float) -> list[str]:
    """Name the cameras that see nothing of the counted ground, each with the likely reason."""
    sees = ground.seen_by > 0
    if sees.all():
        return []
    rows, columns = np.nonzero(ground.ground)
    step = max(1, len(rows) // _MOST_SAMPLES)
    places = np.c_[ground.grid.x[columns[::step]], ground.grid.y[rows[::step]]]
    views, would = site.watch.views, None
    if site.parts:
        free = cover_ground(ground.grid, shapely.box(*_box(ground.grid)), watch, Solids.of([]), height_m)
        would = free.seen_by > 0
    first = np.searchsorted(watch.owner, np.arange(len(watch.names)))
    mine = type(views)(*(np.asarray(part)[first] for part in _columns(watch)))
    found = blind_cameras(watch.names, mine, places, height_m, sees, would)
    return [f"camera {c.name} sees nothing of the counted ground: {_of_places(c.reason)}" for c in found]


def _of_places(reason: str) -> str:
    """Return a reason that speaks of ways in words about places."""
    return reason.replace("every way", "every place").replace("the nearest way", "the nearest place")


def _columns(watch: Watch) -> tuple[Array, Array, Array, Array]:
    v = watch.views
    return v.normals, v.offsets, v.bounds_xy, v.position


def _box(grid: Grid) -> tuple[float, float, float, float]:
    return grid.x_m, grid.y_m, grid.x_m + grid.columns * grid.step_m, grid.y_m + grid.rows * grid.step_m


def _assumptions(watch: Watch, height_m: float) -> list[str]:
    words = [
        f"the ground is level; a place counts as seen where a camera sees the point {height_m:g} m above it",
        "ground inside occluders is not counted; nothing but the listed occluders hides anything",
        "a road counts as seen where one camera sees its whole width",
    ]
    if watch.focal_px is not None:
        words.append(
            "pixels per metre are those of a metre perpendicular to the line of sight: focal length over the distance "
            "along the optical axis; lens distortion, focus, light and compression are left out"
        )
    return words


def _check_agreement(
    ground: GroundCover,
    area: shapely.Geometry,
    views: Sequence[shapely.Geometry],
    solids: Sequence[shapely.Geometry],
) -> None:
    """Refuse a result whose places and outlines differ by more than the places that borders pass through."""
    seen = shapely.intersection(shapely.union_all(list(views), grid_size=1e-3), area)
    if solids:
        seen = shapely.difference(seen, shapely.union_all(list(solids)))
    step = ground.grid.step_m
    counted = ground.area_m2(ground.cameras > 0)
    outlines = sum(float(part.area) for part in polygons(seen))
    border = float(seen.length) + float(area.length)
    if abs(counted - outlines) > 3.0 * step * border + 9.0 * step**2:
        raise CertificateError(
            f"places say {counted:.6g} m2 are seen, outlines {outlines:.6g} m2: the result contradicts itself"
        )
