"""Agents that fly by an estimate of their pose: bounds, flight, measurements, handoffs."""

from __future__ import annotations

import math

import numpy as np
import pytest

from camnet.certification.outage import OutageBounds, upper_level
from camnet.config.load import load_scenario
from camnet.errors import ConfigError, WorldError
from camnet.estimation.own_pose import ConsideredFilter, own_spread
from camnet.experiments.own_pose_flights import fly_alone
from camnet.sensing.own_pose_settings import ErrorBounds, PoseSource, VelocitySource
from camnet.simulation.certificates import view_radius
from camnet.simulation.loop import NetworkSimulation
from camnet.simulation.network import build_network
from camnet.simulation.run import decide, open_simulation, run_network, setpoint_for, setpoints_for

DENIED = (
    "agents.camera_0.pose.source=dead_reckoning",
    "agents.camera_0.pose.velocity.scale=0.0",
    "agents.camera_0.pose.outages_s=[[1,31]]",
    "agents.camera_0.pose.bounds={position_m: 0.1, heading_rad: 0.02, scale: 0.01, gyro_bias_radps: 0.0005}",
)


def dead_reckoned(path: np.ndarray, dt: float, scale: float, heading: float, bias: float) -> np.ndarray:
    """Integrate a path's steps with wrong scale and heading, by complex numbers; the path's first point is known."""
    z = path[:, 0] + 1j * path[:, 1]
    turned = (1.0 + scale) * np.exp(1j * (heading + bias * dt * (np.arange(len(z) - 1) + 0.5)))
    return np.concatenate([[z[0]], z[0] + np.cumsum(np.diff(z) * turned)])


def test_no_error_of_stated_size_passes_the_bound() -> None:
    rng, dt, reach, speed = np.random.default_rng(0), 0.1, 6.0, 1.5
    closest = 0.0
    for _ in range(60):
        scale, heading, bias = 0.05, 0.03, 0.004
        bounds = OutageBounds(
            ErrorBounds(position_m=0.2, heading_rad=heading, scale=scale, gyro_bias_radps=bias),
            0.0,
            0.0,
            reach,
            speed,
        )
        # to and fro, or round, within a disc about the start
        rate, size = rng.uniform(0.05, 0.5), rng.uniform(0.3, 1.0) * reach / 2.0
        t = dt * np.arange(1200)
        path = np.column_stack(
            [size * (1.0 - np.cos(rate * t)), rng.uniform(-1, 1) * size * np.sin(rate * t)]
        )
        path = np.clip(path, -reach, reach)
        if np.abs(np.diff(path, axis=0)).sum(axis=1).max() > speed * dt or np.hypot(*path.T).max() > reach:
            continue
        signs = rng.choice([-1.0, 1.0], size=3)
        found = dead_reckoned(path, dt, signs[0] * scale, signs[1] * heading, signs[2] * bias)
        error = 0.2 + np.abs(found - (path[:, 0] + 1j * path[:, 1]))
        bound = np.array([bounds.error_m(float(x)) for x in t])
        assert (error <= bound + 1e-9).all()
        closest = max(closest, float(((error - 0.2) / np.maximum(bound - 0.2, 1e-9))[200:].max()))
    assert closest > 0.3  # and it is not idle


def test_a_straight_way_reaches_the_bound_by_distance() -> None:
    stated = ErrorBounds(position_m=0.0, heading_rad=0.0, scale=0.05, gyro_bias_radps=0.0)
    bounds = OutageBounds(stated, 0.0, 0.0, 1e6, 1.0)
    assert bounds.error_m(60.0) == pytest.approx(3.0)
    assert bounds.error_m(0.0) == 0.0
    assert upper_level(2.0, 0.5) == pytest.approx(1.125)
    assert upper_level(0.4, 0.5) == 0.0


