"""Certify cameras that stand somewhere already: surveyed cameras of an open site, or cameras along a city's roads."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from camnet.certification.benchmark import nadir_views
from camnet.certification.coverage import Views
from camnet.certification.free_network import FreeTargetClass, ground_views
from camnet.certification.promise import with_claims
from camnet.certification.site import (
    certify_open_site,
    certify_road_site,
    road_segments_with_verdict,
    views_of,
)
from camnet.certification.transitions import GrowthModel, RoadTargetClass
from camnet.errors import ConfigError, WorldError
from camnet.experiments.certified import Certified
from camnet.experiments.certify_road_world import road_lines
from camnet.experiments.certify_world import free_lines, free_promise
from camnet.experiments.check_traffic import check_traffic, read_traffic
from camnet.experiments.promise_world import Limit
from camnet.experiments.road_site import read_road_site
from camnet.geometry.frustum import Frustum
from camnet.geometry.pinhole import Pinhole
from camnet.geometry.pixel_density import class_range_m
from camnet.geometry.settings import CameraModel, Intrinsics
from camnet.importers.sumo_detectors import Sensor, read_detectors, read_sensor_table
from camnet.importers.surveyed_camera import SurveyedCamera

__all__ = [
    "certify_cameras",
    "certify_road_cameras",
    "usable_frustum",
]

#: shares of the image that are tried where the distortion folds it over
_SHARES = np.arange(0.98, 0.2, -0.02)


def usable_frustum(name: str, intrinsics: Intrinsics, near_m: float, far_m: float) -> tuple[Frustum, float]:
    """Return a camera's frustum and the share of the image about the principal point that it covers.

    Where the lens model folds the image over before its border, the view is cut to the largest centred part of the
    image in which pixels and rays belong together one to one; what lies outside counts as unseen, which is cautious.
    """
    model = CameraModel(name=name, intrinsics=intrinsics, near_m=near_m, far_m=far_m)
    try:
        return Frustum.from_camera(model), 1.0
    except WorldError:
        pass
    for share in _SHARES.tolist():
        inner = _inner_part(intrinsics, share)
        if not _monotone(inner):
            continue
        try:
            return Frustum.from_camera(model.model_copy(update={"intrinsics": inner})), share
        except WorldError:
            continue
    raise WorldError(f"camera {name!r}: no part of the image has a valid distortion {intrinsics.distortion}")


def _inner_part(intrinsics: Intrinsics, share: float) -> Intrinsics:
    return intrinsics.model_copy(
        update={
            "width_px": int(share * intrinsics.width_px),
            "height_px": int(share * intrinsics.height_px),
            "cx_px": share * intrinsics.cx_px,
            "cy_px": share * intrinsics.cy_px,
        }
    )


def _monotone(intrinsics: Intrinsics) -> bool:
    """Whether pixels move away from the centre along every ray to the border of the image."""
    pinhole = Pinhole.from_settings(intrinsics)
    w, h = pinhole.size
    t = np.linspace(0.0, 1.0, 33)
    border = np.concatenate(
        [np.c_[t * w, 0 * t], np.c_[t * w, 0 * t + h], np.c_[0 * t, t * h], np.c_[0 * t + w, t * h]]
    )
    rays = pinhole.normalise(border)
    if not np.isfinite(rays).all():
        return False
    steps = np.linspace(0.0, 1.0, 65)[:, None, None] * rays
    pixels = pinhole.project(np.concatenate([steps, np.ones_like(steps[..., :1])], axis=-1))
    away = np.linalg.norm(pixels - pinhole.centre, axis=-1)
    return bool((np.diff(away, axis=0) > 0.0).all())


def certify_cameras(
    cameras: Sequence[SurveyedCamera],
    target: FreeTargetClass,
    *,
    range_m: float,
    height_m: float = 0.0,
    e0_m: float = 3.0,
    growth: GrowthModel | None = None,
    off_max_s: float | None = None,
    on_min_s: float | None = None,
    pixel_class: str | None = None,
) -> tuple[Certified, Views, list[str], list[str]]:
    """Certify surveyed cameras of an open site; also return their views, their names and warnings.

    A ``pixel_class`` (EN 62676-4:2015) says how far each camera sees, in place of ``range_m``.
    """
    frusta, warnings = [], []
    for camera in cameras:
        reach = range_m if pixel_class is None else class_range_m(camera.intrinsics, pixel_class)
        frustum, share = usable_frustum(camera.name, camera.intrinsics, min(1.0, 0.1 * reach), reach)
        if share < 1.0:
            warnings.append(
                f"{camera.name}: its distortion folds the image over before the border; the view is cut to the inner "
                f"{share:.0%} of the image"
            )
        frusta.append(frustum.in_world(camera.p_world, camera.q_world))
    names = [camera.name for camera in cameras]
    views = views_of(frusta, np.array([camera.p_world for camera in cameras]))
    report: dict[str, Any] = certify_open_site(
        views, names, target, height_m=height_m, off_max_s=off_max_s, on_min_s=on_min_s, e0_m=e0_m, growth=growth
    )  # fmt: skip
    report["constants"] = {
        "range_m": range_m if pixel_class is None else None,
        "class": pixel_class,
        "height_m": height_m,
        "initial_error_m": e0_m,
        "off_max_s": off_max_s,
    }
    report["warnings"] = warnings
    ground = ground_views(views, names, height_m, target.extent_m)
    outlines = [ring for g in ground for ring in g.rings]
    limit = Limit(None, off_max_s, "as asked for")
    promise = free_promise(report["target_class"], (), len(names), limit, None)
    lines = free_lines(report, ground)
    return Certified(with_claims(report, promise), outlines, lines, promise), views, names, warnings


def read_sensors(path: Path, network: Path, merge_m: float = 10.0) -> tuple[Sensor, ...]:
    """Read cameras from a CSV table or from the detectors of a SUMO additional file."""
    if path.name.endswith((".xml", ".xml.gz")):
        return read_detectors(path, network, merge_m)
    if path.name.endswith(".csv"):
        return read_sensor_table(path)
    raise ConfigError(f"--cameras {str(path)!r}: a .csv table or a SUMO .add.xml was expected")


def sensor_views(sensors: Sequence[Sensor], footprint_m: float, height_m: float = 20.0) -> Views:
    """Return the views of cameras that look straight down from ``height_m``, on a square of road."""
    sides = {s.footprint_m or footprint_m for s in sensors}
    if len(sides) > 1:
        raise ConfigError(f"footprints {sorted(sides)}: one size for all cameras is supported")
    return nadir_views(np.array([[s.x_m, s.y_m] for s in sensors]), height_m, sides.pop())


def certify_road_cameras(
    network: Path,
    cameras: Path,
    target: RoadTargetClass,
    *,
    footprint_m: float,
    off_max_s: float | None,
    on_min_s: float,
    off_max_m: float | None = None,
    limit_source: str = "stated",
    traffic: Path | None = None,
    height_m: float = 0.5,
    growth: GrowthModel | None = None,
    search_m: float = float("inf"),
    own_limits: bool = False,
) -> Certified:
    """Certify cameras over a city's roads for road-bound targets, checked against ``traffic`` if given.

    ``own_limits``: the targets' greatest speed is the network's highest speed limit.
    """
    site, sensors = read_road_site(network), read_sensors(cameras, network)
    target = site.with_limits(target) if own_limits else target
    if off_max_s is not None:  # a limit in seconds is one in metres at the least speed
        site = replace(site, roads=site.paced(target.v_lo_mps))
    views = sensor_views(sensors, footprint_m)
    names = [s.name for s in sensors]
    report, gaps, tables = certify_road_site(
        site.roads,
        views,
        names,
        target,
        height_m=height_m,
        off_max_s=off_max_s,
        on_min_s=on_min_s,
        growth=growth,
        search_m=search_m,
        off_max_m=off_max_m,
        limit_source=limit_source,
        constants={
            "off_max_s": off_max_s,
            "off_max_m": off_max_m,
            "on_min_s": on_min_s,
            "footprint_m": footprint_m,
            "limit_source": limit_source,
        },
    )
    blind = report["promise"]["blind_cameras"]  # type: ignore[index]
    report["warnings"] = [f"camera {c['name']} sees no road: {c['reason']}" for c in blind]
    report["network"] |= {"roads_km": site.edges_km, "arcs": site.roads.n_arcs}  # type: ignore[operator]
    if traffic is not None:
        report["check"] = check_traffic(
            read_traffic(traffic), views, site.roads, target, off_max_m, off_max_s
        )
    promised = report["promise"]["verdict"] == "certified"  # type: ignore[index]
    pieces = road_segments_with_verdict(site.roads, gaps, tables["unseen"], promised)
    ground = ground_views(views, names, height_m, target.extent_m)
    outlines = [ring for g in ground for ring in g.rings]
    return Certified(report, outlines, road_lines(pieces))
