"""Simulated worlds: the truth, stepped by a physics engine behind one protocol.

`protocol` is what a world offers, `description` what it is made of, ``pybullet`` the engine. Next: `camnet.control`.
"""

from __future__ import annotations

from camnet.world.description import AgentSpec, CameraSpec, OccluderSpec, TargetSpec, WorldDescription
from camnet.world.protocol import CameraCommand, World

__all__ = [
    "AgentSpec",
    "CameraCommand",
    "CameraSpec",
    "OccluderSpec",
    "TargetSpec",
    "World",
    "WorldDescription",
]
