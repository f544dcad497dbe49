"""The limit that PyBullet itself sets: bodies stepped with the least number of calls, and nothing computed."""

from __future__ import annotations

import time

import pybullet as pb

__all__ = ["raw_seconds"]


def raw_seconds(agents: int, simulated_s: float, step_hz: int) -> float:
    """CPU time that bare PyBullet takes for ``agents`` bodies.

    A body and step cost one force, one torque, one pose and one velocity call, as in the full world.
    """
    client = pb.connect(pb.DIRECT)
    try:
        pb.setGravity(0, 0, -9.81, physicsClientId=client)
        pb.setPhysicsEngineParameter(
            fixedTimeStep=1 / step_hz, numSolverIterations=10, physicsClientId=client
        )
        shape = pb.createCollisionShape(pb.GEOM_CYLINDER, radius=0.2, height=0.1, physicsClientId=client)
        bodies = [
            pb.createMultiBody(1.0, shape, basePosition=(5.0 * i, 0, 3), physicsClientId=client)
            for i in range(agents)
        ]
        start = time.process_time()
        for _ in range(round(simulated_s * step_hz)):
            for body in bodies:
                p, _ = pb.getBasePositionAndOrientation(body, client)
                pb.getBaseVelocity(body, client)
                pb.applyExternalForce(body, -1, (0, 0, 9.81), p, pb.WORLD_FRAME, client)
                pb.applyExternalTorque(body, -1, (0, 0, 0), pb.WORLD_FRAME, client)
            pb.stepSimulation(client)
        return time.process_time() - start
    finally:
        pb.disconnect(client)
