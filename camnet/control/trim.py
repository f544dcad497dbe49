r"""Hover in a steady wind: the attitude, rotor speeds and memory with which a quadrotor stands still in it.

An agent that begins level in a wind is blown away before its inner loop has leaned into it; for seconds its motion
differs from every command by more than any bound of the disturbance in harris2020 (Assumption 4.3). Flights begin where
take-off has ended, so they begin trimmed:

    T b3 = m g e3 - R D R^T v_wind        thrust against weight and drag at rest
    z = T b3 / m - g e3                   what the integral of the velocity loop has to hold

b3 is the last column of R, so with a drag D that differs by axis this is a fixed point; it is found by iteration, which
contracts where the drag is small beside the weight. The gimbal's joints undo the lean: the camera looks straight down.

| symbol | name | unit |
| --- | --- | --- |
| T, b3 | thrust and its direction, world frame | N, - |
| R | body to world | - |
| D | drag coefficients along the body's axes | N s/m |
| z | velocity integral | m/s^2 |
"""

from __future__ import annotations

import numpy as np

from camnet.control.gimbal import NADIR
from camnet.control.quadrotor_kernel import MEMORY
from camnet.geometry.rotations import from_matrix
from camnet.types import Array

__all__ = ["trimmed"]

_ROUNDS = 60


def trimmed(constants: Array, heading: Array, wind_mps: Array) -> tuple[Array, Array]:
    """Return orientation and memory of N quadrotors that hover in a wind.

    Parameters
    ----------
    constants : (27,) of `camnet.control.quadrotor_kernel.pack_model`
    heading : (N, 2) cosine and sine of the bodies' headings
    wind_mps : (3,) steady wind, world frame

    Returns
    -------
    q : (N, 4) body to world, w first
    memory : (N, 19) in the kernel's order; rotors no faster than they can be, the integral no larger than is used
    """
    n, mass, weight = len(heading), constants[1], constants[1] * constants[13]
    forward = np.column_stack([heading, np.zeros(n)])
    drag = np.diag(constants[10:13])
    axis = np.tile([0.0, 0.0, 1.0], (n, 1))
    force = np.zeros((n, 3))
    for _ in range(_ROUNDS):
        r = _attitude(axis, forward)
        pushed = np.einsum("nij,jk,nlk,l->ni", r, drag, r, wind_mps)
        force = weight * np.array([0.0, 0.0, 1.0]) - pushed
        axis = force / np.linalg.norm(force, axis=1, keepdims=True)
    r = _attitude(axis, forward)
    memory = np.zeros((n, 19))
    thrust = np.einsum("ni,ni->n", force, axis)
    memory[:, MEMORY["rotor"]] = np.minimum(np.sqrt(thrust / 4.0 / constants[6]), constants[8])[:, None]
    held = force / mass - np.array([0.0, 0.0, constants[13]])
    size = np.linalg.norm(held, axis=1, keepdims=True)
    memory[:, MEMORY["integral"]] = held * np.minimum(1.0, constants[15] / np.maximum(size, 1e-12))
    memory[:, MEMORY["thrust_axis"]] = axis
    memory[:, MEMORY["theta"]] = _joints(r, forward)
    return from_matrix(r).reshape(n, 4), memory


def _attitude(axis: Array, forward: Array) -> Array:
    """Return rotations (N,3,3) with z along ``axis`` and x towards the heading, as the inner loop asks for them."""
    side = np.cross(axis, forward)
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    return np.stack([np.cross(side, axis), side, axis], axis=2)


def _joints(r: Array, forward: Array) -> Array:
    """Return joint angles (N,3) that let the camera look straight down, its x axis along the heading."""
    up = np.tile([0.0, 0.0, 1.0], (len(r), 1))
    level = np.stack([forward, np.cross(up, forward), up], axis=2)
    # N R^T level N = Rz(-yaw) Ry(pan) Rx(tilt)
    m = np.einsum("ij,nkj,nkl,lm->nim", NADIR, r, level, NADIR)
    yaw = -np.arctan2(m[:, 1, 0], m[:, 0, 0])
    pan = -np.arcsin(np.clip(m[:, 2, 0], -1.0, 1.0))
    return np.stack([yaw, pan, np.arctan2(m[:, 2, 1], m[:, 2, 2])], axis=1)