def test_noise_stays_below_the_likely_bound_as_often_as_it_says() -> None:
    bounds = OutageBounds(
        ErrorBounds(position_m=0.0, heading_rad=0.0, scale=0.0, gyro_bias_radps=0.0), 0.02, 0.0, 5.0, 1.0
    )
    rng = np.random.default_rng(1)
    walks = 0.02 * math.sqrt(0.1) * np.cumsum(rng.standard_normal((2000, 600, 2)), axis=1)
    largest = np.hypot(walks[..., 0], walks[..., 1]).max(axis=1)
    assert np.mean(largest > bounds.likely_error_m(60.0)) < 0.05 + 3.1 * math.sqrt(0.05 * 0.95 / 2000)
    assert largest.max() < bounds.error_m(60.0)
    assert np.mean(largest > 0.6 * bounds.likely_error_m(60.0)) > 0.2


def test_calibration_before_an_outage_pays() -> None:
    source = PoseSource(source="dead_reckoning", outages_s=((100.0, 220.0),), velocity=VelocitySource())
    found = fly_alone(source, "search pattern", 3, flights=40)
    assert found["calibrated"]["60"] <= 0.9
    assert found["raw"]["60"] > 2.0 * found["calibrated"]["60"]
    assert found["raw"]["119"] > found["raw"]["30"]


@pytest.fixture(scope="module")
def flown() -> NetworkSimulation:
    scenario = load_scenario("quickstart", (*DENIED, "agents.camera_0.pose.velocity.gyro_bias_radps=0.02"))
    simulation = open_simulation(scenario, 2, ("learned",))
    for _ in range(120):
        simulation.advance(setpoints_for(simulation, decide(simulation)))
    return simulation


def test_the_controller_flies_on_what_it_believes(flown: NetworkSimulation) -> None:
    own = flown.own
    assert own is not None
    assert own.lost[0]
    assert not own.lost[1:].any()
    assert own.error_m[0] > 0.05
    assert abs(own.turn_rad[0]) > 0.02
    reference = flown.reference_p_world(0)
    believed = np.linalg.norm(own.p_world[0] - reference)
    true = np.linalg.norm(flown.snapshot.camera_p_world[0] - reference)
    assert believed < 0.6 * true
    assert np.array_equal(own.p_world[1:], flown.snapshot.camera_p_world[1:])  # the others know


