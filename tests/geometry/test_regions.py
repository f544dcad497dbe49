"""Regions: every shape by brute force, by optimisation and by shapely."""

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog, minimize

from camnet.errors import WorldError
from camnet.geometry.polytope import PolytopeRegion, polytope_from_halfspaces
from camnet.geometry.regions import BoxRegion, CylinderRegion, PrismRegion, build_region, overlaps
from camnet.geometry.settings import Box, Cylinder, ExtrudedPolygon, Polytope

RNG = np.random.default_rng(0)
L_SHAPE = [(0, 0), (4, 0), (4, 1.5), (1.5, 1.5), (1.5, 4), (0, 4)]
STAR = [(0, 0), (3, 1), (6, 0), (5, 3), (6, 6), (3, 5), (0, 6), (1, 3)]
REGIONS = [
    build_region("box", Box(min_m=(-1, -2, 0.5), max_m=(3, 1, 2.5))),
    build_region("cylinder", Cylinder(type="cylinder", center_m=(1, 2), radius_m=1.5, z_m=(0.5, 3))),
    build_region(
        "polytope",
        Polytope(
            type="polytope", vertices_m=tuple(map(tuple, RNG.normal(size=(14, 3)) * [2, 2, 1] + [0, 1, 2]))
        ),
    ),
    build_region(
        "cube with points on its faces",
        Polytope(
            type="polytope",
            vertices_m=(*((x, y, z) for x in (0, 1, 2) for y in (0, 1, 2) for z in (0, 2)), (1, 1, 1)),
        ),
    ),
    build_region("l", ExtrudedPolygon(type="extruded_polygon", vertices_m=tuple(L_SHAPE), z_m=(0, 2.5))),
    build_region(
        "star", ExtrudedPolygon(type="extruded_polygon", vertices_m=tuple(STAR[::-1]), z_m=(0, 3.5))
    ),
]


def cloud(region, n, spread=1.0):
    lo, hi = region.bounds
    return np.random.default_rng(n).uniform(lo - spread, hi + spread, (n, 3))


def surface_points(region, n=60_000):
    """Points on the surface, by bisection between pairs of one inside and one outside point, and its corners."""
    points = cloud(region, n, 0.5)
    inside = points[region.contains(points)]
    outside = points[~region.contains(points)]
    k = min(len(inside), len(outside))
    a, b = inside[:k].copy(), outside[:k].copy()
    for _ in range(50):
        middle = 0.5 * (a + b)
        hit = region.contains(middle)[:, None]
        a, b = np.where(hit, middle, a), np.where(hit, b, middle)
    corners = getattr(region, "vertices", np.zeros((0, 3)))  # sampling misses sharp ones
    if isinstance(region, PrismRegion):
        corners = np.array([[x, y, z] for x, y in region.vertices for z in region.height])
    return np.concatenate([a, corners])


@pytest.mark.parametrize("region", REGIONS, ids=lambda r: r.name)
def test_signed_distance_is_the_distance_to_the_surface(region):
    surface = surface_points(region)
    points = cloud(region, 60)
    brute = np.sqrt(np.min(np.sum((points[:, None] - surface[None]) ** 2, axis=-1), axis=1))
    distance = region.signed_distance(points)
    np.testing.assert_allclose(np.abs(distance), brute, atol=0.12)
    assert np.all(np.abs(distance) <= brute + 1e-9)  # never farther than some surface point
    np.testing.assert_array_equal(distance <= 0, region.contains(points))
    np.testing.assert_allclose(region.signed_distance(surface), 0.0, atol=1e-9)
    assert region.signed_distance(points[0]).shape == ()
    assert region.signed_distance(points.reshape(3, 20, 3)).shape == (3, 20)
    assert region.contains(points.reshape(3, 20, 3)).shape == (3, 20)


@pytest.mark.parametrize("region", REGIONS, ids=lambda r: r.name)
def test_signed_distance_has_unit_slope(region):
    points = cloud(region, 300)
    h = 1e-6
    slope = np.stack(
        [
            (region.signed_distance(points + h * e) - region.signed_distance(points - h * e)) / (2 * h)
            for e in np.eye(3)
        ]
    )
    norms = np.linalg.norm(slope, axis=0)
    assert np.all(norms < 1.0 + 1e-6)
    assert np.mean(norms > 1.0 - 1e-6) > 0.97  # except at the ridges


@pytest.mark.parametrize("region", REGIONS, ids=lambda r: r.name)
@pytest.mark.parametrize("share", [0.0, 0.3, 0.9])
def test_project_is_inside_by_the_margin_and_nothing_allowed_is_nearer(region, share):
    margin = share * region.inradius_m
    allowed = cloud(region, 20_000, 0.0)
    allowed = allowed[region.signed_distance(allowed) <= -margin]
    for point in cloud(region, 25, 2.0):
        nearest = region.project(point, margin)
        assert region.signed_distance(nearest) <= -margin + 1e-8
        if region.signed_distance(point) <= -margin:
            np.testing.assert_array_equal(nearest, point)
        if margin == 0.0 and region.signed_distance(point) > 0:
            np.testing.assert_allclose(
                np.linalg.norm(point - nearest), region.signed_distance(point), atol=1e-8
            )
        if len(allowed):
            best = np.sqrt(np.min(np.sum((allowed - point) ** 2, axis=1)))
            assert np.linalg.norm(point - nearest) <= best + 1e-8


