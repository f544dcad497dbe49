from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from camnet.control.planner import Curve, box, cylinder, ellipsoid, from_shape, sphere
from camnet.control.planner.obstacles import pack
from camnet.errors import WorldError
from camnet.geometry.regions import BoxRegion, CylinderRegion
from camnet.geometry.settings import ExtrudedPolygon

SEEDS = st.integers(0, 2**31 - 1)


def turn(rng):
    return Rotation.random(rng=rng).as_matrix()


@given(SEEDS)
def test_ellipsoid_distance_is_that_of_a_minimiser_over_its_surface(seed):
    rng = np.random.default_rng(seed)
    half, axes, center = rng.uniform(0.3, 4.0, 3), turn(rng), rng.normal(size=3)
    p = center + axes @ (rng.normal(size=3) * half * rng.uniform(0.1, 2.0))
    d = ellipsoid(center, half, axes).signed_distance(p)
    local = (p - center) @ axes

    def away(angles):
        a, b = angles
        on = half * np.array([np.cos(a) * np.cos(b), np.sin(a) * np.cos(b), np.sin(b)])
        return np.sum((on - local) ** 2)

    starts = [(a, b) for a in np.linspace(-np.pi, np.pi, 7) for b in (-1.0, 0.0, 1.0)]
    chosen = sorted(starts, key=away)[:4]
    best = min(minimize(away, s, method="BFGS", options={"gtol": 1e-10}).fun for s in chosen)
    inside = np.sum((local / half) ** 2) < 1.0
    assert abs(d) <= np.sqrt(best) + 1e-7
    assert d == pytest.approx(-np.sqrt(best) if inside else np.sqrt(best), abs=1e-5)


def test_ellipsoid_distance_at_its_centre_and_axes():
    e = ellipsoid((0, 0, 0), (1.0, 2.0, 3.0))
    assert e.signed_distance((0, 0, 0)) == pytest.approx(-1.0, abs=1e-6)
    assert e.signed_distance((0, 0, 5)) == pytest.approx(2.0, abs=1e-7)
    assert sphere((1, 1, 1), 0.5).signed_distance((1, 1, 3)) == pytest.approx(1.5)


@given(SEEDS)
def test_box_and_cylinder_agree_with_the_regions(seed):
    rng = np.random.default_rng(seed)
    low = rng.uniform(-2, 0, 3)
    high = low + rng.uniform(0.5, 3, 3)
    p = rng.uniform(-4, 4, 3)
    ours = box(0.5 * (low + high), 0.5 * (high - low)).signed_distance(p)
    assert ours == pytest.approx(float(BoxRegion("b", low, high).signed_distance(p)), abs=1e-12)
    solid = cylinder((*low[:2], 0.5 * (low[2] + high[2])), 0.7, 0.5 * (high[2] - low[2]))
    region = CylinderRegion("c", tuple(low[:2]), 0.7, (low[2], high[2]))
    assert solid.signed_distance(p) == pytest.approx(float(region.signed_distance(p)), abs=1e-12)


@given(SEEDS)
def test_segment_clearance_is_the_least_over_the_segment(seed):
    rng = np.random.default_rng(seed)
    half = rng.uniform(0.3, 2.0, 3)
    for make in (ellipsoid, box):
        o = make(rng.normal(size=3), half, turn(rng))
        a, b = rng.normal(scale=3.0, size=(2, 3))
        brute = min(o.signed_distance(a + t * (b - a)) for t in np.linspace(0, 1, 201))
        least = o.segment_clearance(a, b)
        assert least <= brute + 1e-9
        assert least == pytest.approx(brute, abs=0.01 * np.linalg.norm(b - a))


@given(SEEDS)
def test_curve_clearance_is_certified_between_the_samples(seed):
    rng = np.random.default_rng(seed)
    curve = Curve(
        np.cumsum(rng.normal(scale=3.0, size=(6, 3)), axis=0), rng.normal(scale=3.0, size=(6, 3)), 1.0
    )
    still = ellipsoid(rng.normal(scale=2.0, size=3), rng.uniform(0.5, 2.0, 3), turn(rng))
    moving = sphere(rng.normal(scale=2.0, size=3), 0.7, rng.normal(size=3))
    bounds, _ = curve.clearance(pack([still, moving]), 1e-3)
    times = np.linspace(0, curve.duration_s, 1500)
    for bound, o in zip(bounds, (still, moving), strict=True):
        brute = min(o.signed_distance(curve.at(t)[0], t) for t in times)
        assert bound <= brute + 1e-9
        assert bound >= brute - 0.05


def test_curve_is_continuous_with_the_velocity_it_says():
    rng = np.random.default_rng(0)
    curve = Curve(rng.normal(size=(5, 3)), rng.normal(size=(5, 3)), 0.5)
    for t in np.linspace(0.01, 1.99, 40):
        before, after = curve.at(t - 1e-6)[0], curve.at(t + 1e-6)[0]
        np.testing.assert_allclose((after - before) / 2e-6, curve.at(t)[1], atol=1e-4)
    np.testing.assert_allclose(curve.points(4)[4], curve.at(0.5)[0])


def test_a_prism_that_is_a_turned_box_is_taken_exactly():
    corners = np.array([[0, 0], [2, 1], [1.5, 2], [-0.5, 1]], dtype=float)
    o = from_shape(ExtrudedPolygon(type="extruded_polygon", vertices_m=corners.tolist(), z_m=(0, 2)))
    for p in corners:
        assert o.signed_distance((*p, 1.0)) == pytest.approx(0.0, abs=1e-9)


def test_bad_obstacles_are_refused():
    with pytest.raises(WorldError, match="half-axes"):
        ellipsoid((0, 0, 0), (1, 0, 1))
    with pytest.raises(WorldError, match="orthonormal"):
        box((0, 0, 0), (1, 1, 1), np.ones((3, 3)))
