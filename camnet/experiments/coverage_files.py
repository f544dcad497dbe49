"""What ``camnet coverage`` writes besides its report: places, features for GeoJSON, and what maps show."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from camnet.certification.ground_outlines import polygons
from camnet.experiments.coverage import Covered
from camnet.geometry.pixel_classes import PIXEL_CLASSES
from camnet.report.coverage_map import CoverageDrawing
from camnet.report.geojson import GeoFeature
from camnet.storage.whole_file import whole_file

__all__ = ["drawing_of", "geo_features", "write_places"]


def write_places(path: Path, covered: Covered) -> None:
    """Write every place: middles ``x_m`` (columns,), ``y_m`` (rows,), and by row and column what is known of it.

    ``ground``: whether it counts; ``cameras``: how many see it; ``px_per_m``: most of any of them (0: none sees it;
    left out for cameras without intrinsics).
    """
    ground = covered.ground
    columns = {
        "x_m": ground.grid.x,
        "y_m": ground.grid.y,
        "ground": ground.ground,
        "cameras": ground.cameras.astype(np.uint16),
    }
    if ground.px_per_m is not None:
        columns["px_per_m"] = ground.px_per_m.astype(np.float32)
    with whole_file(path) as temporary, temporary.open("wb") as stream:
        np.savez_compressed(stream, **columns)  # type: ignore[arg-type]


def geo_features(covered: Covered) -> Iterator[GeoFeature]:
    """Yield cameras, what each sees, what all see by class, named areas, blind spots; views are not cut to areas."""
    for row, view in zip(covered.report["camera_list"], covered.views, strict=True):
        place = np.array([row["x_m"], row["y_m"], row["z_m"]])
        about = {k: row[k] for k in ("name", "pan_deg", "tilt_deg", "px_per_m")}
        yield GeoFeature(place, {"kind": "camera", **about})
        yield GeoFeature(polygons(view), {"kind": "view", "name": row["name"], "m2": float(view.area)})
    for name, shape in covered.classes.items():
        about = {"kind": "class", "name": name, "px_per_m": PIXEL_CLASSES[name], "m2": float(shape.area)}
        yield GeoFeature(polygons(shape), about)
    for area in covered.areas:
        yield GeoFeature(polygons(area.shape), {"kind": "area", "name": area.name})
    for k, part in enumerate(covered.blind):
        yield GeoFeature([part], {"kind": "blind spot", "number": k + 1, "m2": float(part.area)})


def drawing_of(covered: Covered) -> CoverageDrawing:
    """Return what maps show."""
    ground, site = covered.ground, covered.site
    grid = ground.grid
    x1, y1 = grid.x_m + grid.columns * grid.step_m, grid.y_m + grid.rows * grid.step_m
    pixels = None if ground.px_per_m is None else np.where(ground.ground, ground.px_per_m, np.nan)
    cameras = [
        (row["name"], np.array([row["x_m"], row["y_m"]]), axis[:2] / max(float(np.hypot(*axis[:2])), 1e-9))
        for row, axis in zip(covered.report["camera_list"], site.axes, strict=True)
    ]
    asked = covered.report["class"]
    unseen = "seen by no camera" if asked is None else f"seen by none well enough to {asked}"
    return CoverageDrawing(
        site.name,
        covered.area,
        cameras,
        covered.views,
        covered.blind,
        site.solids,
        site.lines,
        (grid.x_m, x1, grid.y_m, y1),
        pixels,
        unseen,
    )
