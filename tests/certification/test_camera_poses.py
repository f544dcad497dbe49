"""Views of moved, raised and tilted cameras against projection, and the search for the smallest change."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from camnet.certification.benchmark import nadir_views
from camnet.certification.camera_poses import PoseChange, changed_view, smallest_changes
from camnet.certification.coverage import cover_roads
from camnet.certification.road_arcs import arcs_from_polylines


def inside(views, points):
    return (points @ views.normals[0].T <= views.offsets[0] + 1e-9).all(axis=1)


def projected(points, centre, height, footprint, change):
    """Pixel coordinates by an own route: rotate the optical axis with spherical angles, project, compare tangents."""
    eye = np.array([centre[0] + change.east_m, centre[1] + change.north_m, height + change.up_m])
    b, f = change.tilt_rad, change.towards_rad
    z = np.array([math.sin(b) * math.cos(f), math.sin(b) * math.sin(f), -math.cos(b)])
    # the image's axes are those of the camera that looks straight down, turned by the same rotation
    k = np.array([-math.sin(f), math.cos(f), 0.0])
    x0 = np.array([1.0, 0, 0])
    x = x0 * math.cos(b) + np.cross(k, x0) * math.sin(-b) + k * (k @ x0) * (1 - math.cos(b))
    y = np.cross(z, x)
    rays = (points - eye) @ np.stack([x, y, z], axis=1)
    t = 0.5 * footprint / height
    depth = rays[:, 2]
    ok = (depth > 0.01 * eye[2]) & (depth < 2.0 * eye[2])
    return ok & (np.abs(rays[:, 0]) < t * depth) & (np.abs(rays[:, 1]) < t * depth)


@pytest.mark.parametrize(
    "change",
    [
        PoseChange(),
        PoseChange(east_m=4.0, north_m=-3.0, up_m=6.0),
        PoseChange(tilt_rad=0.4, towards_rad=0.0),
        PoseChange(tilt_rad=0.3, towards_rad=2.1, up_m=3.0),
    ],
)
def test_a_changed_view_is_what_projects_into_the_image(change):
    rng = np.random.default_rng(0)
    points = np.c_[rng.uniform(-60, 60, (4000, 2)), rng.uniform(0, 2, 4000)]
    centre = np.array([5.0, 2.0])
    mine = inside(changed_view(centre, 20.0, 30.0, change), points)
    other = projected(points, centre, 20.0, 30.0, change)
    assert other.sum() > 50
    assert (mine != other).mean() < 1e-3


def test_no_change_is_the_camera_that_stands():
    roads = arcs_from_polylines([np.array([[-50.0, 1.0], [60.0, 4.0]])], [[]])
    centre = np.array([[3.0, 2.0]])
    before = cover_roads(roads, nadir_views(centre, 20.0, 30.0), 0.5, 1.0)
    after = cover_roads(roads, changed_view(centre[0], 20.0, 30.0, PoseChange()), 0.5, 1.0)
    np.testing.assert_allclose(after.start_m, before.start_m, atol=1e-9)
    np.testing.assert_allclose(after.end_m, before.end_m, atol=1e-9)


def test_smallest_change_by_hand():
    """A point 20 m to the east must come into a view of +-15 m: move 5 m, or raise by 20/15, or tilt."""
    point = np.array([[20.0, 0.0, 0.0]])
    found = smallest_changes(
        lambda change: bool(inside(changed_view(np.zeros(2), 20.0, 30.0, change), point)[0]), 20.0, 30.0
    )
    amounts = {f.kind: f.amount for f in found}
    half = math.atan2(15, 20)
    assert amounts["move"] == pytest.approx(5.0, rel=0.05)
    assert amounts["raise"] == pytest.approx(20 / 0.75 - 20, rel=0.05)
    assert amounts["tilt"] == pytest.approx(math.degrees(math.atan2(20, 20) - half), rel=0.08)
    assert all(a.cost <= b.cost for a, b in itertools.pairwise(found))
    assert min(amounts.values()) > 0
    assert smallest_changes(lambda _: False, 20.0, 30.0) == []
