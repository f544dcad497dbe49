"""Lines by arc length: shapely, brute force, circles of known length and curvature."""

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from camnet.errors import WorldError
from camnet.geometry.roads import Polyline
from camnet.geometry.settings import Road
from camnet.geometry.smooth_road import SmoothRoad

RNG = np.random.default_rng(6)
LOOP = [
    [4.3, 0.0], [3.6, 1.6], [2.6, 2.6], [1.7, 3.7], [0.0, 4.1], [-1.6, 3.6], [-2.8, 2.7], [-3.6, 1.5],
    [-4.0, 0.0], [-3.8, -1.5], [-2.7, -2.9], [-1.4, -3.7], [0.0, -4.2], [1.5, -3.8], [2.8, -2.7], [3.9, -1.6],
]  # fmt: skip
OPEN = [[0.0, 0.0], [3.0, 1.0], [5.0, -1.0], [9.0, 0.0], [9.5, 4.0]]
LINES = [Polyline(OPEN), Polyline(LOOP, closed=True)]
SMOOTH = [SmoothRoad(OPEN), SmoothRoad(LOOP, closed=True)]
KINDS = ["open", "closed"]


@pytest.mark.parametrize("line", LINES, ids=KINDS)
def test_polyline_agrees_with_shapely(line):
    peer = shapely.LineString(line.points)
    assert line.length == pytest.approx(peer.length)
    s = RNG.uniform(0, line.length, 100)
    ours = line.point(s)
    np.testing.assert_allclose(ours, [peer.interpolate(x).coords[0] for x in s], atol=1e-12)
    points = RNG.uniform(-6, 10, (300, 2))
    arc, lateral = line.project(points)
    np.testing.assert_allclose(np.abs(lateral), [peer.distance(shapely.Point(p)) for p in points], atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(line.point(arc) - points, axis=1), np.abs(lateral), atol=1e-9)


@pytest.mark.parametrize("line", [*LINES, *SMOOTH], ids=["open", "closed", "smooth open", "smooth closed"])
def test_project_undoes_an_offset_to_the_side(line):
    s = np.linspace(0.02, 0.98, 57) * line.length
    t = line.tangent(s)
    left = np.stack([-t[:, 1], t[:, 0]], axis=1)
    for offset in (0.03, -0.03):
        arc, lateral = line.project(line.point(s) + offset * left)
        keep = np.abs(arc - s) < 1e-6  # polylines: not next to a vertex
        assert keep.mean() > 0.8 if isinstance(line, Polyline) else keep.all()
        np.testing.assert_allclose(lateral[keep], offset, atol=1e-9)
    assert line.project(line.point(1.0))[0].shape == ()
    assert line.project(np.zeros((2, 5, 2)))[1].shape == (2, 5)
    assert line.point(np.zeros((2, 5))).shape == (2, 5, 2)


@pytest.mark.parametrize("line", [LINES[1], SMOOTH[1]], ids=["polyline", "smooth"])
def test_closed_lines_wrap(line):
    s = np.array([0.3, 2.0])
    np.testing.assert_allclose(line.point(s + 3 * line.length), line.point(s), atol=1e-10)
    np.testing.assert_allclose(line.point(s - line.length), line.point(s), atol=1e-10)
    np.testing.assert_allclose(line.point(line.length), line.point(0.0), atol=1e-10)


@pytest.mark.parametrize("line", [LINES[0], SMOOTH[0]], ids=["polyline", "smooth"])
def test_open_lines_stop_at_their_ends(line):
    np.testing.assert_allclose(line.point([-5.0, 1e9]), [OPEN[0], OPEN[-1]], atol=1e-10)
    arc, lateral = line.project([[-1.0, -1 / 3], [9.6, 9.0]])
    np.testing.assert_allclose(arc, [0.0, line.length], atol=1e-9)
    np.testing.assert_allclose(np.abs(lateral), [np.hypot(1, 1 / 3), np.hypot(0.1, 5.0)], atol=1e-9)


