"""Sight lines and pictures: occluders, agents, targets; a target appears where the pinhole model puts it."""

from __future__ import annotations

import numpy as np
import pytest
from world_parts import CAMERA, Straight

from camnet.geometry.rotations import conjugate, look_at, rotate
from camnet.geometry.settings import Box, Cylinder, ExtrudedPolygon, Polytope
from camnet.world import CameraCommand

EYE = np.array([-3.0, 0.5, 4.0])
OCCLUDERS = {
    "box": Box(min_m=(-1, -1, 0), max_m=(-0.5, 1, 3)),
    "cylinder": Cylinder(type="cylinder", center_m=(-0.8, 0), radius_m=0.5, z_m=(0, 3)),
    "polytope": Polytope(
        type="polytope", vertices_m=((-1, -1, 0), (0, -1, 0), (0, 1, 0), (-1, 1, 0), (-0.5, 0, 3))
    ),
    "extruded": ExtrudedPolygon(
        type="extruded_polygon", vertices_m=((-1.2, -1), (0, -1), (0, 1), (-1.2, 1), (-0.4, 0)), z_m=(0, 3)
    ),
}


def brute_force(shape, a, b):
    """Whether any of many points of the segment is inside the shape."""
    import shapely
    from scipy.spatial import ConvexHull

    x = a + np.linspace(0, 1, 2001)[:, None] * (b - a)
    if isinstance(shape, Box):
        return bool(((x > shape.min_m) & (x < shape.max_m)).all(axis=1).any())
    if isinstance(shape, Polytope):
        planes = ConvexHull(np.array(shape.vertices_m)).equations
        return bool((x @ planes[:, :3].T + planes[:, 3] < 0).all(axis=1).any())
    high = (x[:, 2] > shape.z_m[0]) & (x[:, 2] < shape.z_m[1])
    if isinstance(shape, Cylinder):
        return bool((high & (np.hypot(*(x[:, :2] - shape.center_m).T) < shape.radius_m)).any())
    inside = shapely.contains_xy(shapely.Polygon(shape.vertices_m), x[:, 0], x[:, 1])
    return bool((high & inside).any())


@pytest.mark.parametrize("name", OCCLUDERS)
def test_occluders_block_as_brute_force_says(open_world, name):
    shape = OCCLUDERS[name]
    world, _ = open_world(n=0, targets=(), occluders=[("o", shape)])
    rng = np.random.default_rng(4)
    origins = rng.uniform([-4, -2, 0.1], [3, 2, 3.5], (300, 3))
    points = rng.uniform([-4, -2, 0.1], [3, 2, 3.5], (300, 3))
    keep = [i for i in range(300) if not brute_force(shape, origins[i], origins[i] + 1e-6)]
    clear = world.rays_clear(origins[keep], points[keep])
    expected = np.array([not brute_force(shape, origins[i], points[i]) for i in keep])
    assert 20 < expected.sum() < len(keep) - 20
    assert (clear != expected).sum() <= 2  # grazing lines


def test_own_target_never_blocks_others_do(open_world):
    targets = (Straight((1.0, 0, 0), 0.0), Straight((0.4, 0.0, 0), 0.0))
    world, now = open_world(n=0, targets=targets)
    corners = np.array([[x, y, 0.3] for x in (-0.17, 0.17) for y in (-0.17, 0.17)])
    own = now.target_p_world[0] + corners
    high = np.tile([1.0, 0.0, 5.0], (4, 1))
    assert world.rays_clear(high, own).all()
    # from the side, low: the near one is in the way of the far one, not of itself
    low = np.tile([-3.0, 0.0, 0.15], (4, 1))
    assert not world.rays_clear(low, own).any()
    assert world.rays_clear(low, now.target_p_world[1] + corners).all()


def test_agents_block_but_not_themselves(open_world):
    world, now = open_world(n=2, spacing=2.0, targets=())
    a, b = now.camera_p_world
    beyond = b + (b - a)
    assert not world.rays_clear(a[None], beyond[None])[0]
    assert world.rays_clear(a[None], np.array([[0.0, 0.0, 0.0]]))[0]
    assert world.rays_clear(b[None], beyond[None])[0]
    for _ in range(90):  # boxes follow the bodies
        now = world.step(CameraCommand(np.array([[0, 0, 0], [0, 1.0, 0]]), np.zeros((2, 3))))
    assert world.rays_clear(now.camera_p_world[:1], beyond[None])[0]
    assert len(world.rays_clear(np.zeros((0, 3)), np.zeros((0, 3)))) == 0


def test_ground_and_points_on_it_do_not_block(open_world):
    world, _ = open_world(n=0, targets=())
    points = np.array([[0.0, 0.0, 0.0], [5.0, 1.0, -0.5]])
    assert world.rays_clear(np.tile(EYE, (2, 1)), points).all()


def project(point, p, q, width, height):
    k = CAMERA.intrinsics
    x, y, z = rotate(conjugate(q), point - p)
    u = (k.fx_px * x / z + k.cx_px + 0.5) * width / k.width_px - 0.5
    v = (k.fy_px * y / z + k.cy_px + 0.5) * height / k.height_px - 0.5
    return np.array([u, v])


@pytest.mark.parametrize("size", [(320, 200), (160, 100)])
@pytest.mark.parametrize("place", [(1.0, 0.0), (0.2, 1.2), (1.5, -0.6)])
def test_target_appears_at_its_projection(open_world, size, place):
    q = look_at(EYE, np.array([0.8, 0.2, 0.0]))
    target = Straight((*place, 0.0), 0.0)
    world, now = open_world(n=0, targets=(target,), cameras=[("fixed", EYE, q)])
    image = world.render(0, *size).astype(int)
    assert image.shape == (size[1], size[0], 3)
    red = (image[:, :, 0] > 2 * image[:, :, 1]) & (image[:, :, 0] > 80)
    v, u = np.nonzero(red)
    box = np.array([[x, y, z] for x in (-0.175, 0.175) for y in (-0.175, 0.175) for z in (0, 0.3)])
    corners = np.array([project(now.target_p_world[0] + c, EYE, q, *size) for c in box])
    for seen, expected in ((u, corners[:, 0]), (v, corners[:, 1])):
        assert seen.min() == pytest.approx(expected.min(), abs=1.6)
        assert seen.max() == pytest.approx(expected.max(), abs=1.6)


def test_agents_see_the_target_below_and_not_themselves(open_world):
    world, now = open_world(n=1, targets=(Straight((0.3, 0.2, 0), 0.0),))
    image = world.render(0, 160, 100).astype(int)
    red = (image[:, :, 0] > 2 * image[:, :, 1]) & (image[:, :, 0] > 80)
    top = now.target_p_world[0] + [0, 0, 0.3]
    u, v = project(top, now.camera_p_world[0], now.camera_q_world[0], 160, 100)
    assert red[round(v), round(u)]
    assert (image.sum(axis=2) > 150).mean() > 0.95  # no dark body in the way


def test_set_state_poses_everything(open_world):
    world, start = open_world(n=2, targets=(Straight((0.3, 0.2, 0), 0.5),))
    first = world.render(0, 160, 100)
    for _ in range(60):
        world.step(CameraCommand(np.array([[0.5, 0, 0]] * 2), np.zeros((2, 3))))
    assert (world.render(0, 160, 100) != first).any()
    world.set_state(start)
    np.testing.assert_array_equal(world.render(0, 160, 100), first)
    above = start.target_p_world[0] + np.array([[0, 0, 4.0]])
    assert world.rays_clear(above, start.target_p_world[:1] + np.array([[0, 0, 0.3]]))[0]
