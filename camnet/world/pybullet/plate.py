"""A target that carries a fiducial marker: the box with a textured plate on it, one body with one fixed link."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import pybullet as pb

from camnet.errors import WorldError
from camnet.geometry.rotations import IDENTITY
from camnet.sensing.marker import Marker, pattern
from camnet.world.pybullet.engine import Engine, xyzw
from camnet.world.pybullet.shapes import Solid

__all__ = ["add_marked"]

#: texture pixels along a module, and how far the plate is above the marker's place, m
_MODULE_PX, _LIFT_M = 64, 2e-4


def add_marked(
    engine: Engine,
    name: str,
    solid: Solid,
    p_world: Sequence[float],
    color: tuple[float, float, float, float],
    marker: Marker,
) -> int:
    """Create a standing body of shape ``solid`` with ``marker`` on it and return its number.

    Raises
    ------
    WorldError
        The engine cannot build it.
    """
    c = engine.client
    box = pb.createVisualShape(
        **solid.visual, rgbaColor=color, specularColor=(0.1, 0.1, 0.1), physicsClientId=c
    )
    shape = pb.createCollisionShape(**solid.collision, physicsClientId=c)
    body: int = pb.createMultiBody(
        0.0,
        shape,
        box,
        basePosition=p_world,
        baseOrientation=xyzw(IDENTITY),
        linkMasses=[0.0],
        linkCollisionShapeIndices=[-1],
        linkVisualShapeIndices=[_plate(c, marker)],
        linkPositions=[[0.0, 0.0, 0.0]],
        linkOrientations=[[0.0, 0.0, 0.0, 1.0]],
        linkInertialFramePositions=[[0.0, 0.0, 0.0]],
        linkInertialFrameOrientations=[[0.0, 0.0, 0.0, 1.0]],
        linkParentIndices=[0],
        linkJointTypes=[pb.JOINT_FIXED],
        linkJointAxis=[[0.0, 0.0, 1.0]],
        physicsClientId=c,
    )
    if min(box, shape, body) < 0:
        raise WorldError(f"PyBullet could not build the marked body {name!r}")
    pb.changeVisualShape(body, 0, textureUniqueId=_texture(c, marker.number), physicsClientId=c)
    engine.stand(body, name)
    return body


def _plate(client: int, marker: Marker) -> int:
    """Visual shape of the plate; its texture's first row runs from the pattern's top left to the top right."""
    corners = marker.plate()
    normal = np.cross(corners[1] - corners[0], corners[0] - corners[3])
    normal /= np.linalg.norm(normal)
    shape: int = pb.createVisualShape(
        pb.GEOM_MESH,
        vertices=(corners + _LIFT_M * normal).tolist(),
        indices=[0, 2, 1, 0, 3, 2],  # counter-clockwise as seen
        uvs=[[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]],
        normals=[normal.tolist()] * 4,
        rgbaColor=(1.0, 1.0, 1.0, 1.0),
        specularColor=(0.0, 0.0, 0.0),
        physicsClientId=client,
    )
    return shape


def _texture(client: int, number: int) -> int:
    """Texture of one pattern; the engine reads textures from files only."""
    image = np.kron(pattern(number), np.ones((_MODULE_PX, _MODULE_PX), dtype=np.uint8))
    with tempfile.TemporaryDirectory() as folder:
        file = str(Path(folder) / "marker.png")
        if not cv2.imwrite(file, cv2.cvtColor(image, cv2.COLOR_GRAY2BGR)):
            raise WorldError(f"cannot write the marker's texture to {file}")
        texture: int = pb.loadTexture(file, physicsClientId=client)
    if texture < 0:
        raise WorldError(f"PyBullet could not load the texture of marker {number}")
    return texture
