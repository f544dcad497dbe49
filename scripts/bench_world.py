"""How fast the PyBullet world runs, beside the limit that PyBullet itself sets on this machine.

Usage: python scripts/bench_world.py [--agents 4] [--seconds 20] [--json]

The limit: the same number of bodies and physics steps, and per body and step one force, one torque, one pose and one
velocity call with nothing computed. Both run by turns in one process; compare the ratio, not the absolutes.
"""

from __future__ import annotations

import argparse
import json
import statistics
import time

import numpy as np
import pybullet as pb

from camnet.geometry.settings import CameraModel, Intrinsics
from camnet.world import AgentSpec, CameraCommand, WorldDescription
from camnet.world.pybullet import PyBulletWorld
from camnet.world.settings import PhysicsSettings

STEP_HZ, CONTROL_HZ = 240, 60


def raw_seconds(agents: int, seconds: float) -> float:
    """CPU time of bare PyBullet."""
    c = pb.connect(pb.DIRECT)
    pb.setGravity(0, 0, -9.81, physicsClientId=c)
    pb.setPhysicsEngineParameter(fixedTimeStep=1 / STEP_HZ, numSolverIterations=10, physicsClientId=c)
    shape = pb.createCollisionShape(pb.GEOM_CYLINDER, radius=0.2, height=0.1, physicsClientId=c)
    bodies = [
        pb.createMultiBody(1.0, shape, basePosition=(5.0 * i, 0, 3), physicsClientId=c) for i in range(agents)
    ]
    start = time.process_time()
    for _ in range(round(seconds * STEP_HZ)):
        for body in bodies:
            p, _ = pb.getBasePositionAndOrientation(body, c)
            pb.getBaseVelocity(body, c)
            pb.applyExternalForce(body, -1, (0, 0, 9.81), p, pb.WORLD_FRAME, c)
            pb.applyExternalTorque(body, -1, (0, 0, 0), pb.WORLD_FRAME, c)
        pb.stepSimulation(c)
    spent = time.process_time() - start
    pb.disconnect(c)
    return spent


def world_seconds(agents: int, seconds: float) -> float:
    """CPU time of ``PyBulletWorld.step``."""
    intrinsics = Intrinsics(width_px=640, height_px=368, fx_px=400, fy_px=400, cx_px=320, cy_px=184)
    camera = CameraModel(name="camera", intrinsics=intrinsics)
    specs = tuple(AgentSpec(f"a{i}", np.array([5.0 * i, 0, 3.0]), 0.0, camera) for i in range(agents))
    world = PyBulletWorld(WorldDescription(PhysicsSettings(step_hz=STEP_HZ), CONTROL_HZ, specs))
    world.reset(np.random.default_rng(0))
    still = np.zeros((agents, 3))
    for _ in range(5):
        world.step(CameraCommand(still, still))
    start = time.process_time()
    for k in range(round(seconds * CONTROL_HZ)):
        v = np.tile([0.5 * np.sin(0.05 * k), 0.2 * np.cos(0.03 * k), 0.0], (agents, 1))
        world.step(CameraCommand(v, still))
    spent = time.process_time() - start
    world.close()
    return spent


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--agents", type=int, default=4)
    parser.add_argument("--seconds", type=float, default=20.0, help="simulated time of one repetition")
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    pairs = [
        (raw_seconds(options.agents, options.seconds), world_seconds(options.agents, options.seconds))
        for _ in range(options.repeats)
    ]
    raw, world = (options.seconds / statistics.median(x) for x in zip(*pairs, strict=True))
    ratio = statistics.median(a / b for a, b in pairs)
    figures = {
        "agents": options.agents,
        "raw_times_real_time": round(raw, 1),
        "world_times_real_time": round(world, 1),
        "share_of_raw": round(ratio, 3),
    }
    if options.json:
        print(json.dumps(figures))
    else:
        print("\n".join(f"{name:24s} {value}" for name, value in figures.items()))


if __name__ == "__main__":
    main()
