from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import PchipInterpolator
from shapely.geometry import MultiLineString, Point

from camnet.errors import WorldError
from camnet.geometry.settings import Road
from camnet.motion.factory import build_motion
from camnet.motion.protocol import TargetMotion, TargetState
from camnet.motion.road_network import RoadNetwork
from camnet.motion.settings import RoadTarget, TargetSettings, TrackTarget
from camnet.motion.track import Track

TOWN = (
    Road(name="a", points_m=((0, 0), (5, 0))),
    Road(name="b", points_m=((5, 0), (5, 5), (0, 5), (0, 0))),
    Road(name="c", points_m=((5, 0), (10, 0), (10, 5))),
    Road(name="d", points_m=((10, 5), (5, 0))),
    Road(name="dead_end", points_m=((10, 5), (10, 9))),
)
LINES = MultiLineString([road.points_m for road in TOWN])


def run(motion: TargetMotion, duration_s: float, dt_s: float, seed: int = 0) -> list[TargetState]:
    rng = np.random.default_rng(seed)
    states = [motion.reset(rng)]
    for k in range(round(duration_s / dt_s)):
        states.append(motion.step(states[-1], k * dt_s, dt_s, rng))
    return states


def on_roads(roads: tuple[Road, ...] = TOWN, heading: float | None = None, **motion: object) -> TargetMotion:
    settings = RoadTarget(**{"kind": "road", "road": "a", **motion})  # type: ignore[arg-type]
    return build_motion(TargetSettings(name="car", motion=settings, start_heading_rad=heading), roads)


# ------------------------------------------------------------------ roads


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_vehicle_keeps_to_the_roads_and_to_its_bounds(seed: int) -> None:
    motion = on_roads()
    states = run(motion, 400.0, 1 / 30, seed)
    v = np.array([np.linalg.norm(s.v_world) for s in states])
    w = np.array([s.w_body[2] for s in states])
    assert 0.3 <= v.min() < v.max() <= 0.4
    assert v.max() - v.min() > 0.03
    assert np.abs(np.diff(v)).max() * 30 < 0.02  # m/s^2: smooth
    assert np.abs(w).max() <= 1.5 + 1e-12
    # off the road only where corners are rounded and at the turn in the dead end
    away = np.array([LINES.distance(Point(*s.p_world[:2])) for s in states[::10]])
    assert away.max() < 0.6
    assert np.median(away) < 0.01
    for before, after in zip(states[:-1:97], states[1::97], strict=False):
        moved = (after.p_world - before.p_world) * 30
        np.testing.assert_allclose(moved, 0.5 * (before.v_world + after.v_world), atol=0.02)


def test_every_road_is_visited_and_turns_differ_between_seeds() -> None:
    roads_seen = []
    for seed in (0, 1):
        states = run(on_roads(speed_mps=(0.5, 0.6)), 900.0, 1 / 10, seed)
        order = [int(s.internal[1]) for s in states]
        roads_seen.append([a for a, b in pairwise(order) if a != b])
    assert set(roads_seen[0]) == {0, 1, 2, 3, 4}
    assert roads_seen[0] != roads_seen[1]


def test_same_seed_same_drive() -> None:
    one, two = run(on_roads(), 60.0, 0.1, 3), run(on_roads(), 60.0, 0.1, 3)
    assert all(np.array_equal(a.internal, b.internal) for a, b in zip(one, two, strict=True))


def test_a_closed_road_is_driven_around_and_around() -> None:
    ring = Road(
        name="a",
        points_m=tuple((3 * math.cos(a), 3 * math.sin(a)) for a in np.arange(0, 6.28, 0.1)),
        closed=True,
    )
    states = run(on_roads((ring,), start_arc_m=1.0), 200.0, 1 / 20)
    radius = np.array([np.hypot(*s.p_world[:2]) for s in states])
    assert np.abs(radius - 3).max() < 0.06
    assert (states[-1].internal[0] - states[0].internal[0]) / 2 / math.pi > 3