@pytest.mark.parametrize("road", SMOOTH, ids=KINDS)
def test_a_smooth_road_goes_through_its_points_at_unit_speed(road):
    np.testing.assert_allclose(road.point(road.waypoint_arc), road.points, atol=1e-5)
    s = np.linspace(0, road.length, 4001)
    _, d1, _ = road.derivatives(s)
    np.testing.assert_allclose(np.linalg.norm(d1, axis=1), 1.0, atol=2e-4)
    fine = road.point(np.linspace(0, road.length, 200_001))
    assert np.linalg.norm(np.diff(fine, axis=0), axis=1).sum() == pytest.approx(road.length, rel=1e-6)


@pytest.mark.parametrize("road", SMOOTH, ids=KINDS)
def test_a_smooth_road_is_twice_continuously_differentiable(road):
    h = 1e-5
    s = np.linspace(0.01, road.length - 0.01, 500)
    if road.closed:
        s = np.append(s, [0.0, road.length])
    _, d1, d2 = road.derivatives(s)
    np.testing.assert_allclose((road.point(s + h) - road.point(s - h)) / (2 * h), d1, atol=1e-7)
    before, after = road.derivatives(s - h)[1], road.derivatives(s + h)[1]
    np.testing.assert_allclose((after - before) / (2 * h), d2, atol=2e-3)
    # no jump of the second derivative anywhere, the seam included
    jump = road.derivatives(s + 1e-9)[2] - road.derivatives(s - 1e-9)[2]
    assert np.abs(jump).max() < 1e-5


def test_a_circle_has_the_length_and_curvature_of_a_circle():
    angle = np.linspace(0, 2 * np.pi, 40, endpoint=False)
    road = SmoothRoad(2.0 * np.stack([np.cos(angle), np.sin(angle)], axis=1), closed=True)
    assert road.length == pytest.approx(4 * np.pi, rel=1e-5)
    s = np.linspace(0, road.length, 333)
    # a cubic spline's second derivative is off by (knot angle)^2 / 12 at its knots
    slack = 1.05 * 0.5 * (2 * np.pi / 40) ** 2 / 12
    np.testing.assert_allclose(road.curvature(s), 0.5, atol=slack)
    np.testing.assert_allclose(road.tangent(0.0), [0, 1], atol=1e-6)
    clockwise = SmoothRoad(2.0 * np.stack([np.cos(-angle), np.sin(-angle)], axis=1), closed=True)
    np.testing.assert_allclose(clockwise.curvature(s), -0.5, atol=slack)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_project_on_a_smooth_road_by_brute_force(seed):
    rng = np.random.default_rng(seed)
    road = SMOOTH[seed % 2]
    points = rng.uniform(-7, 11, (20, 2))
    fine_s = np.linspace(0, road.length, 20_001)
    fine = road.point(fine_s)
    best = np.min(np.linalg.norm(points[:, None] - fine[None], axis=2), axis=1)
    s, lateral = road.project(points)
    np.testing.assert_allclose(np.abs(lateral), np.linalg.norm(points - road.point(s), axis=1), atol=1e-12)
    assert np.all(np.abs(lateral) <= best + 1e-6)


def test_repeated_points_are_one():
    assert Polyline([[0, 0], [0, 0], [1, 0], [1, 0]]).length == 1.0
    assert Polyline([[0, 0], [1, 0], [1, 1], [0, 0]], closed=True).length == pytest.approx(2 + np.sqrt(2))


def test_from_settings():
    road = Road(name="r", points_m=tuple(map(tuple, LOOP)), closed=True)
    assert Polyline.from_settings(road).length == LINES[1].length
    assert SmoothRoad.from_settings(road).length == SMOOTH[1].length


@pytest.mark.parametrize("kind", [Polyline, SmoothRoad])
@pytest.mark.parametrize(
    ("points", "closed", "words"),
    [
        ([[1.0, 2.0]], False, ["'r'", "[[1.0, 2.0]]", "at least 2"]),
        ([[1, 2], [1, 2]], False, ["at least 2"]),
        ([[1, 2], [3, 4]], True, ["closed", "at least 3"]),
        ([[1, 2], [np.nan, 4]], False, ["finite"]),
    ],
)
def test_lines_that_are_none_are_refused(kind, points, closed, words):
    with pytest.raises(WorldError) as error:
        kind(points, closed, "r")
    for word in words:
        assert word in str(error.value)
