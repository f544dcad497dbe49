"""View frusta against projection, linear programmes and sampling."""

import numpy as np
import pytest
import shapely
from scipy.optimize import linprog
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from camnet.errors import WorldError
from camnet.geometry import frustum as fr
from camnet.geometry import rotations as rot
from camnet.geometry.pinhole import Pinhole
from camnet.geometry.settings import CameraModel, Intrinsics

RNG = np.random.default_rng(8)


def model(near=0.5, far=6.0, distortion=(), cx=331.0):
    return CameraModel(
        name="c",
        intrinsics=Intrinsics(
            width_px=640,
            height_px=368,
            fx_px=410.0,
            fy_px=395.0,
            cx_px=cx,
            cy_px=180.0,
            distortion=distortion,
        ),
        near_m=near,
        far_m=far,
    )


CAMERA = model()
FRUSTUM = fr.Frustum.from_camera(CAMERA)
P, Q = np.array([1.0, 2.0, 3.0]), Rotation.random(random_state=9).as_quat(scalar_first=True)


def test_inside_means_in_the_image_and_in_range():
    points = RNG.uniform([-6, -4, -1], [6, 4, 7], (20_000, 3))
    truth = Pinhole.from_settings(CAMERA.intrinsics)
    expected = truth.in_image(truth.project(points)) & (points[:, 2] >= 0.5) & (points[:, 2] <= 6.0)
    assert 0.05 < expected.mean() < 0.95
    np.testing.assert_array_equal(FRUSTUM.contains(points), expected)
    world = FRUSTUM.in_world(P, Q)
    np.testing.assert_array_equal(world.contains(rot.rotate(Q, points) + P), expected)


def test_a_distorted_frustum_is_inside_the_image():
    for distortion in [(-0.28, 0.09, 0.001, -0.002), (0.2, 0.01, 0.0, 0.0)]:
        camera = model(distortion=distortion)
        frustum = fr.Frustum.from_camera(camera)
        points = RNG.uniform([-6, -4, 0], [6, 4, 7], (20_000, 3))
        inside = points[frustum.contains(points)]
        truth = Pinhole.from_settings(camera.intrinsics)
        assert len(inside) > 1000
        assert truth.in_image(truth.project(inside)).all()


def test_a_lens_that_folds_over_is_refused():
    with pytest.raises(WorldError, match=r"'c': distortion \[-0\.9.*folds the image over"):
        fr.Frustum.from_camera(model(distortion=(-0.9, 0.0, 0.0, 0.0)))


def test_ranges_in_the_wrong_order_are_refused():
    with pytest.raises(WorldError, match=r"'c': near_m 3 must be below far_m 2"):
        fr.Frustum.from_camera(model(near=3.0, far=2.0))


