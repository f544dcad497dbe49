"""Pictures from PyBullet's software renderer with the pinhole intrinsics of a camera (no lens distortion)."""

from __future__ import annotations

import numpy as np
import pybullet as pb
from numpy.typing import NDArray

from camnet.geometry.rotations import to_matrix
from camnet.geometry.settings import Intrinsics
from camnet.types import Array
from camnet.world.pybullet.engine import Engine

__all__ = ["picture", "projection_matrix", "view_matrix"]

_LIGHT_FROM = (4.0, -3.0, 10.0)


def view_matrix(p_world: Array, q_world: Array) -> list[float]:
    """World to OpenGL camera (x right, y up, z backward), column by column, of a camera-to-world pose."""
    rows = np.diag([1.0, -1.0, -1.0]) @ to_matrix(q_world).T
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rows, -rows @ p_world
    return [float(x) for x in matrix.T.ravel()]


def projection_matrix(intrinsics: Intrinsics, near_m: float, far_m: float) -> list[float]:
    """OpenGL projection, column by column; pixel centres are whole numbers, as OpenCV has them.

    The software renderer samples a pixel at its lower left corner, not at its centre as OpenGL does. In rows counted
    from above whose centres are whole numbers, that corner is (0, 1) away from OpenGL's origin.
    """
    k = intrinsics
    matrix = np.zeros((4, 4))
    matrix[0, 0], matrix[0, 2] = 2.0 * k.fx_px / k.width_px, 1.0 - 2.0 * k.cx_px / k.width_px
    matrix[1, 1], matrix[1, 2] = 2.0 * k.fy_px / k.height_px, 2.0 * (k.cy_px + 1.0) / k.height_px - 1.0
    matrix[2, 2], matrix[2, 3] = (near_m + far_m) / (near_m - far_m), 2.0 * near_m * far_m / (near_m - far_m)
    matrix[3, 2] = -1.0
    return [float(x) for x in matrix.T.ravel()]


def picture(
    engine: Engine, view: list[float], projection: list[float], width: int, height: int
) -> NDArray[np.uint8]:
    """RGB picture (height, width, 3)."""
    _, _, rgba, _, _ = pb.getCameraImage(
        width,
        height,
        viewMatrix=view,
        projectionMatrix=projection,
        lightDirection=_LIGHT_FROM,
        lightAmbientCoeff=0.65,
        lightDiffuseCoeff=0.45,
        lightSpecularCoeff=0.0,
        shadow=0,
        flags=pb.ER_NO_SEGMENTATION_MASK,
        renderer=pb.ER_TINY_RENDERER,
        physicsClientId=engine.client,
    )
    return np.asarray(rgba, dtype=np.uint8).reshape(height, width, 4)[:, :, :3].copy()
