"""Visibility on the ground against OpenCV's projection, and footprints against visibility."""

import cv2
import numpy as np
import pytest
from shapely import Point

from camnet.estimation.crossing.views import CameraViews, fold_radius
from camnet.geometry import rotations
from camnet.geometry.pinhole import Pinhole
from camnet.geometry.settings import Intrinsics


def looking(position, at, **changes):
    """Views of one camera at a place that looks at another."""
    forward = np.subtract(at, position) / np.linalg.norm(np.subtract(at, position))
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    q = rotations.from_matrix(np.stack([right, np.cross(forward, right), forward], axis=1))
    intrinsics = {
        "width_px": 1920,
        "height_px": 1080,
        "fx_px": 1500.0,
        "fy_px": 1450.0,
        "cx_px": 950.0,
        "cy_px": 530.0,
    }
    intrinsics["distortion"] = changes.pop("distortion", ())
    return Pinhole.from_settings(Intrinsics(**intrinsics)), np.array(position, dtype=float), q


def views_of(*cameras, **changes):
    pinholes, p, q = zip(*cameras, strict=True)
    return CameraViews(pinholes, np.array(p), np.array(q), **changes)


LENS = (-0.35, 0.12, 0.001, -0.002, 0.01)


def test_seen_is_what_opencv_projects_into_the_image():
    camera = looking((5.0, -3.0, 8.0), (25.0, 10.0, 0.0), distortion=LENS)
    views = views_of(camera, height_m=1.0, range_cap_m=40.0, near_m=2.0)
    points = np.random.default_rng(0).uniform(-50.0, 60.0, (4000, 2))
    world = np.column_stack([points, np.ones(len(points))])
    pinhole, p, q = camera
    r = rotations.to_matrix(q).T
    pixels = cv2.projectPoints(world, r, -r @ p, pinhole.matrix, np.array(LENS))[0][:, 0]
    depth = (world - p) @ r[2]
    reach = np.linalg.norm(world - p, axis=1)
    radius = np.linalg.norm((world - p) @ r[:2].T, axis=1) / np.abs(depth)
    expected = (depth > 2.0) & (reach <= 40.0) & (radius < fold_radius(pinhole))
    expected &= np.all((pixels >= 0) & (pixels <= [1920, 1080]), axis=1)
    found = views.distances(points)[:, 0]
    assert expected.sum() > 100
    np.testing.assert_array_equal(np.isfinite(found), expected)
    np.testing.assert_allclose(found[expected], reach[expected])


def test_the_fold_is_where_the_distorted_radius_turns():
    k1 = -0.3
    pinhole = looking((0, 0, 5), (5, 0, 0), distortion=(k1, 0.0, 0.0, 0.0))[0]
    assert fold_radius(pinhole) == pytest.approx(np.sqrt(-1.0 / (3.0 * k1)), abs=2e-3)
    assert fold_radius(looking((0, 0, 5), (5, 0, 0))[0]) == np.inf


def test_points_beyond_the_fold_are_not_seen():
    camera = looking((0.0, 0.0, 5.0), (20.0, 0.0, 5.0), distortion=(-0.6, 0.0, 0.0, 0.0))
    beside = np.array([[2.0, -2.6]])  # far outside of the view; the polynomial folds it back into the picture
    pixel = camera[0].project_world(np.append(beside[0], 5.0), camera[1], camera[2])
    assert camera[0].in_image(pixel)
    assert views_of(camera, height_m=5.0).camera_of(beside)[0] == -1


def test_the_nearest_of_several_cameras_sees():
    far, near = looking((0.0, 0.0, 6.0), (30.0, 0.0, 0.0)), looking((50.0, 0.0, 6.0), (30.0, 0.0, 0.0))
    views = views_of(far, near)
    assert list(views.camera_of(np.array([[20.0, 0.0], [36.0, 0.0], [25.5, 0.0]]))) == [0, 1, 1]
    assert views.camera_of(np.array([[30.0, 40.0]]))[0] == -1


def test_range_cap_counts_the_distance_to_the_optical_centre():
    camera = looking((0.0, 0.0, 6.0), (40.0, 0.0, 0.0))
    inside = np.sqrt(50.0**2 - 6.0**2)
    views = views_of(camera, range_cap_m=50.0)
    assert list(views.camera_of(np.array([[inside - 0.01, 0.0], [inside + 0.01, 0.0]]))) == [0, -1]


def test_footprints_are_the_ground_that_is_seen():
    camera = looking((3.0, 4.0, 6.0), (25.0, 10.0, 0.0), distortion=LENS)
    views = views_of(camera, range_cap_m=60.0)
    shape = views.footprints()[0]
    points = np.random.default_rng(1).uniform(-20.0, 80.0, (1500, 2))
    for point, seen in zip(points, views.camera_of(points) == 0, strict=True):
        place = Point(*point)
        if shape.boundary.distance(place) > 0.05:
            assert shape.contains(place) == seen


def test_an_unseen_place_goes_to_the_nearest_footprint():
    left, right = looking((0.0, 0.0, 6.0), (-20.0, 0.0, 0.0)), looking((0.0, 0.0, 6.0), (20.0, 0.0, 0.0))
    views = views_of(left, right, range_cap_m=40.0)
    points = np.array([[-60.0, 0.0], [60.0, 5.0], [20.0, 0.0]])
    assert list(views.nearest_view(points, views.footprints())) == [0, 1, 1]


def test_a_camera_that_looks_up_has_no_footprint_and_attracts_nothing():
    up, down = looking((0.0, 0.0, 6.0), (5.0, 0.0, 30.0)), looking((0.0, 0.0, 6.0), (-20.0, 0.0, 0.0))
    views = views_of(up, down, range_cap_m=40.0)
    shapes = views.footprints()
    assert shapes[0].is_empty
    assert views.nearest_view(np.array([[10.0, 0.0]]), shapes)[0] == 1