def test_start_is_where_and_whither_asked() -> None:
    states = run(on_roads(start_arc_m=2.0, heading=math.pi), 1.0, 0.1)
    np.testing.assert_allclose(states[0].p_world, [2, 0, 0])
    assert states[-1].p_world[0] < 1.8
    assert run(on_roads(start_arc_m=2.0), 1.0, 0.1)[-1].p_world[0] > 2.2


def test_lateral_wander_has_the_size_asked() -> None:
    straight = (Road(name="a", points_m=((0, 0), (10000, 0))),)
    states = run(on_roads(straight, start_arc_m=0.0, heading=0.0, lateral_std_m=0.1), 4000.0, 0.2)
    y = np.array([s.p_world[1] for s in states])
    assert y.std() == pytest.approx(0.1, rel=0.25)


def test_junctions_join_ends_and_choices_cover_all_but_the_way_back() -> None:
    network = RoadNetwork.of(TOWN)
    assert len(network.exits) == 4
    choices = {network.after(0, True, draw) for draw in np.linspace(0, 0.999, 50)}
    assert choices == {(1, True), (2, True), (3, False)}
    assert network.after(4, True, 0.5) == (4, False)  # nowhere else to go


@pytest.mark.parametrize(
    ("target", "message"),
    [
        ({"motion": {"road": "z"}}, r"'z' is no road of this world; its roads: a, b, c, d, dead_end"),
        ({"motion": {"speed_mps": (0.5, 0.7)}}, r"speed_mps = \[0\.5, 0\.7\]; .* v_max_mps = 0\.6"),
        ({"motion": {"speed_mps": (0.5, 0.4)}}, r"slowest <= fastest"),
        ({"motion": {"start_arc_m": 5.5}}, r"start_arc_m = 5\.5; road 'a' is 5 m long"),
        ({"start_m": (0, 0)}, r"start_m = \[0\.0, 0\.0\] is not used by a target on roads"),
    ],
)
def test_impossible_vehicles_are_refused(target: dict[str, dict[str, object]], message: str) -> None:
    motion = {"kind": "road", "road": "a", **target.pop("motion", {})}
    settings = TargetSettings.model_validate({"name": "car", "motion": motion, **target})
    with pytest.raises(WorldError, match=message):
        build_motion(settings, TOWN)


# ------------------------------------------------------------------ replay


def replayed(track: Track, v_max: float = 5.0, w_max: float = 3.0, **motion: object) -> TargetMotion:
    settings = TrackTarget(**{"kind": "track", "file": Path("x.csv"), **motion})  # type: ignore[arg-type]
    target = TargetSettings(name="person", motion=settings, v_max_mps=v_max, w_max_radps=w_max)
    return build_motion(target, (), track)


def walk(seed: int, n: int = 12, heading: bool = False) -> Track:
    rng = np.random.default_rng(seed)
    t = 1e9 + np.cumsum(rng.uniform(1, 12, n))
    p = np.column_stack([np.cumsum(rng.normal(0, 2, (n, 2)), axis=0), np.full(n, 0.5)])
    return Track("p", t, p, rng.uniform(-3, 3, n) if heading else None)


@given(st.integers(0, 30))
def test_replay_passes_the_fixes_and_agrees_with_scipy(seed: int) -> None:
    track = walk(seed)
    motion = replayed(track, v_max=100.0)
    spline = PchipInterpolator(track.t_s, track.p_world)
    rng = np.random.default_rng(0)
    state = motion.reset(rng)
    np.testing.assert_allclose(state.p_world, track.p_world[0])
    for t in np.concatenate([track.t_s[1:-1], np.linspace(track.t_s[0], track.t_s[-1], 20, endpoint=False)]):
        at = motion.step(state, t - track.t_s[0] - 0.1, 0.1, rng)
        np.testing.assert_allclose(at.p_world, spline(t), atol=1e-6)
        np.testing.assert_allclose(at.v_world, spline.derivative()(t), atol=1e-5)


