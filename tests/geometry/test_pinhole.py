"""The pinhole camera against OpenCV."""

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from camnet.geometry import pinhole as ph
from camnet.geometry import rotations as rot
from camnet.geometry.settings import Intrinsics

RNG = np.random.default_rng(5)
DISTORTIONS = [
    (),
    (-0.28, 0.09, 0.001, -0.002),
    (-0.3, 0.12, 0.0005, 0.0007, -0.02),
    (0.4, -0.1, 0.001, 0.001, 0.01, 0.6, -0.05, 0.02),
    (0.1, -0.05, 0.001, 0.001, 0.01, 0.2, -0.05, 0.02, 0.003, -0.001, 0.002, 0.001),
    (0.1, -0.05, 0.001, 0.001, 0.01, 0.2, -0.05, 0.02, 0.003, -0.001, 0.002, 0.001, 0.03, -0.05),
]


def camera(distortion=()):
    return ph.Pinhole.from_settings(
        Intrinsics(
            width_px=640,
            height_px=368,
            fx_px=410.0,
            fy_px=395.0,
            cx_px=331.0,
            cy_px=180.0,
            distortion=distortion,
        )
    )


@pytest.mark.parametrize("distortion", DISTORTIONS, ids=len)
def test_projection_agrees_with_opencv(distortion):
    cam = camera(distortion)
    q = Rotation.random(random_state=2).as_quat(scalar_first=True)
    p = RNG.normal(size=3)
    points_cam = RNG.uniform([-1, -0.6, 1.5], [1, 0.6, 4], (200, 3))
    points_world = rot.rotate(q, points_cam) + p
    r, t = ph.extrinsics_from_camera_pose(ph.Pose(p, q))
    peer, _ = cv2.projectPoints(
        points_world, cv2.Rodrigues(r)[0], t, cam.matrix, np.array(distortion or [0.0] * 4)
    )
    np.testing.assert_allclose(cam.project_world(points_world, p, q), peer[:, 0], atol=1e-8)
    np.testing.assert_allclose(
        cam.project(points_cam.reshape(10, 20, 3)).reshape(-1, 2), peer[:, 0], atol=1e-8
    )


@pytest.mark.parametrize("distortion", DISTORTIONS, ids=len)
def test_unproject_is_the_inverse_over_the_whole_image(distortion):
    cam = camera(distortion)
    pixels = np.stack(np.meshgrid(np.linspace(0, 640, 23), np.linspace(0, 368, 17)), axis=-1)
    rays = cam.unproject(pixels)
    np.testing.assert_allclose(np.linalg.norm(rays, axis=-1), 1.0)
    np.testing.assert_allclose(cam.project(3.0 * rays), pixels, atol=1e-7)


def test_points_behind_have_no_pixel_and_are_not_in_the_image():
    cam = camera()
    pixels = cam.project([[0.0, 0.0, -1.0], [0.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    assert np.isnan(pixels[:2]).all()
    np.testing.assert_array_equal(cam.in_image(pixels), [False, False, True])


def test_pixels_that_no_ray_reaches_are_nan():
    # 1 - 0.4 r^2 makes the radius x (1 - 0.4 x^2) at most 0.61 wide
    cam = camera((-0.4, 0.0, 0.0, 0.0))
    assert np.isnan(cam.normalise([331.0 + 410 * 0.7, 180.0])).all()
    assert np.isfinite(cam.normalise([331.0 + 410 * 0.5, 180.0])).all()


def test_field_of_view_of_a_centred_camera():
    cam = ph.Pinhole.from_settings(
        Intrinsics(width_px=640, height_px=480, fx_px=420.0, fy_px=420.0, cx_px=320.0, cy_px=240.0)
    )
    np.testing.assert_allclose(cam.field_of_view(), [2 * np.arctan(320 / 420), 2 * np.arctan(240 / 420)])


def test_extrinsics_round_trip_and_match_their_definition():
    q, p = Rotation.random(random_state=4).as_quat(scalar_first=True), np.array([1.0, -2.0, 3.0])
    r, t = ph.extrinsics_from_camera_pose(ph.Pose(p, q))
    np.testing.assert_allclose(r @ p + t, 0.0, atol=1e-14)
    back = ph.camera_pose_from_extrinsics(r, t)
    np.testing.assert_allclose(back.p, p, atol=1e-14)
    assert rot.angle_between(back.q, q) < 1e-7
