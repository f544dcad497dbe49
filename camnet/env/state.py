"""The true state of a network as one flat array, for centralised critics.

Per agent: camera position (3) and velocity (3), optical axis (3). Per target: position (3), velocity (3), heading
(cosine, sine), then one number per camera: 1 if it sees the target. Positions are taken from the network's centre
in its half-sizes, velocities over the top speeds; everything is clipped to [-3, 3].
"""

from __future__ import annotations

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from camnet.geometry.rotations import rotate, yaw_of
from camnet.simulation.loop import NetworkSimulation

__all__ = ["StateEncoder"]

_LIMIT = 3.0


class StateEncoder:
    """Encodes the truth of one network."""

    def __init__(self, simulation: NetworkSimulation) -> None:
        network = simulation.network
        self._center, self._half = network.bounds.mean(axis=0), np.ptp(network.bounds, axis=0) / 2
        self._agent_speed = network.scenario.controller.reference_v_max_mps
        self._target_speed = np.array([t.v_max_mps for t in network.scenario.targets])[:, None]
        self._size = 9 * network.n_agents + network.n_targets * (8 + len(network.cameras))

    def space(self) -> spaces.Box:
        """Space of the state."""
        return spaces.Box(-_LIMIT, _LIMIT, (self._size,), dtype=np.float32)

    def encode(self, simulation: NetworkSimulation) -> NDArray[np.float32]:
        """Flatten the present truth."""
        truth, n = simulation.snapshot, simulation.network.n_agents
        axis = rotate(truth.camera_q_world[:n], np.array([0.0, 0.0, 1.0]))
        yaw = yaw_of(truth.target_q_world)
        parts = [
            (truth.camera_p_world[:n] - self._center) / self._half,
            truth.camera_v_world[:n] / self._agent_speed,
            axis,
            (truth.target_p_world - self._center) / self._half,
            truth.target_v_world / self._target_speed,
            np.stack([np.cos(yaw), np.sin(yaw)], axis=1),
            simulation.visible.T.astype(float),
        ]
        flat = np.concatenate([part.ravel() for part in parts])
        return np.asarray(np.clip(flat, -_LIMIT, _LIMIT), dtype=np.float32)
