"""Drawn planes against the drawn marker (which is held against PyBullet), projections, rays, and each other."""

import cv2
import numpy as np
import pytest

from camnet.errors import ConfigError
from camnet.geometry import rotations as rot
from camnet.geometry.pinhole import Pinhole
from camnet.geometry.settings import Intrinsics
from camnet.sensing.marker import Marker, pattern
from camnet.sensing.marker_view import BLACK, WHITE, Lens, draw_marker
from camnet.sensing.textured_planes import TexturedPlane, checkerboard, draw_planes

LENS = Intrinsics(width_px=320, height_px=240, fx_px=260.0, fy_px=260.0, cx_px=159.5, cy_px=119.5)
CAMERA = Pinhole.from_settings(LENS)
EYE = np.array([0.2, -0.3, 0.4])
Q = rot.look_at(EYE, np.array([3.0, 0.0, 0.2]))


def facing(distance, width, height, texture, shift=(0.0, 0.0)):
    """Plane across the line of sight, its centre at a distance along it."""
    r = rot.to_matrix(Q)
    corner = EYE + r @ np.array([shift[0] - 0.5 * width, shift[1] - 0.5 * height, distance])
    return TexturedPlane(corner, width * r[:, 0], height * r[:, 1], texture)


def test_corners_of_a_drawn_board_are_where_they_project_to():
    texture = checkerboard(8, 6, 40, 40)
    r = rot.to_matrix(rot.multiply(Q, rot.exp(np.array([0.3, -0.4, 0.1]))))
    square = 0.06
    corner = EYE + rot.to_matrix(Q) @ np.array([-0.3, -0.25, 1.1])
    plane = TexturedPlane(corner, 10 * square * r[:, 0], 8 * square * r[:, 1], texture)
    image = np.clip(np.rint(draw_planes([plane], CAMERA, EYE, Q, samples=4)), 0, 255).astype(np.uint8)
    found, corners = cv2.findChessboardCornersSB(image, (7, 5))
    assert found
    i, j = np.meshgrid(np.arange(7), np.arange(5))
    points = corner + square * ((i.ravel() + 2)[:, None] * r[:, 0] + (j.ravel() + 2)[:, None] * r[:, 1])
    pixels = CAMERA.project_world(points, EYE, Q)
    corners = corners.reshape(-1, 2)
    if np.linalg.norm(corners[0] - pixels[0]) > np.linalg.norm(corners[-1] - pixels[0]):
        corners = corners[::-1]
    assert np.abs(np.mean(corners - pixels, axis=0)).max() < 0.05  # no shift of the pixels' grid
    assert np.abs(corners - pixels).max() < 0.25  # what the finder itself errs on squares of 12 pixels


def test_a_drawn_marker_is_the_one_that_is_held_against_pybullet():
    r = rot.to_matrix(rot.exp(np.array([0.2, 0.5, 0.3])))
    across, down = 0.3 * r[:, 0], 0.3 * r[:, 1]
    first = np.array([-0.1, -0.15, 0.9])  # camera frame
    corners = np.array([first, first + across, first + across + down, first + down])
    marker = Marker(7, corners, 0.3, np.zeros(3), rot.IDENTITY)
    plane_now = np.column_stack([across, down, first])
    around = np.full((240, 320), 110.0, dtype=np.float32)
    patch = draw_marker(Lens(LENS), plane_now, np.zeros((3, 3)), marker, around, samples=64)
    want = around.copy()
    h, w = patch.pixels.shape
    want[patch.top : patch.top + h, patch.left : patch.left + w] = patch.pixels
    plate = marker.plate()
    texture = np.rint(BLACK + (WHITE - BLACK) / 255.0 * np.kron(pattern(7), np.ones((40, 40)))).astype(
        np.uint8
    )
    plane = TexturedPlane(plate[0], plate[1] - plate[0], plate[3] - plate[0], texture)
    got = draw_planes([plane], CAMERA, np.zeros(3), rot.IDENTITY, samples=6)
    assert np.abs(got - want).mean() < 0.15
    assert np.abs(got - want).max() < 25.0  # an edge that other rays cut


def test_the_nearer_plane_hides_the_farther_in_any_order():
    far = facing(2.0, 1.0, 1.0, np.full((8, 8), 200, dtype=np.uint8))
    near = facing(1.0, 0.2, 0.2, np.full((8, 8), 50, dtype=np.uint8))
    one = draw_planes([far, near], CAMERA, EYE, Q)
    two = draw_planes([near, far], CAMERA, EYE, Q)
    np.testing.assert_array_equal(one, two)
    assert one[120, 160] == pytest.approx(50.0)
    assert one[120, 200] == pytest.approx(200.0)
    assert one[5, 5] == 110.0


def test_a_floor_that_runs_behind_the_camera_is_read_where_its_rays_hit_it():
    ramp = np.tile(np.linspace(0, 255, 256).astype(np.uint8), (16, 1))
    floor = TexturedPlane(
        np.array([-4.0, -3.0, 0.0]), np.array([8.0, 0.0, 0.0]), np.array([0.0, 6.0, 0.0]), ramp
    )
    image = draw_planes([floor], CAMERA, EYE, Q, background=-1.0)
    v, u = np.mgrid[0:240:7, 0:320:11]
    rays = rot.rotate(Q, CAMERA.unproject(np.stack([u.ravel(), v.ravel()], axis=1)))
    with np.errstate(divide="ignore"):
        along = -EYE[2] / rays[:, 2]
    hit = EYE + along[:, None] * rays
    inside = (along > 0.0) & (np.abs(hit[:, 0]) < 3.9) & (np.abs(hit[:, 1]) < 2.9)
    got = image[v.ravel(), u.ravel()]
    want = (hit[:, 0] + 4.0) / 8.0 * 256.0 - 0.5
    assert inside.sum() > 100
    np.testing.assert_allclose(got[inside], want[inside], atol=2.5)
    assert np.all(got[(along <= 0.0)] == -1.0)


def test_nothing_in_view_leaves_the_background():
    behind = TexturedPlane(
        EYE - 5.0 * np.array([1.0, 0, 0]), np.array([0, 1.0, 0]), np.array([0, 0, 1.0]), ramp8()
    )
    np.testing.assert_array_equal(draw_planes([behind], CAMERA, EYE, Q, background=7.0), 7.0)


def ramp8():
    return np.arange(64, dtype=np.uint8).reshape(8, 8)


def test_a_distorted_lens_is_refused():
    bent = Pinhole.from_settings(LENS.model_copy(update={"distortion": (-0.2, 0.05)}))
    with pytest.raises(ConfigError, match="distortion"):
        draw_planes([], bent, EYE, Q)
