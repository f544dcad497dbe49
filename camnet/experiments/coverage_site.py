"""Sites whose coverage is counted: fixed cameras of a world, surveyed cameras, cameras over a city's roads."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from camnet.certification.coverage import Coverage, cover_roads
from camnet.certification.lens_views import Watch, lens_pieces, watch_of
from camnet.certification.planar_shapes import convex_solids
from camnet.certification.road_arcs import RoadArcs, arcs_from_roads
from camnet.certification.sight_lines import Solids
from camnet.certification.ways import cover_ways, straight_ways
from camnet.config.models import Scenario
from camnet.errors import ConfigError
from camnet.experiments.certify_site import read_sensors, sensor_views, usable_frustum
from camnet.experiments.road_site import read_road_site
from camnet.geometry.frustum import Frustum
from camnet.geometry.pixel_density import class_range_m, focal_px
from camnet.geometry.rotations import to_matrix
from camnet.importers.surveyed_camera import SurveyedCamera
from camnet.simulation.network import build_network
from camnet.types import Array, BoolArray

__all__ = ["CoverageSite", "RoadPart", "road_camera_site", "surveyed_site", "world_site"]

#: cameras nearer than this (m) to their place are not asked about it, in surveyed sites
_NEAR_M = 1.0


@dataclass(frozen=True, eq=False)
class RoadPart:
    """Roads of one width: arcs, which of them count (A,), and half the width; None: the lanes of the arcs say it."""

    arcs: RoadArcs
    counted: BoolArray
    half_width_m: float | None

    def cover(self, watch: Watch, parts: list[tuple[Array, Array]], height_m: float) -> Coverage:
        """Return the stretches of which each camera sees the whole cross-section."""
        if self.half_width_m is None:
            return cover_roads(self.arcs, watch.views, height_m, 0.0, parts)
        ways = straight_ways(self.arcs, 1.0, half_width_m=self.half_width_m)
        return cover_ways(ways, watch.views, Solids.of(parts), np.array([[0.0, 0.0, height_m]]))


@dataclass(frozen=True, eq=False)
class CoverageSite:
    """A site.

    Attributes
    ----------
    name : of the site
    watch : its cameras
    axes : (C, 3) optical axes
    parts : convex solids that block views
    solids : names and outlines (K, 2) of the occluders
    roads : roads by width
    lines : the roads (n, 2) for maps
    margin_m : what is counted around all of it where no area is given
    warnings : what the reader should know
    """

    name: str
    watch: Watch
    axes: Array
    parts: list[tuple[Array, Array]] = field(default_factory=list)
    solids: list[tuple[str, Array]] = field(default_factory=list)
    roads: list[RoadPart] = field(default_factory=list)
    lines: list[Array] = field(default_factory=list)
    margin_m: float = 10.0
    warnings: list[str] = field(default_factory=list)

    def bounds(self, margin_m: float | None) -> tuple[float, float, float, float]:
        """Return the box about cameras, roads and occluders, grown by a margin (default: the site's), m."""
        places = [self.watch.views.position[:, :2], *self.lines, *(outline for _, outline in self.solids)]
        xy, margin = np.concatenate(places), self.margin_m if margin_m is None else margin_m
        (x0, y0), (x1, y1) = (xy.min(axis=0) - margin).tolist(), (xy.max(axis=0) + margin).tolist()
        return x0, y0, x1, y1


def world_site(scenario: Scenario) -> CoverageSite:
    """Return the fixed cameras of a world with its roads and occluders.

    Raises
    ------
    ConfigError
        The world has no fixed cameras.
    """
    network = build_network(scenario)
    specs = network.description.cameras
    if not specs:
        raise ConfigError(
            f"world {scenario.name!r}: coverage is that of fixed cameras, and it has none; the views of its "
            f"{len(scenario.agents)} agents move (camnet certify says what they promise)"
        )
    frusta = [Frustum.from_camera(c.camera).in_world(c.p_world, c.q_world) for c in specs]
    focal = np.array([focal_px(c.camera.intrinsics) for c in specs])
    eyes = np.array([c.p_world for c in specs])
    watch = watch_of([c.name for c in specs], frusta, [[] for _ in specs], eyes, focal)
    warnings = []
    if scenario.agents:
        warnings.append(f"{len(scenario.agents)} agents are not counted: their views move")
    return CoverageSite(
        scenario.name,
        watch,
        np.array([to_matrix(c.q_world)[:, 2] for c in specs]),
        [part for occluder in network.occluders for part in convex_solids(occluder)],
        [(occluder.name, occluder.footprint()) for occluder in network.occluders],
        _roads_of(scenario),
        [_line(np.array(r.points_m, dtype=float), r.closed) for r in scenario.roads],
        warnings=warnings,
    )


def _roads_of(scenario: Scenario) -> list[RoadPart]:
    """Return the roads by width; of both directions one counts."""
    out = []
    for width in sorted({r.width_m for r in scenario.roads}):
        mine = [r for r in scenario.roads if r.width_m == width]
        arcs = arcs_from_roads([np.array(r.points_m, dtype=float) for r in mine], [r.closed for r in mine])
        out.append(RoadPart(arcs, np.arange(arcs.n_arcs) % 2 == 0, 0.5 * width))
    return out


def _line(points: Array, closed: bool) -> Array:
    return np.concatenate([points, points[:1]]) if closed else points


def surveyed_site(
    name: str, cameras: Sequence[SurveyedCamera], range_m: float, pixel_class: str | None = None
) -> CoverageSite:
    """Return surveyed cameras; a class of pixels per metre ends their views in place of ``range_m``.

    The whole image counts, also outside the rectangle that a certificate takes of a distorting lens.
    """
    frusta, more, warnings = [], [], []
    for camera in cameras:
        reach = range_m if pixel_class is None else class_range_m(camera.intrinsics, pixel_class)
        near = min(_NEAR_M, 0.1 * reach)
        frustum, share = usable_frustum(camera.name, camera.intrinsics, near, reach)
        if share < 1.0:
            warnings.append(
                f"{camera.name}: its distortion folds the image over before the border; what lies beyond the fold "
                "counts as unseen"
            )
        rotation = to_matrix(camera.q_world)
        frusta.append(frustum.in_world(camera.p_world, camera.q_world))
        more.append(lens_pieces(camera.intrinsics, near, reach, camera.p_world, rotation))
    watch = watch_of(
        [camera.name for camera in cameras],
        frusta,
        more,
        np.array([camera.p_world for camera in cameras]),
        np.array([focal_px(camera.intrinsics) for camera in cameras]),
    )
    axes = np.array([to_matrix(camera.q_world)[:, 2] for camera in cameras])
    return CoverageSite(name, watch, axes, margin_m=50.0, warnings=warnings)


def road_camera_site(network: Path, cameras: Path, footprint_m: float) -> CoverageSite:
    """Return cameras over a city's roads, of which only the footprint is known: a table, or SUMO's detectors."""
    site, sensors = read_road_site(network), read_sensors(cameras, network)
    views = sensor_views(sensors, footprint_m)
    names = tuple(s.name for s in sensors)
    counted = np.arange(site.roads.n_arcs) < site.edges
    roads = site.roads
    ends = roads.start_xy + roads.piece_length_m[:, None] * roads.direction_xy
    lines = list(np.stack([roads.start_xy, ends], axis=1))
    watch = Watch(names, views, np.arange(len(names)), None)
    axes = np.tile([0.0, 0.0, -1.0], (len(names), 1))
    return CoverageSite(network.name, watch, axes, [], [], [RoadPart(roads, counted, None)], lines)