def test_a_measurement_carries_the_own_pose_error(flown: NetworkSimulation) -> None:
    own, now = flown.own, flown.snapshot
    visible = np.zeros((4, 1), dtype=bool)
    visible[0] = True
    sensor = type(flown._sensor)(
        flown.network.scenario.sensing.model_copy(update={"position_noise_m": 0.0}), 1, 4
    )
    (z,) = sensor.measure(now, visible, np.random.default_rng(0))
    reported = own.as_believed(z)
    turn = own.turn_rad[0]
    c, s = math.cos(turn), math.sin(turn)
    arm = now.target_p_world[0] - now.camera_p_world[0]
    expected = own.p_world[0] + np.array([c * arm[0] - s * arm[1], s * arm[0] + c * arm[1], arm[2]])
    w, x, y, q = reported.motion.q_world
    r = np.array(
        [
            [1 - 2 * (y * y + q * q), 2 * (x * y - w * q), 2 * (x * q + w * y)],
            [2 * (x * y + w * q), 1 - 2 * (x * x + q * q), 2 * (y * q - w * x)],
            [2 * (x * q - w * y), 2 * (y * q + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    np.testing.assert_allclose(reported.motion.p_world + r @ reported.p_cam, expected, atol=1e-9)
    # position and, through the lever, heading
    cov, lever = own.pose_cov(0), math.hypot(arm[0], arm[1])
    assert own_spread(z) == 0.0
    low, high = math.sqrt(cov[0, 0]), math.sqrt(cov[:2, :2].trace()) + lever * math.sqrt(cov[2, 2])
    assert 0.9 * low <= own_spread(reported) <= high


def test_uncertainty_travels_with_the_handoff(flown: NetworkSimulation) -> None:
    (filter_,) = flown.driving
    assert isinstance(filter_, ConsideredFilter)
    bare, filter_.own_m = filter_.estimate.radius_m, 0.7
    assert filter_.estimate.radius_m == pytest.approx(
        bare - 0.0 + 0.7 - (bare - filter_.inner.estimate.radius_m)
    )
    assert filter_.rollout(5.0, 0.5).radius_m[0] == pytest.approx(
        filter_.inner.rollout(5.0, 0.5).radius_m[0] + 0.7
    )


def test_an_agent_that_is_off_itself_searches_from_higher_up(flown: NetworkSimulation) -> None:
    from camnet.simulation.coordination import Role, Task
    from camnet.simulation.entries import Entry

    entry = Entry(0, 1e3, np.array([4.2, -1.8, 0.0]), np.array([0.0, 0.3, 0.0]), 0.1, True)
    task = Task(Role.INTERCEPT, 0, entry)
    place = np.array([4.2, -1.0, 2.0])
    heights = [
        setpoint_for(flown.network, 0, task, [], place, entry.t_s, own_m=own).p_world[2] for own in (0.0, 0.4)
    ]
    assert heights[1] > heights[0]


def test_the_view_left_by_the_own_error_is_what_is_certified() -> None:
    known = build_network(load_scenario("quickstart"))
    denied = build_network(load_scenario("quickstart", DENIED))
    e = denied.own_error_m(0)
    assert 0.1 < e < 1.0
    assert view_radius(denied, 0) == pytest.approx(view_radius(known, 0) - e)
    assert view_radius(denied, 1) == view_radius(known, 1)
    low, high = denied.flight_regions[0].bounds
    assert np.allclose(low[:2], known.regions[0].bounds[0, :2] + e)
    assert high[2] == 3.5


def test_what_cannot_be_kept_in_its_region_is_refused() -> None:
    loose = build_network(
        load_scenario("quickstart", (*DENIED[:3], "agents.camera_0.pose.velocity.scale=0.2"))
    )
    with pytest.raises(WorldError, match=r"region 'east'.*cannot be kept in it"):
        _ = loose.flight_regions


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        (("agents.camera_0.pose.outages_s=[[5,9]]",), "the pose is never lost"),
        ((*DENIED[:1], "agents.camera_0.pose.outages_s=[[9,5]]"), "ends after it began"),
        ((*DENIED[:1], "agents.camera_0.pose.outages_s=[[5,9],[8,12]]"), "in order, apart"),
        (("agents.camera_0.pose.source=odometry",), "dead_reckoning"),
        ((*DENIED[:1], "agents.camera_0.pose.fixes.rate_hz=1000"), "must not exceed controller.rate_hz"),
        ((*DENIED[:1], "agents.camera_0.pose.velocity.scale=-0.1"), "greater than or equal to 0"),
    ],
)
def test_bad_pose_sources_are_named(settings: tuple[str, ...], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        load_scenario("quickstart", settings)


def test_runs_of_one_seed_are_alike_and_others_keep_their_noise() -> None:
    scenario = load_scenario("quickstart", (*DENIED, "run.duration_s=3"))
    first, second = (run_network(scenario, 4, ("learned",)) for _ in range(2))
    assert np.array_equal(first.log.values, second.log.values, equal_nan=True)
    columns = first.log.columns
    lost = first.log.values[:, columns.index("camera_0.own_lost")]
    assert lost[0] == 0.0
    assert lost[-1] == 1.0
    assert "camera_1.own_lost" not in columns


@pytest.mark.parametrize("world", ["gps_denied", "unknown_size"])
def test_environment_and_batch_back_end_refuse_by_name(world: str) -> None:
    from camnet.batch.network import Shown, pack_network
    from camnet.env import handoff_v0

    with pytest.raises(ConfigError, match=r"agents\[0\].pose.source|targets\[0\].assumed_size"):
        handoff_v0.parallel_env(world=world)
    network = build_network(load_scenario(world, ("sensing.level=pose",)))
    with pytest.raises(ConfigError, match=r"agents\[0\].pose.source|targets\[0\].assumed_size"):
        pack_network(network, Shown(0.5, 1, 10.0, (0, 0, 0, 0, 0, 0), False, 10.0))
