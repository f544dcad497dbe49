"""Scale of targets that never rest, from exact poses, and the structure up to scale from images."""

import numpy as np
import pytest

from camnet.errors import DataError
from camnet.estimation.structure.moving import never_at_rest as nar
from camnet.geometry import rotations as rot

T = np.arange(0.0, 40.0, 0.1)
ARMS = np.random.default_rng(5).uniform(-0.25, 0.25, (10, 3))


def wheeled(axle):
    """Origin of a target that drives a wobbly circle; it is ``axle`` ahead of the point that does not slip."""
    t = np.linspace(-1.0, 41.0, 42001)
    yaw = 0.15 * t + 0.3 * np.sin(0.4 * t)
    xy = np.cumsum(0.3 * np.column_stack([np.cos(yaw), np.sin(yaw)]), axis=0) * (t[1] - t[0])
    p = np.column_stack([xy + axle * np.column_stack([np.cos(yaw), np.sin(yaw)]), np.zeros(len(t))])
    at = np.array([np.interp(T, t, x) for x in (*p.T, yaw)]).T
    return at[:, :3] + [5.0, 0.0, 0.0], rot.from_yaw(at[:, 3])


def camera(still=False):
    p = np.column_stack([0.4 * np.sin(0.7 * T), np.cos(0.2 * T), np.full(len(T), 1.0)])
    return np.broadcast_to(p[0], p.shape) if still else p


@pytest.mark.parametrize("axle", [0.0, 0.08])
def test_no_slip_tells_the_scale_in_any_body_axes(axle):
    p, q = wheeled(axle)
    c = camera()
    # axes of the body that have nothing to do with its heading; the scale is 3.7 m
    found = nar.scale_by_no_slip(T, c, (p - c) / 3.7, rot.multiply(q, rot.exp([0.2, -0.4, 1.1])))
    assert found is not None
    assert found.scale == pytest.approx(3.7, rel=4e-3)
    assert abs(found.scale - 3.7) < 4.0 * found.sd + 0.01


def test_a_still_camera_leaves_the_scale_unobservable():
    p, q = wheeled(0.0)
    c = camera(still=True)
    noise = 1e-3 * np.random.default_rng(0).standard_normal((2, *p.shape))
    assert nar.scale_by_no_slip(T, c, (p - c) / 3.7, q) is None
    assert nar.scale_by_no_slip(T, c + noise[0], (p - c) / 3.7 + noise[1], q) is None


def test_too_short_a_run_is_refused():
    with pytest.raises(DataError, match="give at least 4 s"):
        nar.scale_by_no_slip(T[:20], camera()[:20], camera()[:20], np.ones((20, 4)))


def test_known_size_and_height():
    structure = ARMS / 2.5
    long = float(np.linalg.norm(ARMS[0] - ARMS[1]))
    assert nar.scale_by_size(structure, (0, 1), long, 0.01).scale == pytest.approx(2.5)
    with pytest.raises(DataError, match="length_m"):
        nar.scale_by_size(structure, (0, 1), -1.0, 0.01)
    found = nar.scale_by_height(np.full(5, 0.32), 1.0, 0.2, 0.01)
    assert found is not None
    assert found.scale == pytest.approx(2.5)
    assert nar.scale_by_height(np.full(5, 0.01), 1.0, 0.97, 0.01) is None  # about level with the camera


def test_structure_up_to_scale_from_a_turning_target():
    rng = np.random.default_rng(6)
    k = np.arange(24)
    q = rot.exp(np.column_stack([0.1 * np.sin(k), 0.25 * k, 0.0 * k]))
    p = np.column_stack([0.5 * np.sin(0.3 * k), 0.1 * np.cos(k), 3.0 + np.cos(0.2 * k)])
    x = rot.rotate(q[:, None], ARMS) + p[:, None]
    xy = x[..., :2] / x[..., 2:] + 3e-4 * rng.standard_normal((len(k), len(ARMS), 2))
    found = nar.structure_up_to_scale(xy, 3e-4)
    assert np.linalg.norm(found, axis=1).mean() == pytest.approx(1.0)
    a, b = found - found.mean(axis=0), ARMS - ARMS.mean(axis=0)
    u, s, v = np.linalg.svd(a.T @ b)
    assert np.linalg.det(u @ v) > 0.0  # not the mirror image
    away = s.sum() / np.sum(a * a) * a @ u @ v - b
    assert np.sqrt(np.mean(away**2)) < 3e-3


def test_images_that_no_rigid_target_explains_are_refused():
    xy = np.random.default_rng(7).uniform(-0.1, 0.1, (12, 10, 2))
    with pytest.raises(DataError, match="no start leads to a structure"):
        nar.structure_up_to_scale(xy, 3e-4)
