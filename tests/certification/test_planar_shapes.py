"""Shadows and regions that are not convex, against rays, grids and the convex code."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from camnet.certification.coverage import cover_roads
from camnet.certification.crossing import RegionAgent, certify_crossing, meeting
from camnet.certification.planar_shapes import (
    PolygonView,
    convex_solids,
    cover_regions,
    inscribed_radius,
)
from camnet.certification.reachable import FreeReach, PlanarView
from camnet.certification.road_arcs import arcs_from_roads
from camnet.certification.shadows import shadow_polygon
from camnet.geometry.regions import build_region
from camnet.geometry.settings import Box, ExtrudedPolygon

L_SHAPE = np.array([[0.0, 0], [6, 0], [6, 2], [2, 2], [2, 6], [0, 6]])
BOX = build_region("box", Box(type="box", min_m=(1.0, -1.0, 0.0), max_m=(2.0, 1.0, 1.5)))


def hits(eye, point, solids):
    """Whether the line of sight meets a solid, on a fine grid along it."""
    x = eye + np.linspace(0.0, 1.0, 4001)[:, None] * (point - eye)
    return any((x @ a.T <= c).all(axis=1).any() for a, c in solids)


def about(point, radius, half_height, count, rng):
    """Points of an upright cylinder about a point, its rims included."""
    angle, share = rng.uniform(0, 2 * np.pi, count), np.sqrt(rng.uniform(0, 1, count))
    share[: count // 2] = 1.0
    z = rng.uniform(-half_height, half_height, count)
    return point + np.c_[radius * share * np.cos(angle), radius * share * np.sin(angle), z]


@pytest.mark.parametrize("eye", [(0.0, 0.0, 4.0), (-3.0, 1.0, 1.2), (1.5, 0.2, 5.0), (0.0, 0.0, -4.0)])
def test_shadow_is_what_rays_cannot_reach(eye):
    eye, extent = np.array(eye), 0.0
    solids = convex_solids(BOX)
    dark = shapely.union_all([shadow_polygon(eye, a, c, 0.1, extent) for a, c in solids])
    rng = np.random.default_rng(0)
    for p in rng.uniform((-1, -3), (9, 3), (150, 2)):
        if shapely.distance(dark.boundary, shapely.Point(p)) < 0.01:
            continue  # the grid along the ray cannot tell
        assert dark.contains(shapely.Point(p)) == hits(eye, np.array([*p, 0.1]), solids)


@pytest.mark.parametrize("eye", [(0.0, 0.0, 4.0), (-3.0, 1.0, 1.2), (1.5, 0.2, 5.0), (1.0, 0.3, 1.2)])
def test_the_shadow_is_widened_and_not_the_occluder(eye):
    """No part of a target outside is hidden; inside, of one grown a little some is. The last eye is on the occluder."""
    eye, extent, rng = np.array(eye), 0.2, np.random.default_rng(0)
    a, c = convex_solids(BOX)[0]
    dark = shadow_polygon(eye, a, c, 0.1, extent)
    outside = 0
    for p in rng.uniform((-1, -3), (9, 3), (60, 2)):
        place, centre = shapely.Point(p), np.array([*p, 0.1])
        ball = about(centre, extent, extent, 60, rng)
        ball = (
            centre
            + (ball - centre) * np.minimum(1.0, extent / np.linalg.norm(ball - centre, axis=1))[:, None]
        )
        if not dark.contains(place):
            outside += 1
            assert not any(hits(eye + 1e-6 * (q - eye), q, [(a, c)]) for q in ball)
        elif shapely.distance(dark.boundary, place) > 0.05:
            nearest = about(centre, 1.3 * extent, extent, 200, rng)
            assert any(hits(eye, q, [(a, c)]) for q in nearest)
    assert outside > 5


def test_a_camera_on_a_wall_sees_up_to_the_wall():
    a, c = convex_solids(BOX)[0]
    eye = np.array([1.0, 0.0, 1.2])  # on the face x = 1, looking towards smaller x
    dark = shadow_polygon(eye, a, c, 0.0, 0.3)
    assert dark.contains(shapely.Point(0.75, 0.0))
    for x in (0.69, 0.0, -5.0):
        assert not dark.intersects(shapely.Point(x, 0.0))
    assert shadow_polygon(eye + np.array([1e-3, 0, 0]), a, c, 0.0, 0.3).contains(
        shapely.Point(-5.0, 0.0)
    )  # within it: nothing


def test_an_eye_inside_or_level_with_the_plane_sees_nothing_for_certain():
    a, c = convex_solids(BOX)[0]
    assert shadow_polygon(np.array([1.5, 0, 1.0]), a, c, 0.0, 0.0).contains(shapely.Point(50, 50))
    assert shadow_polygon(np.array([-9.0, 0, 0.3]), a, c, 0.3, 0.0).contains(shapely.Point(5, 5))


def test_solids_that_are_not_convex_are_split_into_parts_that_fill_them():
    region = build_region(
        "l", ExtrudedPolygon(type="extruded_polygon", vertices_m=[tuple(v) for v in L_SHAPE], z_m=(0.0, 1.0))
    )
    solids = convex_solids(region)
    assert len(solids) > 1
    points = np.random.default_rng(1).uniform((-1, -1, -0.5), (7, 7, 1.5), (500, 3))
    inside = np.any([(points @ a.T <= c + 1e-12).all(axis=1) for a, c in solids], axis=0)
    np.testing.assert_array_equal(inside, region.contains(points))


def test_depth_is_the_largest_disc_inside():
    view = PolygonView(shapely.Polygon(L_SHAPE))
    points = np.random.default_rng(2).uniform(-1, 7, (200, 2))
    depth = view.depth(points)
    for p, r in zip(points, depth, strict=True):
        disc = shapely.Point(p).buffer(max(r, 0.0) * 0.999, quad_segs=64)
        assert (r > 0) == view.shape.contains(shapely.Point(p))
        if r > 0:
            assert view.shape.covers(disc)
            assert not view.shape.covers(shapely.Point(p).buffer(r * 1.01, quad_segs=64))
    # a circle about (r, r) that touches both outer sides and the inner corner: r = sqrt(2) (2 - r)
    assert inscribed_radius(view) == pytest.approx(2 * np.sqrt(2) / (1 + np.sqrt(2)), abs=2e-3)
    assert inscribed_radius(view) <= 2 * np.sqrt(2) / (1 + np.sqrt(2))
    holed = PolygonView(shapely.Polygon(L_SHAPE).difference(shapely.box(0.5, 0.5, 1.0, 1.0)))
    assert holed.depth(np.array([0.75, 0.75])) < 0
    assert PolygonView(shapely.Polygon()).depth(np.zeros((3, 2))).tolist() == [-np.inf] * 3


def test_roads_through_convex_regions_agree_with_the_half_space_code():
    from camnet.certification.coverage import Views

    roads = arcs_from_roads([np.array([[-5.0, 0.4], [9, 0.9], [9, 6]]), np.array([[1.0, -5], [1.5, 9]])])
    square = np.array([[0.0, -2], [4, -2], [4, 3], [0, 3]])
    a, c = convex_solids(build_region("r", Box(type="box", min_m=(0, -2, -1), max_m=(4, 3, 1))))[0]
    corners = np.array([[[0.0, -2, 0], [4, 3, 0]]])
    views = Views.create(a[None, :4], c[None, :4], corners, np.zeros((1, 3)))
    other = cover_roads(roads, views, 0.0, 0.3)
    mine = cover_regions(roads, [square], 0.3, [np.inf])
    np.testing.assert_array_equal(mine.arc, other.arc)
    np.testing.assert_allclose(mine.start_m, other.start_m, atol=1e-9)
    np.testing.assert_allclose(mine.end_m, other.end_m, atol=1e-9)
    assert (mine.depth_m <= other.depth_m + 1e-9).all()
    np.testing.assert_allclose(mine.depth_m, other.depth_m, atol=0.06)
    assert cover_regions(roads, [square], 0.3, [0.5]).depth_m.max() == 0.5


def test_road_through_an_l_shape_leaves_it_and_comes_back():
    roads = arcs_from_roads([np.array([[1.0, 5.0], [5.0, 1.0]])])  # cuts the inner corner
    seen = cover_regions(roads, [L_SHAPE], 0.2, [np.inf])
    assert (seen.arc == 0).sum() == 2
    length = np.hypot(4, 4)
    for s in np.linspace(0, length, 300, endpoint=False)[1:]:
        p = np.array([1.0, 5.0]) + s / length * np.array([4.0, -4.0])
        inside = PolygonView(shapely.Polygon(L_SHAPE)).depth(p) >= 0.2
        rows = seen.arc == 0
        covered = ((seen.start_m[rows] <= s) & (s <= seen.end_m[rows])).any()
        assert covered <= inside  # never more than there is
        if not covered and inside:  # arcs about the inner corner are cut a little
            assert PolygonView(shapely.Polygon(L_SHAPE)).depth(p) < 0.2 * 1.01 + 0.01


def test_an_agent_reaches_straight_what_every_corner_sees():
    agent = RegionAgent(L_SHAPE, 1.5, 0.3, 1.0)
    assert agent.reaches(np.array([1.0, 1.0]))
    assert not agent.reaches(np.array([5.0, 1.0]))
    reach = FreeReach(np.array([5.0, 1.0]), 0.01)
    view = PolygonView(shapely.Polygon(L_SHAPE))
    into = certify_crossing(reach, [view], np.linspace(0, 10, 11), 20.0, 0.0, 0.01)
    met = meeting(reach, into, [agent], 20.0)
    assert met.verdict == "not certified"
    assert "not convex" in met.binding
    fixed = meeting(reach, into, [None], 20.0)  # a fixed camera needs no way
    assert fixed.verdict == "certified"


def test_polygon_and_half_planes_agree_on_a_convex_view():
    square = PlanarView(np.array([[1.0, 0], [-1, 0], [0, 1], [0, -1]]), np.array([2.0, 2, 1, 1]), True)
    polygon = PolygonView(shapely.box(-2, -1, 2, 1))
    inside = np.random.default_rng(3).uniform((-2, -1), (2, 1), (100, 2))
    np.testing.assert_allclose(square.depth(inside), polygon.depth(inside), atol=1e-12)
