"""Parts of the batch back end against what they stand for: NumPy's generator, PyBullet's flight, the array kernels."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numba import njit
from rounding import assert_rounded_alike

from camnet.batch import lane_layout, lane_references, lanes, triples
from camnet.batch.body import fly
from camnet.batch.gimbal import camera_of
from camnet.batch.random import normal, stream_of, uniform
from camnet.batch.reference import command_of, gaze_motion, gaze_step, position_step
from camnet.batch.simulation import _group_sizes
from camnet.control import reference_kernel
from camnet.control.quadrotor_kernel import pack_model
from camnet.control.references import RegionBounds
from camnet.control.sliding_mode_kernel import control_compiled
from camnet.control.trim import trimmed
from camnet.geometry import rotations
from camnet.geometry.regions import BoxRegion, CylinderRegion
from camnet.geometry.settings import CameraModel
from camnet.geometry.triples import log, multiply, rotate
from camnet.world.description import AgentSpec, WorldDescription
from camnet.world.protocol import CameraCommand
from camnet.world.pybullet import PyBulletWorld
from camnet.world.pybullet.flight import model_from_settings
from camnet.world.settings import PhysicsSettings, WindSettings

CAMERA = CameraModel(
    name="c",
    intrinsics={
        "width_px": 640,
        "height_px": 480,
        "fx_px": 420.0,
        "fy_px": 420.0,
        "cx_px": 320.0,
        "cy_px": 240.0,
    },
    near_m=0.3,
    far_m=8.0,
)


@njit
def _draw(streams, normals, uniforms):
    for i in range(len(normals)):
        normals[i] = normal(streams, 1)
        uniforms[i] = uniform(streams, 1)


def test_streams_draw_what_numpy_draws():
    rng, n = np.random.default_rng(12), 200_000
    streams = np.array([stream_of(np.random.default_rng(0)), stream_of(rng)])
    normals, uniforms = np.empty(n), np.empty(n)
    _draw(streams, normals, uniforms)
    drawn = np.array([(rng.standard_normal(), rng.random()) for _ in range(n)])
    # so many draws go through the tail and through every layer's edge
    np.testing.assert_allclose(normals, drawn[:, 0], rtol=0, atol=2e-14)
    np.testing.assert_array_equal(uniforms, drawn[:, 1])
    np.testing.assert_array_equal(streams[1], stream_of(rng))


def test_other_generators_are_refused():
    with pytest.raises(TypeError, match="MT19937"):
        stream_of(np.random.Generator(np.random.MT19937(1)))


def test_triples_agree_with_rotations():
    rng = np.random.default_rng(3)
    for scale in (1e-12, 1e-5, 0.05, 0.19, 0.21, 3.0):
        x = scale * rng.standard_normal(3)
        q, v = rotations.normalise(rng.standard_normal(4)), rng.standard_normal(3)
        assert_rounded_alike(triples.turn(*x), rotations.exp(x))
        np.testing.assert_allclose(rotate(tuple(q), tuple(v)), rotations.rotate(q, v), atol=1e-15)
        np.testing.assert_allclose(log(tuple(rotations.exp(x))), rotations.log(rotations.exp(x)), atol=1e-15)
        np.testing.assert_allclose(
            multiply(tuple(q), triples.turn(*x)), rotations.multiply(q, rotations.exp(x)), atol=1e-15
        )


@njit
def _circles(x, out):
    for i in range(len(x)):
        out[i] = triples.circle(x[i])


def test_the_circle_without_a_branch():
    x = np.concatenate([np.linspace(-30, 30, 9001), 0.25 * np.pi * np.arange(-9, 10), [1e-300, 1e-9, 1e4]])
    out = np.zeros((len(x), 2))
    _circles(x, out)
    assert_rounded_alike(out, np.column_stack([np.cos(x), np.sin(x)]), scale=1.0)


@njit
def _fly_lanes(work, bodies, memory, cameras, offset, constants, periods):
    """All lanes, those without an agent as the last one; whether nothing turned too fast."""
    x, last = work[0, 0], bodies.shape[1] - 1
    for i in range(lane_layout.LANES):
        lane_layout.load_flight(x, i, bodies, memory, cameras, 0, min(i, last))
    lanes.note_joints(x)
    wild = lanes.fly_lanes(work, 1, periods, constants)
    lanes.carry_cameras(work, 1, offset)
    for i in range(last + 1):
        lane_layout.store_flight(x, i, bodies, memory, 0, i)
    lane_layout.show(x, last + 1, bodies, cameras, 0, 0)
    return wild == 0


@njit
def _refer_lanes(work, motion, setpoint, cameras, gains, code, margin, limits, gaze_limits, dt):
    """Command and move on one agent in all lanes; whether it may without braking."""
    x = work[0, 0]
    for i in range(lane_layout.LANES):
        lane_layout.load_plan(x, i, motion, setpoint, 0, 0)
        for k in range(7):
            x[(lane_layout.CAMERA + k) * lane_layout.LANES + i] = cameras[k]
    lane_references.ask_lanes(work, 1, gains, code)
    return lane_references.follow_lanes(work, 1, margin, limits, gaze_limits, dt) == 0


@pytest.mark.parametrize("flight_hz", [60, 240])
def test_flight_is_that_of_pybullet(flight_hz):
    wind = WindSettings(mean_mps=(0.6, -0.3, 0.1))
    physics = PhysicsSettings(flight_hz=flight_hz, wind=wind)
    yaw = (0.0, 0.7, -2.0)
    agents = tuple(AgentSpec(f"a{k}", np.array([9.0 * k, 0, 5]), yaw[k], CAMERA) for k in range(3))
    world = PyBulletWorld(WorldDescription(physics, 60.0, agents))
    now = world.reset(np.random.default_rng(0))
    constants, offset = (
        pack_model(model_from_settings(physics, 240 // flight_hz)),
        np.array(physics.gimbal.offset_m),
    )
    bodies, memory, cameras = np.zeros((1, 3, 13)), np.zeros((1, 3, 19)), np.zeros((1, 3, 13))
    bodies[0, :, :3], bodies[0, :, 3:7] = now.agent_p_world, np.roll(now.agent_q_world, -1, axis=1)
    circle = np.column_stack([np.cos(yaw), np.sin(yaw)])
    memory[0] = trimmed(constants, circle, np.array(wind.mean_mps))[1]
    beside = (bodies.copy(), memory.copy(), cameras.copy())
    nowhere = (np.zeros((3, 2, 3)), np.zeros((3, 3)))
    work = lane_layout.build_lanes(3, circle, circle, *nowhere, np.array(wind.mean_mps))
    rows = work[0, 0].reshape(-1, lane_layout.LANES)
    rng = np.random.default_rng(1)
    for k in range(180):
        if k % 20 == 0:  # hard manoeuvres: saturated, turning, tilted
            u, a, w = rng.uniform(-3, 3, (3, 3)), rng.uniform(-2, 2, (3, 3)), rng.uniform(-1.5, 1.5, (3, 3))
        now = world.step(CameraCommand(u, w, a))
        for i in range(3):
            heading = (math.cos(yaw[i]), math.sin(yaw[i]))
            command = (tuple(u[i]), tuple(a[i]), tuple(w[i]), heading, wind.mean_mps)
            fly(bodies, memory, 0, i, *command, constants, flight_hz // 60)
            camera_of(bodies, memory, 0, i, offset, cameras)
        rows[lane_layout.U : lane_layout.U + 9] = np.column_stack([u, a, w])[[0, 1, 2, 2]].T
        assert _fly_lanes(work, *beside, offset, constants, flight_hz // 60)
    world.close()
    for alone, together in zip((bodies, memory, cameras), beside, strict=True):
        np.testing.assert_allclose(together, alone, rtol=1e-12, atol=1e-12)
    beside[0][0, 1, 10] = 100.0  # tumbles: too fast for the series, nothing is done
    tumbling = [part.copy() for part in beside]
    assert not _fly_lanes(work, *beside, offset, constants, 1)
    for part, before in zip(beside[:2], tumbling[:2], strict=True):
        np.testing.assert_array_equal(part, before)
    for mine, theirs in (
        (bodies[0, :, :3], now.agent_p_world),
        (bodies[0, :, [6, 3, 4, 5]].T, now.agent_q_world),
        (bodies[0, :, 7:10], now.agent_v_world),
        (cameras[0, :, :3], now.camera_p_world),
        (cameras[0, :, 3:7], now.camera_q_world),
        (cameras[0, :, 7:10], now.camera_v_world),
        (cameras[0, :, 10:], now.camera_w_cam),
    ):
        np.testing.assert_allclose(mine, theirs, rtol=0, atol=1e-11)


@pytest.mark.parametrize("flight_hz", [60, 240])
def test_who_turns_calmly_does_not_come_to_turn_too_fast(flight_hz):
    constants, dt = pack_model(model_from_settings(PhysicsSettings(), 240 // flight_hz)), 1 / 240
    calm, most = lanes.calm_rate(240 // flight_hz * dt, dt, tuple(constants)), 2 * triples.SMALL / dt
    assert 0.4 * most < calm < most
    rng, fastest = np.random.default_rng(3), 0.0
    for _ in range(2000):
        bodies, memory = np.zeros((1, 1, 13)), np.zeros((1, 1, 19))
        way, q = rng.standard_normal(3), rng.standard_normal(4)
        bodies[0, 0, 3:7], bodies[0, 0, 10:] = q / np.linalg.norm(q), calm * way / np.linalg.norm(way)
        memory[0, 0, :4], memory[0, 0, 15] = rng.choice([0.0, constants[8]], 4), 1.0
        u, a, w = 9.0 * rng.standard_normal((3, 3))
        command = (tuple(u), tuple(a), tuple(w), (1.0, 0.0), (0.0, 0.0, 0.0))
        fly(bodies, memory, 0, 0, *command, constants, 1)
        fastest = max(fastest, float(np.linalg.norm(bodies[0, 0, 10:])))
    assert calm < fastest <= most


LIMITS = np.array([1.5, 2.0, 2.0, 8.0, 8.0])


@pytest.mark.parametrize(
    "region", [BoxRegion("b", (-1, -2, 0), (1, 2, 3)), CylinderRegion("c", (0.5, 0.0), 1.5, (0.0, 3.0))]
)
def test_references_are_those_of_the_array_kernel(region):
    bounds, margin, dt = RegionBounds.of(region), 0.25, 1 / 60
    ends, discs = np.array([0, len(bounds.planes)]), bounds.disc[None]
    rng = np.random.default_rng(4)
    p, v, a = np.array(region.center, dtype=float), np.zeros(3), np.zeros(3)
    mine = (tuple(p), tuple(v), tuple(a))
    gaze_limits, gains, camera = np.array([1.5, 6.0, 4.0]), np.array([2.0, 0.3, 0.5, 0.1]), np.eye(7)[3]
    one = np.array([[1.0, 0.0]])
    work = lane_layout.build_lanes(1, one, one, region.bounds[None], discs, np.zeros(3))
    rows, going = work[0, 0].reshape(-1, lane_layout.LANES), 0
    for k in range(1500):
        if k % 40 == 0:  # goals beyond the border as well, so that braking sets in
            goal = region.center + rng.uniform(-1.4, 1.4, 3)
        reference_kernel.position_step(
            p, v, goal, margin, bounds.planes, bounds.disc, bounds.polygon, LIMITS, dt, a
        )
        motion = np.concatenate([np.ravel(mine), np.zeros(4)])[None, None]
        setpoint = np.concatenate([goal, np.zeros(2)])[None, None]
        limits = (LIMITS, gaze_limits)
        free = _refer_lanes(work, motion, setpoint, camera, gains, 2, margin, *limits, dt)
        mine = position_step(*mine, tuple(goal), 0, margin, bounds.planes, ends, discs, LIMITS, dt)
        going += free
        lane = rows[lane_layout.MOTION : lane_layout.MOTION + 9]
        expected = np.ravel(mine) if free else motion[0, 0, :9]  # who has to brake waits
        np.testing.assert_allclose(lane, np.tile(expected[:, None], lane_layout.LANES), rtol=0, atol=1e-13)
        np.testing.assert_allclose(np.array(mine), [p, v, a], rtol=0, atol=1e-9)
    assert 0 < going < 1500


def test_gaze_and_command_are_those_of_the_array_kernels():
    rng, yaw = np.random.default_rng(5), 0.6
    gaze, rate = np.zeros(2), np.zeros(2)
    mine = (0.0, 0.0, 0.0, 0.0)
    gains = np.array([2.0, 0.3, 0.5, 0.12])
    circles = [np.array([[math.cos(x), math.sin(x)]]) for x in (yaw, 0.5 * yaw)]
    everywhere = np.array([[[-1e9] * 3, [1e9] * 3]])
    work = lane_layout.build_lanes(1, *circles, everywhere, np.zeros((1, 3)), np.zeros(3))
    rows, gaze_limits = work[0, 0].reshape(-1, lane_layout.LANES), np.array([1.5, 6.0, 4.0])
    for k in range(300):
        if k % 30 == 0:
            goal = rng.uniform(-1.2, 1.2, 2)
        reference_kernel.gaze_step(gaze, rate, goal, 1.5, 6.0, 4.0, 1 / 60)
        mine = gaze_step(mine[:2], mine[2:], tuple(goal), 1.5, 6.0, 4.0, 1 / 60)
        np.testing.assert_allclose(mine, [*gaze, *rate], rtol=0, atol=1e-12)
        turning = reference_kernel.gaze_motion(gaze, rate, yaw)
        circle = [(math.cos(x), math.sin(x)) for x in (yaw, 0.5 * yaw)]
        q_d, w_d = gaze_motion(*mine, *circle)
        np.testing.assert_allclose([*q_d, *w_d], turning, rtol=0, atol=1e-12)
        p, p_d, v_d = rng.standard_normal((3, 3))
        q = rotations.multiply(turning[:4], rotations.exp(0.5 * rng.standard_normal(3)))
        for code in range(3):
            wanted = control_compiled(
                p[None], q[None], p_d[None], turning[None, :4], v_d[None], turning[None, 4:], gains, code
            )
            u, w, e = command_of(tuple(p), tuple(q), tuple(p_d), q_d, tuple(v_d), w_d, gains, code)
            np.testing.assert_allclose([u, w, e], wanted[:3, 0], rtol=0, atol=1e-11)
            motion = np.concatenate([p_d, v_d, np.zeros(3), mine])[None, None]
            asked, camera = np.array([[[0.0, 0.0, 0.0, *goal]]]), np.concatenate([p, q])
            limits = (LIMITS, gaze_limits, 1 / 60)
            assert _refer_lanes(work, motion, asked, camera, gains, code, 0.0, *limits)
            np.testing.assert_allclose(rows[lane_layout.U : lane_layout.U + 3, 1], u, rtol=0, atol=1e-13)
            np.testing.assert_allclose(
                rows[lane_layout.LOOK : lane_layout.LOOK + 3, 2], w, rtol=0, atol=1e-13
            )
            ahead = gaze_step(mine[:2], mine[2:], tuple(goal), 1.5, 6.0, 4.0, 1 / 60)
            place = slice(lane_layout.MOTION + 9, lane_layout.MOTION + 13)
            assert_rounded_alike(rows[place, 3], ahead, scale=1.0)


@pytest.mark.parametrize(
    ("environments", "threads"), [(1, 1), (3, 4), (20, 2), (1024, 2), (5000, 16), (3000, 1)]
)
def test_groups_share_out_all_environments_and_the_last_are_small(environments: int, threads: int) -> None:
    sizes = _group_sizes(environments, threads)
    assert sum(sizes) == environments
    assert all(0 < size <= 1024 for size in sizes)
    if threads > 1:
        assert len(sizes) >= min(threads, environments)
        assert sizes[-1] <= max(lane_layout.BLOCK, sizes[0])
        assert sizes == sorted(sizes, reverse=True)
