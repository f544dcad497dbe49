"""A kinematic replica of the main job: a robot on a closed loop, seen only in parts of it."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

from camnet.estimation.protocol import TargetFilter
from camnet.geometry import rotations, rotations_compiled
from camnet.types import CameraMotion, PoseMeasurement, Twist

RATE_HZ = 30.0
_STATIC = CameraMotion(
    np.array([0.0, 0.0, 3.0]), rotations.look_at([0.0, 0.0, 3.0], [0.5, 0.0, 0.0]), np.zeros(3), np.zeros(3)
)


@dataclass
class Replica:
    """Truth over time on a wobbly circle, with its four seen sectors."""

    t: np.ndarray
    p: np.ndarray
    q: np.ndarray
    v: np.ndarray
    w: np.ndarray
    region: np.ndarray
    lap: np.ndarray

    def twist(self, t_s: float) -> Twist:
        k = min(len(self.t) - 1, round(t_s * RATE_HZ))
        return Twist(self.v[k], self.w[k])


def make_replica(
    laps: int = 6,
    radius: float = 4.0,
    speed: float = 0.35,
    wobble: float = 0.03,
    gap_m: float = 3.0,
    drift: float = 0.0,
    wander: float = 0.0,
    seed: int = 0,
) -> Replica:
    """Loop r(phi) = radius (1 + wobble sin 3 phi ...) at nearly constant speed; gaps of ``gap_m`` between 4 regions."""
    dt = 1.0 / RATE_HZ
    phi, rows = -0.15, []

    def point(a: float, t: float) -> np.ndarray:
        r = radius * (1.0 + wobble * (math.sin(3 * a + 0.5) + 0.6 * math.cos(5 * a))) + drift * math.sin(
            0.05 * t
        )
        return np.array([r * math.cos(a), r * math.sin(a), 0.0])

    t, y, rng = 0.0, 0.0, np.random.default_rng(seed)
    while phi < 2 * math.pi * laps:
        tangent = (point(phi + 1e-4, t) - point(phi - 1e-4, t)) / 2e-4
        # an Ornstein-Uhlenbeck process with a correlation time of 10 s
        y += -0.1 * y * dt + math.sqrt(0.2 * dt) * rng.standard_normal() if wander else 0.0
        drive = speed * math.exp(wander * y)
        pace = drive * (1.0 + 0.15 * math.sin(2 * phi))
        rows.append((t, phi, *point(phi, t), pace, *(tangent / np.linalg.norm(tangent))))
        mid = phi + 0.5 * dt * pace / np.linalg.norm(tangent)
        tangent = (point(mid + 1e-4, t) - point(mid - 1e-4, t)) / 2e-4
        phi += dt * drive * (1.0 + 0.15 * math.sin(2 * mid)) / np.linalg.norm(tangent)
        t += dt
    a = np.array(rows)
    yaw = np.unwrap(np.arctan2(a[:, 7], a[:, 6]))
    p = a[:, 2:5]
    v = np.gradient(p, dt, axis=0)
    w = np.zeros_like(v)
    w[:, 2] = np.gradient(yaw, dt)
    quarter = np.mod(a[:, 1] + math.pi / 4, math.pi / 2) - math.pi / 4
    half_seen = math.pi / 4 - 0.5 * gap_m / radius
    index = np.mod(np.floor((a[:, 1] + math.pi / 4) / (math.pi / 2)), 4).astype(int)
    region = np.where(np.abs(quarter) < half_seen, index, -1)
    return Replica(
        a[:, 0], p, rotations.from_yaw(yaw), v, w, region, np.floor(a[:, 1] / (2 * math.pi)).astype(int)
    )


def to_measurement(t: float, p: np.ndarray, q: np.ndarray, motion: CameraMotion = _STATIC) -> PoseMeasurement:
    """The measurement whose world pose is (p, q)."""
    p_cam = rotations_compiled.rotate_inverse(motion.q_world, p - motion.p_world)
    q_cam = rotations_compiled.multiply(rotations_compiled.conjugate(motion.q_world), q)
    return PoseMeasurement(t, 0, 0, p_cam, q_cam, motion)


@dataclass
class Result:
    """Errors at every instant of a run."""

    replica: Replica
    position_m: np.ndarray
    orientation_rad: np.ndarray
    radius_m: np.ndarray
    cpu_s: float
    filter: TargetFilter

    def rmse(self, seen: bool, first: int, last: int = 99, kind: str = "position_m") -> float:
        r = self.replica
        pick = ((r.region >= 0) == seen) & (r.lap >= first) & (r.lap <= last) & (r.t > 1.0)
        return float(np.sqrt(np.mean(getattr(self, kind)[pick] ** 2)))


def run_replica(
    replica: Replica,
    target_filter: TargetFilter,
    seed: int = 0,
    noise_m: float = 0.01,
    noise_rad: float = 0.01,
) -> Result:
    rng = np.random.default_rng(seed)
    n = len(replica.t)
    measured_p = replica.p + noise_m * rng.standard_normal((n, 3))
    measured_q = rotations.multiply(replica.q, rotations.exp(noise_rad * rng.standard_normal((n, 3))))
    measured_q *= rng.choice([-1.0, 1.0], size=(n, 1))
    measurements = [to_measurement(replica.t[k], measured_p[k], measured_q[k]) for k in range(n)]
    position, orientation, radius = np.zeros(n), np.zeros(n), np.zeros(n)
    cpu = time.process_time()
    for k in range(n):
        if replica.region[k] >= 0:
            target_filter.correct(measurements[k], int(replica.region[k]))
        else:
            target_filter.predict(float(replica.t[k]))
        e = target_filter.estimate
        position[k] = math.dist(e.p_world, replica.p[k])
        radius[k] = e.radius_m
        orientation[k] = 2 * math.acos(min(1.0, abs(float(e.q_world @ replica.q[k]))))
    return Result(replica, position, orientation, radius, time.process_time() - cpu, target_filter)


@pytest.fixture(scope="session")
def replica_factory() -> Callable[..., Replica]:
    return make_replica


@pytest.fixture(scope="session")
def replica_runner() -> Callable[..., Result]:
    return run_replica


@pytest.fixture(scope="session")
def measurement_of() -> Callable[..., PoseMeasurement]:
    return to_measurement
