"""Does the image keep up? Time of a marker's view, drawn by homography and by PyBullet, and of reading poses from it.

Four cameras at 30 Hz leave 8.3 ms a view on one core and 16.7 ms on two.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from camnet.geometry import rotations
from camnet.geometry.settings import CameraModel, Intrinsics
from camnet.motion.factory import build_motion
from camnet.motion.settings import TargetSettings, VectorFieldTarget
from camnet.sensing.marker import marker_on
from camnet.sensing.readers import FeatureReader, ImageReader
from camnet.sensing.settings import FeatureSettings, ImageSettings
from camnet.types import Array, Snapshot
from camnet.world.description import CameraSpec, TargetSpec, WorldDescription
from camnet.world.pybullet import PyBulletWorld
from camnet.world.settings import PhysicsSettings

__all__ = ["VIEWS_PER_S", "run"]

#: four cameras, thirty frames a second
VIEWS_PER_S = 120
#: views of one case, and of the slow one
_COUNT, _SLOW = 60, 8
_LENS = Intrinsics(width_px=640, height_px=368, fx_px=420.0, fy_px=420.0, cx_px=320.0, cy_px=184.0)
_EYE = np.array([0.8, 0.3, 2.5])


def run(seed: int = 0, progress: Callable[[float], None] | None = None) -> dict[str, Any]:
    """CPU time of one view, ms, and the cores that four cameras at 30 Hz take."""
    target = TargetSettings(name="robot", motion=VectorFieldTarget(kind="vector_field", field="wave"))
    features = np.array(target.features_m)
    camera = CameraModel(name="camera", intrinsics=_LENS)
    q_camera = rotations.look_at(_EYE, np.zeros(3))
    world = PyBulletWorld(
        WorldDescription(
            physics=PhysicsSettings(step_hz=60),
            control_hz=60.0,
            cameras=(CameraSpec("camera", camera, _EYE, q_camera),),
            targets=(
                TargetSpec(
                    "robot", target.size_m, features, build_motion(target, ()), marker_on(features, 0)
                ),
            ),
        )
    )
    rng = np.random.default_rng(seed)
    world.reset(rng)
    bent = camera.model_copy(
        update={"intrinsics": _LENS.model_copy(update={"distortion": (-0.2, 0.05, 0.0, 0.0)})}
    )
    moving = ImageSettings(exposure_s=0.005, readout_s=0.01)
    cases: tuple[tuple[str, FeatureReader | ImageReader, int], ...] = (
        ("features", FeatureReader(FeatureSettings(), [camera], [features]), _COUNT),
        ("image", ImageReader(ImageSettings(), [camera], [features]), _COUNT),
        ("image, exposure and rolling shutter", ImageReader(moving, [camera], [features]), _COUNT),
        ("image, distorted lens", ImageReader(ImageSettings(), [bent], [features]), _COUNT),
        (
            "image, pybullet's renderer",
            ImageReader(ImageSettings(renderer="pybullet"), [camera], [features], world.render),
            _SLOW,
        ),
    )
    rows = {}
    try:
        for number, (name, reader, count) in enumerate(cases):
            rows[name] = _time(reader, world, q_camera, rng, count)
            if progress is not None:
                progress((number + 1) / len(cases))
    finally:
        world.close()
    return {
        "width_px": _LENS.width_px,
        "height_px": _LENS.height_px,
        "views_per_s": VIEWS_PER_S,
        "cases": rows,
    }


def _time(
    reader: FeatureReader | ImageReader,
    world: PyBulletWorld,
    q_camera: Array,
    rng: np.random.Generator,
    count: int,
) -> dict[str, float]:
    spent, found = [], 0
    for k in range(count + 1):
        scene = _scene(k / 30.0, q_camera)
        world.set_state(scene)
        start = time.process_time()
        found += reader.read(scene, 0, 0, rng) is not None
        spent.append(time.process_time() - start)
    ms = 1e3 * float(np.median(spent[1:]))  # the first one compiles
    return {"view_ms": ms, "cores": ms * 1e-3 * VIEWS_PER_S, "found_share": found / (count + 1)}


def _scene(t_s: float, q_camera: Array) -> Snapshot:
    """Put the target on a circle below the camera, where it moves as it turns."""
    none, angle = np.zeros((0, 3)), 0.6 * t_s
    p = 0.4 * np.array([np.cos(angle), np.sin(angle), 0.0])
    v = 0.24 * np.array([-np.sin(angle), np.cos(angle), 0.0])
    q = rotations.from_yaw(angle + 0.5 * np.pi)
    still, spin = np.zeros((1, 3)), np.array([[0.0, 0.0, 0.6]])
    rest = (_EYE[None], q_camera[None], still, still, p[None], q[None], v[None], spin)
    return Snapshot(t_s, 0, none, np.zeros((0, 4)), none, none, *rest)
