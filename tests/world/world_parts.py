"""Worlds for the tests of this folder."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from camnet.geometry.settings import CameraModel, Intrinsics
from camnet.world import AgentSpec, CameraSpec, OccluderSpec, TargetSpec, WorldDescription
from camnet.world.settings import PhysicsSettings

CAMERA = CameraModel(
    name="c",
    intrinsics=Intrinsics(width_px=320, height_px=200, fx_px=210, fy_px=190, cx_px=150, cy_px=104),
    far_m=20.0,
)


class Straight:
    """A target that drives along x; the speed is drawn at the start."""

    def __init__(self, start=(1.0, 0.0, 0.0), speed=0.3, turn=0.0):
        self.start, self.speed, self.turn = np.array(start, float), speed, turn
        self.v_max_mps, self.w_max_radps = 2.0, 1.0

    def reset(self, rng):
        half = 0.5 * self.turn
        return SimpleNamespace(
            p_world=self.start.copy(),
            q_world=np.array([np.cos(half), 0, 0, np.sin(half)]),
            v_world=np.array([self.speed * rng.uniform(0.9, 1.1), 0, 0]),
            w_body=np.zeros(3),
        )

    def step(self, state, t_s, dt_s, rng):
        values = {**vars(state), "p_world": state.p_world + dt_s * state.v_world}
        return SimpleNamespace(**values)


def describe(n=2, occluders=(), targets=None, cameras=(), spacing=4.0, height=3.0, control_hz=60, **physics):
    agents = tuple(
        AgentSpec(f"a{i}", np.array([spacing * i, 0.0, height]), 0.3 * i, CAMERA) for i in range(n)
    )
    motions = (Straight(),) if targets is None else targets
    return WorldDescription(
        physics=PhysicsSettings(**physics),
        control_hz=control_hz,
        agents=agents,
        cameras=tuple(CameraSpec(name, CAMERA, p, q) for name, p, q in cameras),
        occluders=tuple(OccluderSpec(name, shape) for name, shape in occluders),
        targets=tuple(
            TargetSpec(f"t{k}", (0.35, 0.35, 0.3), np.array([[0.1, 0.1, 0.3]]), m)
            for k, m in enumerate(motions)
        ),
    )
