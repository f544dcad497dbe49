"""Reachable sets hold every simulated target; crossings are certified only when the target cannot be missed."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from camnet.certification.benchmark import nadir_views
from camnet.certification.crossing import MobileAgent, certify_crossing, certify_meeting
from camnet.certification.growth import PlanarField, error_tube
from camnet.certification.reachable import FreeReach, HeadingReach, TubeReach, planar_view
from camnet.errors import CertificateError


def heading_walk(rng, reach, tau, n, steps=60):
    """Targets whose heading and speed jump within their limits."""
    axis = math.atan2(*reach.direction[::-1])
    p = np.tile(reach.position, (n, 1)).astype(float)
    for _ in range(steps):
        extreme = rng.random(n) < 0.5
        angle = np.where(extreme, rng.choice([-1, 1], n), rng.uniform(-1, 1, n)) * reach.half_angle_rad
        speed = np.where(rng.random(n) < 0.5, rng.choice([reach.v_lo_mps, reach.v_max_mps], n),
                         rng.uniform(reach.v_lo_mps, reach.v_max_mps, n))  # fmt: skip
        p += tau / steps * speed[:, None] * np.c_[np.cos(axis + angle), np.sin(axis + angle)]
    return p


@given(st.integers(0, 10**6), st.floats(0.0, 1.5), st.floats(0.0, 1.0), st.floats(0.1, 20.0))
@settings(max_examples=50, deadline=None)
def test_heading_limited_targets_stay_in_their_set_and_disc(seed, half_angle, share, tau):
    rng = np.random.default_rng(seed)
    reach = HeadingReach(rng.uniform(-5, 5, 2), rng.normal(size=2), half_angle, share * 1.5, 1.5)
    ends = heading_walk(rng, reach, tau, 60)
    assert reach.contains(ends, tau).all()
    centre, radius = reach.disc(tau)
    assert (np.linalg.norm(ends - centre, axis=1) <= radius + 1e-9).all()
    # every point of the set is in the disc, also the extreme ones
    axis = math.atan2(*reach.direction[::-1])
    angle = np.linspace(-half_angle, half_angle, 41) + axis
    for speed in (reach.v_lo_mps, reach.v_max_mps):
        points = reach.position + speed * tau * np.c_[np.cos(angle), np.sin(angle)]
        assert (np.linalg.norm(points - centre, axis=1) <= radius + 1e-9).all()


def test_free_target_outside_a_view_is_never_certain():
    views = nadir_views(np.array([[30.0, 0.0]]), 20.0, 30.0)
    reach = FreeReach(np.zeros(2), 1.0)
    result = certify_crossing(
        reach, [planar_view(views, 0, 0.0, 0.1)], np.linspace(0, 60, 121), 100.0, 0.0, 1.0
    )
    assert result.verdict == "not certified"
    assert result.margin_m < 0
    lean = 0.1 / math.cos(math.atan2(15, 20))
    assert result.earliest_s == pytest.approx(15.0 + lean, abs=0.5)  # it may be there after the straight way


def test_narrow_heading_is_certified_and_wide_is_not():
    views = nadir_views(np.array([[30.0, 0.0]]), 20.0, 30.0)
    view = [planar_view(views, 0, 0.0, 0.1)]
    times = np.linspace(0, 40, 401)
    narrow = HeadingReach(np.zeros(2), np.array([1.0, 0.0]), 0.15, 0.9, 1.1)
    result = certify_crossing(narrow, view, times, 30.0, 2.0, 1.1)
    assert result.verdict == "certified"
    rng = np.random.default_rng(0)
    ends = heading_walk(rng, narrow, result.time_s, 500)
    assert (view[0].depth(ends) >= 0).all()  # all are seen at the certified time
    wide = HeadingReach(np.zeros(2), np.array([1.0, 0.0]), 0.7, 0.9, 1.1)
    assert certify_crossing(wide, view, times, 30.0, 2.0, 1.1).verdict == "not certified"
    late = certify_crossing(narrow, view, times, 10.0, 2.0, 1.1)
    assert (late.verdict, late.binding) == ("not certified", "time out of view")
    assert certify_crossing(narrow, view, times, 30.0, 30.0, 1.1).binding == "time in view"
    assert certify_crossing(narrow, [], times, 30.0, 2.0, 1.1).verdict == "not certified"


def straight_field(speed=1.0):
    x = np.stack(np.meshgrid(np.arange(-4, 44, 1.0), np.arange(-4, 4.1, 1.0)), -1).reshape(-1, 2)
    sig = np.exp(-0.5 * ((x[:, None] - x) ** 2).sum(-1))
    w = np.linalg.solve(sig.T @ sig + 1e-6 * np.eye(len(x)), sig.T @ np.tile([speed, 0.0], (len(x), 1)))
    return PlanarField.create(x, 1.0, w)


def test_learned_tube_is_certified_where_a_free_target_is_not_and_hostile_targets_are_seen():
    field, e_v, e0 = straight_field(), 0.05, 0.1
    tube = error_tube(field, [0.0, 0.0], e0, e_v, 1.2, 32.0, step_s=0.2, tolerance=1e-2, stop_radius_m=8.0)
    views = nadir_views(np.array([[30.0, 0.0]]), 20.0, 20.0)
    view = planar_view(views, 0, 0.0, 0.2)
    result = certify_crossing(TubeReach(tube), [view], tube.t_s, 40.0, 1.0, 1.2)
    assert result.verdict == "certified"
    rng = np.random.default_rng(1)
    push = rng.normal(size=(40, 2))
    push /= np.linalg.norm(push, axis=1, keepdims=True)
    p, h = e0 * push, 0.05
    for _ in range(round(result.time_s / h)):
        p = p + h * (field.velocity(p + 0.5 * h * field.velocity(p)) + e_v * push)
    assert (view.depth(p) >= -1e-3).all()
    blind = error_tube(field, [0.0, 0.0], e0, 0.6, 1.2, 32.0, step_s=0.2, tolerance=1e-2, stop_radius_m=8.0)
    assert certify_crossing(TubeReach(blind), [view], blind.t_s, 40.0, 1.0, 1.2).verdict == "not certified"


def test_meeting_needs_room_time_and_speed():
    reach = HeadingReach(np.zeros(2), np.array([1.0, 0.0]), 0.1, 1.0, 1.0)
    centre, radius = reach.disc(10.0)
    beside = centre + np.array([0.0, 5.0])
    near = MobileAgent(beside, 2.0, 0.5, radius + 1.0)
    ok = certify_meeting(reach, [near], 10.0, 20.0, 0.3)
    assert (ok.verdict, ok.view) == ("certified", 0)
    assert ok.margin_m == pytest.approx(0.7)
    assert ok.margin_s == pytest.approx(10 - 5 / 1.5)
    slow = MobileAgent(beside, 0.9, 0.5, radius + 1.0)
    assert certify_meeting(reach, [slow], 10.0, 20.0, 0.3).binding == "agent's speed"
    stuck = MobileAgent(beside, 0.5, 0.5, radius + 1.0)
    assert certify_meeting(reach, [stuck], 10.0, 20.0, 0.3).verdict == "not certified"
    small = MobileAgent(centre, 2.0, 0.5, radius)
    assert certify_meeting(reach, [small], 10.0, 20.0, 0.3).binding == "size of the ball"
    assert certify_meeting(reach, [small, near], 10.0, 20.0, 0.3).view == 1
    assert certify_meeting(reach, [near], 10.0, 9.0, 0.3).binding == "time out of view"
    assert certify_meeting(reach, [], 10.0, 9.0, 0.3).binding == "no agent"


def test_misuse_is_refused():
    with pytest.raises(CertificateError, match="half_angle"):
        HeadingReach(np.zeros(2), np.ones(2), 1.6, 0.1, 1.0)
    with pytest.raises(CertificateError, match="v_lo"):
        HeadingReach(np.zeros(2), np.ones(2), 0.6, 2.0, 1.0)
