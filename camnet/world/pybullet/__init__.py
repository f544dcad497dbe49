"""The PyBullet back end; the only place that imports the engine. Start reading at `world`."""

from __future__ import annotations

from camnet.world.pybullet.world import PyBulletWorld

__all__ = ["PyBulletWorld"]
