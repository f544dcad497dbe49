"""Visibility against OpenCV-style projection, region membership and a counting line-of-sight test."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from camnet.geometry import rotations as rot
from camnet.geometry.pinhole import Pinhole
from camnet.geometry.regions import BoxRegion
from camnet.geometry.settings import CameraModel, Intrinsics
from camnet.sensing.visibility import VisibilityTest, features_world, who_may_see
from camnet.types import Snapshot

CAMERAS = [
    CameraModel(
        name=f"c{i}",
        intrinsics=Intrinsics(width_px=640, height_px=480, fx_px=f, fy_px=f, cx_px=320.0, cy_px=240.0),
        near_m=0.3,
        far_m=8.0,
    )
    for i, f in enumerate([300.0, 420.0, 500.0])
]
SQUARE = np.array([(0.12, 0.12, 0.3), (0.12, -0.12, 0.3), (-0.12, -0.12, 0.3), (-0.12, 0.12, 0.3)])
FEATURES = [SQUARE, np.vstack([SQUARE, [[0.0, 0.0, 0.9]]])]


def scene(rng):
    n_c, n_m = len(CAMERAS), len(FEATURES)
    none = np.zeros((0, 3))
    camera_p = rng.uniform([-2, -2, 2], [2, 2, 3], (n_c, 3))
    return Snapshot(
        t_s=0.0,
        step=0,
        agent_p_world=none,
        agent_q_world=np.zeros((0, 4)),
        agent_v_world=none,
        agent_w_body=none,
        camera_p_world=camera_p,
        camera_q_world=rot.nadir_gaze(*rng.uniform(-0.6, 0.6, (2, n_c)), rng.uniform(-3, 3, n_c)),
        camera_v_world=np.zeros((n_c, 3)),
        camera_w_cam=np.zeros((n_c, 3)),
        target_p_world=np.column_stack([rng.uniform(-2.5, 2.5, (n_m, 2)), np.zeros(n_m)]),
        target_q_world=Rotation.random(n_m, rng=rng).as_quat(scalar_first=True),
        target_v_world=np.zeros((n_m, 3)),
        target_w_body=np.zeros((n_m, 3)),
    )


def expected(snapshot, regions):
    out = np.zeros((len(CAMERAS), len(FEATURES)), dtype=bool)
    for c, camera in enumerate(CAMERAS):
        pinhole = Pinhole.from_settings(camera.intrinsics)
        p, q = snapshot.camera_p_world[c], snapshot.camera_q_world[c]
        for m, features in enumerate(FEATURES):
            points = features_world(snapshot.target_p_world[m], snapshot.target_q_world[m], features)
            pixels = pinhole.project_world(points, p, q)
            depth = (points - p) @ rot.to_matrix(q)[:, 2]
            seen = pinhole.in_image(pixels).all() and (depth >= 0.3).all() and (depth <= 8.0).all()
            region = regions[c]
            out[c, m] = seen and (region is None or region.contains(snapshot.target_p_world[m]))
    return out


def test_features_in_the_world_agree_with_scipy():
    q = Rotation.random(5, random_state=1)
    p = np.arange(15.0).reshape(5, 3)
    points = features_world(p, q.as_quat(scalar_first=True), SQUARE)
    for i in range(5):
        np.testing.assert_allclose(points[i], q[i].apply(SQUARE) + p[i], atol=1e-13)


def test_visibility_is_projection_and_region_membership():
    regions = [BoxRegion("a", (-2, -2, 0), (0.5, 2, 3)), None, BoxRegion("b", (0, 0, 0), (2, 2, 3))]
    test = VisibilityTest(CAMERAS, FEATURES, regions)
    rng = np.random.default_rng(0)
    counts = np.zeros((3, 2))
    for _ in range(400):
        snapshot = scene(rng)
        visible = test(snapshot)
        np.testing.assert_array_equal(visible, expected(snapshot, regions))
        np.testing.assert_array_equal(visible, test.in_view(snapshot))
        counts += visible
    assert (counts > 5).all()
    assert (counts < 395).all()


def test_only_pairs_in_view_ask_for_sight_lines_and_one_blocked_point_hides_the_target():
    test = VisibilityTest(CAMERAS, FEATURES, [None, None, None])
    rng = np.random.default_rng(1)
    partly = 0
    for _ in range(200):
        snapshot = scene(rng)
        in_view = test.in_view(snapshot)
        asked = []

        def rays_clear(origins, points, asked=asked):
            asked.append((origins, points))
            return points[:, 2] < 0.4  # hides the tall point of the second target

        visible = test(snapshot, rays_clear)
        sizes = np.array([len(f) for f in FEATURES])
        assert sum(len(o) for o, _ in asked) == (in_view * sizes).sum()
        for c, m in np.argwhere(in_view):
            points = features_world(snapshot.target_p_world[m], snapshot.target_q_world[m], FEATURES[m])
            assert visible[c, m] == (points[:, 2] < 0.4).all()
            rows = [np.any(np.all(np.isclose(asked[0][1], p), axis=1)) for p in points]
            assert all(rows)
            assert (asked[0][0] == snapshot.camera_p_world[c]).all(axis=1).sum() >= len(points)
        assert not (visible & ~in_view).any()
        partly += (in_view & ~visible).any()
    assert 10 < partly < 190


def test_nothing_in_view_asks_nothing():
    test = VisibilityTest(CAMERAS, FEATURES, [BoxRegion("far", (90, 90, 0), (91, 91, 1))] * 3)

    def fail(origins, points):
        raise AssertionError

    assert not test(scene(np.random.default_rng(2)), fail).any()


def test_one_region_a_camera():
    with pytest.raises(ValueError, match="3 cameras but 1 regions"):
        VisibilityTest(CAMERAS, FEATURES, [None])


def test_pairs_that_are_ruled_out_are_not_looked_at():
    """Ruling out before looking gives what masking afterwards gives, and asks for no sight line in vain."""
    test, rng = VisibilityTest(CAMERAS, FEATURES, [None, None, None]), np.random.default_rng(3)
    for _ in range(50):
        snapshot, asked = scene(rng), []

        def rays_clear(origins, points, asked=asked):
            asked.append(len(points))
            return points[:, 0] < 1.0

        inside, working = rng.random((2, 3)) < 0.6, rng.random(3) < 0.8
        allowed, region = who_may_see(inside, working, 2)
        masked = test(snapshot, lambda o, p: p[:, 0] < 1.0)
        masked[:2] &= inside[:, :2].T  # the third camera stands: its region is no bound
        masked &= working[:, None]
        np.testing.assert_array_equal(test(snapshot, rays_clear, allowed), masked)
        sizes = np.array([len(f) for f in FEATURES])
        assert sum(asked) == (test.in_view(snapshot) & allowed) @ sizes @ np.ones(3)
        np.testing.assert_array_equal(region, np.where(inside.any(axis=1), inside.argmax(axis=1), -1))
