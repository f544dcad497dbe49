"""Distance observers on the published scene: exact data, the order of the estimators, and their single steps."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from camnet.estimation.structure.distance_observer import DistanceObserver, exact_step
from camnet.estimation.structure.inverse_depth_filter import InverseDepthFilter
from camnet.estimation.structure.inverse_depth_observer import InverseDepthObserver
from camnet.estimation.structure.key_view import KeyFrameViews
from camnet.estimation.structure.observer_settings import ObserverSettings
from camnet.estimation.structure.odometry import OdometryErrors, measure_odometry
from camnet.estimation.structure.tracks import SimulatedTracks
from camnet.experiments.distance_observers_scene import SetUp, make_scene
from camnet.geometry.rotations import to_matrix

SETUP = SetUp()


def exact_run(observers):
    """Depth errors (K, N) of each observer on exact tracks and odometry, and the views."""
    rng = np.random.default_rng(5)
    scene = make_scene(SETUP, rng)
    samples = np.arange(0.0, scene.t_s[-1] + 0.02, 0.01)
    odometry = measure_odometry(scene.path, samples, OdometryErrors(), rng)
    frames = SimulatedTracks(scene.points_world, scene.path, scene.camera, scene.t_s, 0.0, rng)
    views = KeyFrameViews(scene.camera, odometry, SETUP.views)
    truth = scene.path.states(scene.t_s)
    turns = to_matrix(truth.q_world)
    errors, seen = [[] for _ in observers], []
    for k, frame in enumerate(frames):
        view = views.view(frame)
        z = ((scene.points_world - truth.p_world[k]) @ turns[k])[:, 2]
        for observer, out in zip(observers, errors, strict=True):
            observer.update(view)
            out.append(observer.depths(view) - z)
        seen.append(view)
    return [np.array(e) for e in errors], seen


@pytest.fixture(scope="module")
def exact():
    s = SETUP.observers
    observers = [
        DistanceObserver(48, s, extended=False),
        DistanceObserver(48, s, extended=True),
        InverseDepthObserver(48, s),
        InverseDepthFilter(48, s),
    ]
    return observers, *exact_run(observers)


def test_the_learned_distances_are_exact_on_exact_data(exact):
    observers, errors, views = exact
    for observer, error in zip(observers[:2], errors[:2], strict=True):
        assert observer.learned.all()
        assert np.abs(error[-1]).max() < 2e-3
        assert observer.d_kc == pytest.approx(views[-1].baseline_m, abs=2e-3)
        truth = np.linalg.norm(exact_distance_at_key(), axis=1)
        np.testing.assert_allclose(observer.d_ik, truth, atol=2e-3)


def exact_distance_at_key():
    scene = make_scene(SETUP, np.random.default_rng(5))
    return scene.points_world - scene.path.states(0.0).p_world


def test_the_flow_makes_the_second_observer_better_before_learning(exact):
    _, errors, views = exact
    early = np.array([v.t_s < 2.5 for v in views])
    one, two = (np.abs(e[early][-1]).sum() for e in errors[:2])
    assert two < 0.8 * one


def test_the_filter_converges_on_exact_data(exact):
    assert np.abs(exact[1][3][-1]).max() < 0.01


def test_the_first_observer_keeps_its_start_until_it_has_learned(exact):
    """The error of every distance is constant: only the odometry moves them."""
    _, errors, views = exact
    t = np.array([v.t_s for v in views])
    u_z = np.array([v.u_ic[:, 2] for v in views])
    distance = errors[0] / u_z
    still = distance[(t > 0.0) & (t < 2.0)]
    assert np.ptp(still, axis=0).max() < 1e-3


def test_exact_steps_solve_their_equation():
    rng = np.random.default_rng(0)
    for a in (0.0, 1e-12, 0.3, 700.0):
        x, c, dt = rng.normal(), rng.normal(), 0.033
        then = solve_ivp(
            lambda _, y, a=a, c=c: c - a * y, (0.0, dt), [x], rtol=1e-10, atol=1e-12, method="LSODA"
        )
        got = exact_step(np.array([x]), np.array([a]), np.array([c]), dt)[0]
        assert got == pytest.approx(then.y[0, -1], abs=1e-8)


def test_the_filter_moves_state_and_covariance_as_the_point_moves():
    f = InverseDepthFilter(1, ObserverSettings())
    f.state = np.array([[0.2, -0.1, 0.4]])
    v, w, dt = np.array([0.3, -0.2, 0.5]), np.array([0.2, 0.5, -0.4]), 0.02

    def moved(state):
        g = InverseDepthFilter(1, ObserverSettings())
        g.state = state[None].copy()
        g._move(dt, v, w)
        return g.state[0]

    start = f.state[0].copy()
    rate = solve_ivp(lambda _, y: point_rates(y, v, w), (0.0, dt), start, rtol=1e-11, atol=1e-13)
    np.testing.assert_allclose(moved(start), rate.y[:, -1], atol=3e-7)  # v, w at the middle: second order
    jacobian = np.column_stack([(moved(start + h) - moved(start - h)) / 2e-6 for h in 1e-6 * np.eye(3)])
    f.covariance = np.diag([1.0, 2.0, 3.0])[None]
    f._q = np.zeros((3, 3))
    f._move(dt, v, w)
    np.testing.assert_allclose(f.covariance[0], jacobian @ np.diag([1.0, 2.0, 3.0]) @ jacobian.T, atol=1e-7)


def point_rates(y, v, w):
    """Motion of (x/z, y/z, 1/z) as in the table of the filter."""
    y1, y2, y3 = y
    return [
        (y1 * v[2] - v[0]) * y3 + y1 * y2 * w[0] - (1 + y1 * y1) * w[1] + y2 * w[2],
        (y2 * v[2] - v[1]) * y3 + (1 + y2 * y2) * w[0] - y1 * y2 * w[1] - y1 * w[2],
        v[2] * y3 * y3 + (y2 * w[0] - y1 * w[1]) * y3,
    ]