def test_signed_distance_inside_is_the_largest_ball_about_the_point():
    hull = ConvexHull(FRUSTUM.corners)
    points = RNG.uniform(FRUSTUM.corners.min(0), FRUSTUM.corners.max(0), (500, 3))
    inside = points[FRUSTUM.contains(points)]
    peer = np.max(inside @ hull.equations[:, :3].T + hull.equations[:, 3], axis=1)
    np.testing.assert_allclose(FRUSTUM.signed_distance(inside), peer, atol=1e-12)
    depth = -FRUSTUM.signed_distance(inside)
    direction = RNG.normal(size=(2000, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    for c, r in zip(inside[:20], depth[:20], strict=True):
        assert FRUSTUM.contains_ball(c[None], r - 1e-9)[0]
        assert not FRUSTUM.contains_ball(c[None], r + 1e-9)[0]
        assert FRUSTUM.contains(c + (r - 1e-9) * direction).all()
        assert np.max(FRUSTUM.signed_distance(c + (r + 0.05) * direction)) > 0


@pytest.mark.parametrize("depth", [0.7, 2.0, 3.0, 5.7])
def test_largest_ball_at_a_depth_is_the_linear_programme(depth):
    centre, radius = FRUSTUM.inscribed_ball(depth)
    lp = linprog(
        [0, 0, 0, -1],
        A_ub=np.column_stack([FRUSTUM.A, np.ones(6)]),
        b_ub=FRUSTUM.b,
        A_eq=[[0, 0, 1, 0]],
        b_eq=[depth],
        bounds=[(None, None)] * 4,
    )
    assert radius == pytest.approx(lp.x[3], abs=1e-9)
    assert centre[2] == depth
    assert FRUSTUM.contains_ball(centre[None], radius - 1e-12)[0]


def test_largest_ball_of_a_centred_camera_is_bell2019():
    centred = fr.Frustum.from_tangents([-0.8, 0.8, -0.5, 0.5], 0.1, 50.0)
    psi = np.arctan(0.5)
    assert centred.smallest_half_angle() == pytest.approx(psi)
    assert centred.inscribed_ball(4.0)[1] == pytest.approx(4.0 * np.sin(psi))
    assert centred.inscribed_ball(60.0)[1] < 0


def test_many_cameras_at_once_are_the_single_ones():
    single = [
        fr.Frustum.from_camera(model(far=f, cx=c)) for f, c in [(3.0, 300.0), (5.0, 320.0), (8.0, 350.0)]
    ]
    p, q = RNG.normal(size=(3, 3)), Rotation.random(3, random_state=1).as_quat(scalar_first=True)
    points = RNG.normal(size=(7, 3)) * 2
    many = fr.Frustum.stack(single).in_world(p, q)
    assert many.signed_distance(points).shape == (3, 7)
    for i, one in enumerate(single):
        np.testing.assert_allclose(
            many.signed_distance(points)[i], one.in_world(p[i], q[i]).signed_distance(points)
        )
        np.testing.assert_allclose(many.corners[i], one.in_world(p[i], q[i]).corners)
        np.testing.assert_array_equal(
            many.contains_ball(points, 0.2)[i], one.in_world(p[i], q[i]).contains_ball(points, 0.2)
        )
    centres, radii = fr.Frustum.stack(single).inscribed_ball(2.0)
    for i, one in enumerate(single):
        np.testing.assert_allclose(centres[i], one.inscribed_ball(2.0)[0])
        assert radii[i] == pytest.approx(one.inscribed_ball(2.0)[1])


@pytest.mark.parametrize("seed", range(6))
def test_footprint_is_the_cut_with_the_plane(seed):
    rng = np.random.default_rng(seed)
    p = np.array([0.0, 0.0, 2.5])
    q = rot.nadir_gaze(*rng.uniform(-1.2, 1.2, 2), rng.uniform(-3, 3))
    outline = fr.footprint(CAMERA, p, q, 0.3)
    points = np.column_stack([rng.uniform(-7, 7, (5000, 2)), np.full(5000, 0.3)])
    inside = FRUSTUM.in_world(p, q).contains(points)
    if len(outline) == 0:
        assert not inside.any()
        return
    plan = shapely.Polygon(outline)
    assert plan.is_valid
    assert plan.exterior.is_ccw
    np.testing.assert_array_equal(shapely.contains_xy(plan, points[:, 0], points[:, 1]), inside)


def test_no_footprint_where_the_plane_is_not_seen():
    assert fr.footprint(CAMERA, [0, 0, 2], rot.STRAIGHT_DOWN, 5.0).shape == (0, 2)
    assert fr.footprint(CAMERA, [0, 0, 9], rot.STRAIGHT_DOWN, 0.0).shape == (0, 2)


def test_as_a_region_it_is_the_same_body():
    region = FRUSTUM.in_world(P, Q).region("view")
    points = P + RNG.normal(size=(2000, 3)) * 4
    np.testing.assert_array_equal(region.contains(points), FRUSTUM.in_world(P, Q).contains(points))
    np.testing.assert_allclose(fr.frustum_corners(CAMERA), FRUSTUM.corners)