def test_replay_is_continuously_differentiable_turns_boundedly_and_stops() -> None:
    track = walk(3)
    dt = 0.02
    states = run(replayed(track, w_max=2.0), track.duration_s + 5.0, dt)
    p = np.array([s.p_world for s in states])
    v = np.array([s.v_world for s in states])
    inside = slice(1, round(track.duration_s / dt) - 2)
    np.testing.assert_allclose((p[2:] - p[:-2])[inside] / 2 / dt, v[1:-1][inside], atol=0.02)
    heading = np.array([s.internal[0] for s in states])
    np.testing.assert_allclose(np.diff(heading) / dt, [s.w_body[2] for s in states[1:]], atol=1e-9)
    assert np.abs(np.diff(heading)).max() / dt <= 2.0 + 1e-9
    np.testing.assert_array_equal(v[-1], 0)
    np.testing.assert_allclose(p[-1], track.p_world[-1])


def test_heading_follows_travel_and_is_held_while_standing() -> None:
    t = np.arange(0.0, 60.0, 10.0)
    x = np.array([0, 10, 20, 20, 20, 20.0])
    states = run(replayed(Track("p", t, np.column_stack([x, 2 * x, 0 * x]))), 50.0, 0.1)
    np.testing.assert_allclose([s.internal[0] for s in states], math.atan2(2, 1), atol=1e-6)


def test_recorded_headings_are_used() -> None:
    track = Track("p", np.arange(4.0), np.zeros((4, 3)), np.array([3.0, -3.0, -2.5, -2.5]))
    states = run(replayed(track), 3.0, 0.01)
    heading = np.interp(1.5, np.arange(0, 3.001, 0.01), [s.internal[0] for s in states])
    assert heading == pytest.approx(2 * math.pi - 2.75, abs=1e-6)
    assert states[0].internal[0] == 3.0


def test_one_fix_stands_still_and_a_late_start_starts_late() -> None:
    lonely = Track("p", np.array([5.0]), np.array([[1.0, 2.0, 0.0]]))
    np.testing.assert_array_equal(run(replayed(lonely), 1.0, 0.1)[-1].p_world, [1, 2, 0])
    track = walk(1)
    late = run(replayed(track, v_max=100.0, start_s=10.0), 0.5, 0.1)[-1]
    early = run(replayed(track, v_max=100.0), 10.5, 0.1)[-1]
    np.testing.assert_allclose(late.p_world, early.p_world, atol=1e-6)


def test_unsuitable_tracks_are_refused() -> None:
    fast = Track("p", np.array([0.0, 1.0, 2.0]), np.array([[0, 0, 0], [1, 0, 0], [20.0, 0, 0]]))
    with pytest.raises(
        WorldError, match=r"track 'p' reaches .* m/s 1 s after its start, above v_max_mps = 5\.0"
    ):
        replayed(fast)
    with pytest.raises(WorldError, match=r"start_s = 9\.0; track 'p' lasts 2 s"):
        replayed(fast, v_max=100.0, start_s=9.0)
    settings = TargetSettings(name="person", motion=TrackTarget(kind="track", file=Path("x.csv")))
    with pytest.raises(WorldError, match=r"motion\.file = 'x\.csv' was not read"):
        build_motion(settings, ())


@given(st.integers(0, 50))
def test_no_instant_is_faster_than_the_accepted_bound(seed: int) -> None:
    track = walk(seed)
    spline = PchipInterpolator(track.t_s, track.p_world).derivative()
    speeds = np.linalg.norm(spline(np.linspace(track.t_s[0], track.t_s[-1], 3000))[:, :2], axis=1)
    with pytest.raises(WorldError):
        replayed(track, v_max=0.995 * float(speeds.max()))
    replayed(track, v_max=1.01 * float(speeds.max()))
