"""Outlines of views against the test of single places: random cameras, some on walls, among random solids."""

from __future__ import annotations

import numpy as np
import shapely

from camnet.certification.ground_outlines import blind_spots, polygons, solid_outline, view_outlines
from camnet.certification.lens_views import lens_pieces, watch_of
from camnet.certification.planar_shapes import convex_solids
from camnet.certification.sight_lines import Solids, seen_by
from camnet.geometry.frustum import Frustum
from camnet.geometry.pinhole import Pinhole
from camnet.geometry.regions import BoxRegion, CylinderRegion, Region
from camnet.geometry.rotations import look_at, to_matrix
from camnet.geometry.settings import CameraModel, Intrinsics
from camnet.types import Array

_LENS = Intrinsics(width_px=640, height_px=480, fx_px=420.0, fy_px=420.0, cx_px=320.0, cy_px=240.0)


def _solids(rng: np.random.Generator) -> list[Region]:
    out: list[Region] = []
    for k in range(4):
        x, y = rng.uniform(-15.0, 15.0, 2)
        w, d, h = rng.uniform(0.5, 6.0, 3)
        low = 0.0 if k < 3 else rng.uniform(0.5, 2.0)  # the last one hangs
        out.append(BoxRegion(f"box {k}", (x - w, y - d, low), (x + w, y + d, low + h)))
    out.append(CylinderRegion("pillar", tuple(rng.uniform(-10, 10, 2)), rng.uniform(0.2, 2.0), (0.0, 5.0)))
    return out


def _eye(rng: np.random.Generator, solids: list[Region]) -> Array:
    """Return a place in the open, or on a wall of the first box."""
    if rng.random() < 0.4:
        (x0, y0, z0), (x1, y1, z1) = solids[0].bounds
        return np.array([rng.choice([x0, x1]), rng.uniform(y0, y1), rng.uniform(z0, z1)])
    return np.array([*rng.uniform(-20.0, 20.0, 2), rng.uniform(2.0, 8.0)])


def test_outlines_agree_with_places() -> None:
    rng = np.random.default_rng(11)
    camera = CameraModel(name="c", intrinsics=_LENS, near_m=0.5, far_m=25.0)
    places = seen_places = 0
    for _ in range(60):
        regions = _solids(rng)
        eye, height = _eye(rng, regions), float(rng.choice([0.0, 0.3, 1.2]))
        q = look_at(eye, np.array([*rng.uniform(-15.0, 15.0, 2), 0.0]))
        frustum = Frustum.from_camera(camera).in_world(eye, q)
        watch = watch_of(["c"], [frustum], [[]], eye[None], np.array([420.0]))
        parts = [part for region in regions for part in convex_solids(region)]
        outline = view_outlines(watch, parts, height)[0]
        inside = shapely.union_all([solid_outline(*part, height) for part in parts])
        xy = rng.uniform(-25.0, 25.0, (1500, 2))
        xy[:700] = eye[:2] + (xy[:700] - eye[:2]) * 0.6
        points = shapely.points(xy)
        clear = (shapely.distance(outline.boundary, points) > 0.01) & ~shapely.contains(inside, points)
        clear &= shapely.distance(inside.boundary, points) > 0.01
        direct = seen_by(np.c_[xy, np.full(len(xy), height)][:, None], watch.views, Solids.of(parts))[:, 0]
        np.testing.assert_array_equal(shapely.contains(outline, points)[clear], direct[clear])
        places, seen_places = places + int(clear.sum()), seen_places + int(direct[clear].sum())
    assert places > 60_000
    assert seen_places > 0.1 * places


def test_the_whole_image_of_a_distorting_lens_counts() -> None:
    rng = np.random.default_rng(5)
    lens = _LENS.model_copy(update={"distortion": (-0.28, 0.07, 1e-3, -8e-4, 0.0)})
    eye = np.array([0.0, 0.0, 6.0])
    q = look_at(eye, np.array([9.0, 4.0, 0.0]))
    frustum = Frustum.from_camera(CameraModel(name="c", intrinsics=lens, near_m=0.5, far_m=40.0))
    pieces = lens_pieces(lens, 0.5, 40.0, eye, to_matrix(q))
    whole = watch_of(["c"], [frustum.in_world(eye, q)], [pieces], eye[None], np.array([420.0]))
    cut = watch_of(["c"], [frustum.in_world(eye, q)], [[]], eye[None], np.array([420.0]))
    outline = view_outlines(whole, [], 0.0)[0]
    assert outline.area > 1.03 * view_outlines(cut, [], 0.0)[0].area  # corners of the image are part of it
    xy = rng.uniform([-5.0, -30.0], [42.0, 42.0], (20_000, 2))
    points = np.c_[xy, np.zeros(len(xy))]
    camera = (points - eye) @ to_matrix(q)
    pinhole = Pinhole.from_settings(lens)
    pixels = pinhole.project(camera)
    # beyond the image the polynomial is not meant for anything: only places whose ray comes back count
    back = pinhole.normalise(pixels)
    same = np.linalg.norm(back - camera[:, :2] / camera[:, 2:], axis=1) < 1e-6
    direct = pinhole.in_image(pixels) & (camera[:, 2] >= 0.5) & (camera[:, 2] <= 40.0) & same
    places = shapely.points(xy)
    clear = shapely.distance(outline.boundary, places) > 0.15
    np.testing.assert_array_equal(shapely.contains(outline, places)[clear], direct[clear])
    by_places = seen_by(points[:, None], whole.views, Solids.of([])).any(axis=1)
    assert by_places[direct & clear].all()
    assert not by_places[~direct & clear].any()


def test_without_distortion_nothing_is_added() -> None:
    assert lens_pieces(_LENS, 0.5, 20.0, np.zeros(3), np.eye(3)) == []


def test_blind_spots_are_what_is_left() -> None:
    area = shapely.box(0.0, 0.0, 10.0, 10.0)
    views = [shapely.box(-5.0, 0.0, 5.0, 12.0), shapely.Polygon()]
    solid = shapely.box(8.0, 8.0, 12.0, 12.0)
    found = blind_spots(area, views, [solid])
    assert sum(part.area for part in found) == 100.0 - 50.0 - 4.0
    assert polygons(shapely.Polygon()) == []