def test_polytope_projection_against_a_general_optimiser():
    region = REGIONS[2]
    for point in cloud(region, 10, 3.0):
        peer = minimize(
            lambda x, p=point: np.sum((x - p) ** 2),
            region.center,
            jac=lambda x, p=point: 2 * (x - p),
            constraints={
                "type": "ineq",
                "fun": lambda x: region.b - 0.2 - region.A @ x,
                "jac": lambda x: -region.A,
            },
            method="SLSQP",
            options={"ftol": 1e-14, "maxiter": 300},
        )
        np.testing.assert_allclose(region.project(point, 0.2), peer.x, atol=1e-5)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(0.01, 0.6))
def test_star_polygons_project_as_shapely_buffers(seed, margin):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(4, 12))
    angle = np.sort(rng.uniform(0, 2 * np.pi, n)) + np.arange(n) * 1e-3
    vertices = (rng.uniform(0.7, 3.0, n) * np.exp(1j * angle)).view(float).reshape(-1, 2)
    if not shapely.Polygon(vertices).is_valid:
        return
    region = PrismRegion("random", vertices, (0.0, 10.0))
    eroded = shapely.Polygon(vertices).buffer(-margin, quad_segs=200)
    if eroded.is_empty or margin > region.inradius_m - 1e-3:
        return
    for p in rng.uniform(-4, 4, (10, 2)):
        nearest = region.project([*p, 5.0], margin)
        assert np.linalg.norm(nearest[:2] - p) == pytest.approx(eroded.distance(shapely.Point(p)), abs=2e-4)


@pytest.mark.parametrize("region", REGIONS, ids=lambda r: r.name)
def test_facts_about_a_region(region):
    assert region.signed_distance(region.center) < -0.3 * region.inradius_m
    points = cloud(region, 50_000, 0.1)
    inside = points[region.contains(points)]
    assert np.all((inside >= region.bounds[0]) & (inside <= region.bounds[1]))
    np.testing.assert_allclose(inside.min(axis=0), region.bounds[0], atol=0.5)
    np.testing.assert_array_equal(region.height, region.bounds[:, 2])
    best = -region.signed_distance(inside).min()
    assert best <= region.inradius_m + 1e-3
    assert best >= region.inradius_m - 0.15
    plan = shapely.Polygon(region.footprint())
    assert plan.exterior.is_ccw
    widened = plan.buffer(0.01)
    assert shapely.contains_xy(widened, inside[:, 0], inside[:, 1]).all()


def test_the_center_of_a_hook_is_inside_although_its_centroid_is_not():
    hook = PrismRegion("hook", [(0, 0), (5, 0), (5, 5), (4, 5), (4, 1), (1, 1), (1, 5), (0, 5)], (0, 2))
    assert not shapely.Polygon(hook.vertices).contains(shapely.Polygon(hook.vertices).centroid)
    assert hook.signed_distance(hook.center) <= -0.45


def test_prism_distances_agree_with_shapely():
    region = REGIONS[4]
    plan = shapely.Polygon(L_SHAPE)
    for p in RNG.uniform(-2, 6, (100, 2)):
        planar = plan.exterior.distance(shapely.Point(p)) * (-1 if plan.contains(shapely.Point(p)) else 1)
        assert region.signed_distance([*p, 1.25]) == pytest.approx(max(planar, -1.25), abs=1e-12)


def test_a_polytope_from_half_spaces_is_the_same_body():
    region = REGIONS[2]
    again = polytope_from_halfspaces("again", region.A, region.b)
    points = cloud(region, 2000)
    np.testing.assert_allclose(again.signed_distance(points), region.signed_distance(points), atol=1e-8)


def test_contains_agrees_with_convex_combinations():
    region = REGIONS[2]
    for p in cloud(region, 40, 0.0):
        k = len(region.vertices)
        lp = linprog(np.zeros(k), A_eq=np.vstack([region.vertices.T, np.ones(k)]), b_eq=np.append(p, 1.0))
        assert region.contains(p) == (lp.status == 0)


def random_region(rng, kind):
    at = rng.uniform(-2, 2, 3)
    if kind == "box":
        return BoxRegion("b", at, at + rng.uniform(0.3, 2, 3))
    if kind == "cylinder":
        return CylinderRegion("c", at[:2], rng.uniform(0.3, 1.2), (at[2], at[2] + rng.uniform(0.3, 2)))
    if kind == "polytope":
        return PolytopeRegion("p", at + rng.normal(size=(6, 3)) * 0.8)
    return PrismRegion("e", np.array(STAR) / 3 + at[:2], (at[2], at[2] + rng.uniform(0.3, 2)))


