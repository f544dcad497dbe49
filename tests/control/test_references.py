"""References: never outside the shrunk region, bounded speed, acceleration and jerk, exact angular velocity."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from camnet.control.reference_kernel import gaze_motion
from camnet.control.references import ReferenceGenerator
from camnet.control.settings import ControllerSettings
from camnet.errors import ConfigError
from camnet.geometry.regions import build_region
from camnet.geometry.rotations import conjugate, exp, from_yaw, log, multiply, nadir_gaze, rotate
from camnet.geometry.settings import Box, Cylinder, ExtrudedPolygon, Polytope

DT = 1 / 60
SETTINGS = ControllerSettings()
EYE = np.array([[0.0, 0.0, 1.0]])
NOTCHED = ((-2, -2), (2, -2), (2, 2), (0.6, 2), (0.6, -1), (-0.6, -1), (-0.6, 2), (-2, 2))
SHAPES = {
    "box": Box(min_m=(-2, -1.5, 1), max_m=(2, 1.5, 4)),
    "cylinder": Cylinder(type="cylinder", center_m=(0.3, 0), radius_m=1.6, z_m=(1, 4)),
    "polytope": Polytope(
        type="polytope", vertices_m=((-2, -2, 1), (2, -2, 1), (0, 2.5, 1), (-1, -1, 4), (1, -1, 4), (0, 1, 4))
    ),
    "notched": ExtrudedPolygon(type="extruded_polygon", vertices_m=NOTCHED, z_m=(1, 4)),
}


def fly(region, setpoints, steps_each, start=None, config=SETTINGS):
    generator = ReferenceGenerator(config, [region], np.zeros(1), DT)
    p = region.project(region.center if start is None else start, config.region_margin_m)
    states = [generator.start(p[None])]
    for setpoint in setpoints:
        for _ in range(steps_each):
            states.append(generator.step(states[-1], np.asarray(setpoint, float)[None], np.zeros((1, 2))))
    return [np.array([getattr(s, name)[0] for s in states]) for name in ("p_world", "v_world", "a_world")]


@pytest.mark.parametrize("name", SHAPES)
@given(data=st.data())
@settings(max_examples=15, deadline=None)
def test_never_leaves_the_shrunk_region(name, data):
    region = build_region("r", SHAPES[name])
    coordinate = st.floats(-5, 5)
    setpoints = data.draw(st.lists(st.tuples(coordinate, coordinate, coordinate), min_size=1, max_size=6))
    steps = data.draw(st.integers(1, 40))
    p, v, _ = fly(region, setpoints, steps)
    assert region.signed_distance(p).max() <= -SETTINGS.region_margin_m + 1e-6
    assert np.linalg.norm(v, axis=1).max() <= SETTINGS.reference_v_max_mps * (1 + 1e-9)
    assert np.linalg.norm(np.diff(v, axis=0), axis=1).max() <= SETTINGS.reference_a_max_mps2 * DT * (1 + 1e-6)
    np.testing.assert_allclose(np.diff(p, axis=0), 0.5 * DT * (v[1:] + v[:-1]), atol=3e-4)


@pytest.mark.parametrize("name", SHAPES)
def test_reaches_admissible_setpoints_and_stops(name):
    region = build_region("r", SHAPES[name])
    goal = region.project(np.array([0.3, 1.3, 2.0]), SETTINGS.region_margin_m + 0.01)
    p, v, _ = fly(region, [goal], 900)
    np.testing.assert_allclose(p[-1], goal, atol=1e-3)
    assert np.linalg.norm(v[-1]) < 1e-3


def test_flies_around_a_notch():
    region = build_region("r", SHAPES["notched"])
    p, _, _ = fly(region, [(1.3, 1.5, 2.0)], 1200, start=np.array([-1.3, 1.5, 2.0]))
    np.testing.assert_allclose(p[-1], [1.3, 1.5, 2.0], atol=5e-3)
    assert p[:, 1].min() < -1.0  # under the notch


def test_setpoint_outside_ends_at_its_projection():
    region = build_region("r", SHAPES["box"])
    p, _, _ = fly(region, [(9.0, 9.0, 9.0)], 900)
    np.testing.assert_allclose(p[-1], region.project(np.array([9.0, 9.0, 9.0]), 0.25), atol=1e-3)


def test_jerk_stays_bounded_on_a_free_way():
    region = build_region("r", Box(min_m=(-50, -50, 0), max_m=(50, 50, 50)))
    _, v, a = fly(region, [(5, 2, 20), (-4, 3, 30), (0, 0, 25)], 100)
    change = np.linalg.norm(np.diff(a, axis=0), axis=1)
    slower = np.linalg.norm(v[1:], axis=1) < SETTINGS.reference_v_max_mps * (1 - 1e-9)
    assert slower.sum() > 100
    assert change[slower].max() <= SETTINGS.reference_jerk_max_mps3 * DT * (1 + 1e-6)


def test_thin_region_is_refused():
    region = build_region("thin", Box(min_m=(0, 0, 0), max_m=(5, 5, 0.4)))
    with pytest.raises(ConfigError, match=r"region_margin_m = 0.25.*'thin'"):
        ReferenceGenerator(SETTINGS, [region], np.zeros(1), DT)


@given(
    pan=st.floats(-1.2, 1.2), tilt=st.floats(-1.2, 1.2), rates=st.tuples(st.floats(-2, 2), st.floats(-2, 2)),
    yaw=st.floats(-4, 4),
)  # fmt: skip
@settings(max_examples=60, deadline=None)
def test_gaze_motion_by_differentiation(pan, tilt, rates, yaw):
    gaze, rate, h = np.array([pan, tilt]), np.array(rates), 1e-5
    motion = gaze_motion(gaze, rate, yaw)
    before, after = (gaze_motion(gaze + s * h * rate, rate, yaw)[:4] for s in (-1, 1))
    np.testing.assert_allclose(motion[4:], log(multiply(conjugate(before), after)) / (2 * h), atol=1e-7)
    # the optical axis is that of nadir_gaze whatever the yaw, and at zero gaze the image is turned by yaw
    axis = np.array([0.0, 0.0, 1.0])
    np.testing.assert_allclose(rotate(motion[:4], axis), rotate(nadir_gaze(pan, tilt), axis), atol=1e-12)
    still = gaze_motion(np.zeros(2), np.zeros(2), yaw)[:4]
    np.testing.assert_allclose(still, multiply(from_yaw(yaw), np.array([0.0, 1.0, 0.0, 0.0])), atol=1e-12)


def test_gaze_arrives_within_its_limits_and_integrates():
    generator = ReferenceGenerator(SETTINGS, [None], np.array([0.4]), DT)
    state = generator.start(np.zeros((1, 3)))
    q = generator.reference(state).q_world[0]
    for _ in range(300):
        following = generator.step(state, np.zeros((1, 3)), np.array([[3.0, -0.5]]))
        middle = 0.5 * (generator.reference(state).w_cam[0] + generator.reference(following).w_cam[0])
        q = multiply(q, exp(DT * middle))
        assert np.linalg.norm(following.gaze_rate) <= SETTINGS.reference_w_max_radps * (1 + 1e-9)
        state = following
    np.testing.assert_allclose(state.gaze[0], [SETTINGS.gaze_max_rad, -0.5], atol=1e-3)
    assert np.linalg.norm(log(multiply(conjugate(q), generator.reference(state).q_world[0]))) < 2e-3