KINDS = ["box", "cylinder", "polytope", "prism"]


@pytest.mark.parametrize("first", KINDS)
@pytest.mark.parametrize("second", KINDS)
def test_overlaps_agrees_with_sampling(first, second):
    rng = np.random.default_rng([KINDS.index(first), KINDS.index(second)])
    seen = set()
    for _ in range(25):
        a, b = random_region(rng, first), random_region(rng, second)
        lo, hi = np.maximum(a.bounds[0], b.bounds[0]), np.minimum(a.bounds[1], b.bounds[1])
        sampled = False
        if np.all(lo < hi):
            points = rng.uniform(lo, hi, (10_000, 3))
            depth = -np.maximum(a.signed_distance(points), b.signed_distance(points))
            sampled = bool(depth.max() > 0)
        verdict = overlaps(a, b)
        assert verdict == overlaps(b, a)
        if sampled:
            assert verdict
        elif verdict:  # sampling can miss a small common part, so search for it
            found = minimize(
                lambda x, a=a, b=b: max(a.signed_distance(x), b.signed_distance(x)),
                0.5 * (lo + hi),
                method="Nelder-Mead",
                options={"xatol": 1e-9, "fatol": 1e-9, "maxiter": 4000},
            )
            assert found.fun < 1e-3
        seen.add(verdict)
    assert seen == {True, False}


def test_regions_that_touch_do_not_overlap():
    a = BoxRegion("a", (0, 0, 0), (1, 1, 1))
    right = BoxRegion("b", (1, 0, 0), (2, 1, 1))
    above = CylinderRegion("c", (0.5, 0.5), 0.4, (1, 2))
    beside = CylinderRegion("d", (0.5, 1.3), 0.3, (0, 1))
    hull = PolytopeRegion("e", [(1, 0, 0), (1, 1, 0), (1, 0, 1), (2, 0, 0), (2, 1, 1)])
    cube = PolytopeRegion("f", [(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    for other in (right, above, beside, hull):
        assert not overlaps(a, other)
        assert not overlaps(cube, other)
    assert overlaps(a, cube)
    assert overlaps(a, BoxRegion("g", (0.999, 0.9, 0.9), (2, 2, 2)))


def test_a_prism_wraps_around_without_overlapping():
    hook = PrismRegion("hook", [(0, 0), (5, 0), (5, 5), (4, 5), (4, 1), (1, 1), (1, 5), (0, 5)], (0, 2))
    assert not overlaps(hook, BoxRegion("b", (1.1, 1.1, 0), (3.9, 5, 2)))
    assert overlaps(hook, BoxRegion("b", (0.9, 1.1, 0), (3.9, 5, 2)))
    assert not overlaps(hook, BoxRegion("b", (0.9, 1.1, 2), (3.9, 5, 3)))


@pytest.mark.parametrize(
    ("build", "words"),
    [
        (
            lambda: BoxRegion("r", (0, 0, 2), (1, 1, 1)),
            ["'r'", "[0.0, 0.0, 2.0]", "[1.0, 1.0, 1.0]", "below"],
        ),
        (lambda: CylinderRegion("r", (0, 0), -1.0, (0, 1)), ["-1.0", "positive"]),
        (lambda: CylinderRegion("r", (0, 0), 1.0, (1, 1)), ["[1, 1]", "lowest first"]),
        (
            lambda: PolytopeRegion("r", [(0, 0, 0), (1, 0, 0), (0, 1, 0)]),
            ["at least four", "[0.0, 1.0, 0.0]"],
        ),
        (lambda: PolytopeRegion("r", [(0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0)]), ["one plane"]),
        (lambda: PrismRegion("r", [(0, 0), (1, 1)], (0, 1)), ["three different points"]),
        (lambda: PrismRegion("r", [(0, 0), (1, 1), (1, 0), (0, 1)], (0, 1)), ["cross", "Self-intersection"]),
        (lambda: PrismRegion("r", [(0, 0), (1, 1), (2, 2)], (0, 1)), ["r"]),
        (lambda: PrismRegion("r", L_SHAPE, (1, 0)), ["[1, 0]"]),
        (lambda: REGIONS[0].project((0, 0, 0), 1.6), ["1.6", "largest margin", " 1 m"]),
        (lambda: REGIONS[1].project((0, 0, 0), 1.6), ["1.6", "1.25"]),
        (lambda: REGIONS[2].project((0, 0, 0), 30.0), ["30"]),
        (lambda: REGIONS[4].project((0, 0, 0), 1.0), ["margin_m = 1 m"]),
        (lambda: REGIONS[4].project((0, 0, 0), float("nan")), ["nan"]),
    ],
)
def test_errors_quote_the_value_and_say_what_is_right(build, words):
    with pytest.raises(WorldError) as error:
        build()
    for word in words:
        assert word in str(error.value)
