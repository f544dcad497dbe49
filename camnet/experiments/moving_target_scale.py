"""Scale of the target: learned at rest, and for targets that never rest.

The second is measured by the target's mean distance over the run. Odometry has no scale error there: whatever it has
adds to every figure in full.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from camnet.errors import DataError
from camnet.estimation.structure.moving.known_points import track_poses
from camnet.estimation.structure.moving.never_at_rest import (
    ScaleEstimate,
    scale_by_height,
    scale_by_no_slip,
    scale_by_size,
    structure_up_to_scale,
)
from camnet.estimation.structure.moving.rest import learn_at_rest
from camnet.estimation.structure.odometry import OdometryErrors
from camnet.experiments.moving_target_run import TO_SCENE, learn_structure, scale_errors
from camnet.experiments.moving_target_scene import MovingScene, MovingSetUp, make_moving_scene
from camnet.geometry.rotations import conjugate, exp, multiply, rotate
from camnet.types import Array, IntArray

__all__ = ["NeverAtRest", "at_rest", "never_at_rest"]

#: images from which structure and background are learned, one a second
_LEARN_S, _EVERY_S = 30.0, 1.0
_KNOWN_SD_M, _LEVEL_SD_RAD = 0.01, np.radians(0.1)


def at_rest(setup: MovingSetUp, noise_px: float, scale_sd: float, seed: int) -> tuple[float, float]:
    """Relative scale error and shape error, m, of one target at rest; the odometry's scale has SD ``scale_sd``."""
    odometry = setup.odometry.model_copy(update={"scale_sd": scale_sd})
    one = setup.model_copy(update={"odometry": odometry, "duration_s": setup.rest_s})
    scene = make_moving_scene(one, noise_px, "same", np.random.default_rng(seed))
    return scale_errors(scene, learn_structure(one, scene))


@dataclass(frozen=True, slots=True)
class NeverAtRest:
    """Relative errors of the scale in one run; None where the scale is unobservable or no structure was found.

    ``no_slip``: by duration, s; ``size``, ``height``: from a distance between two features, or a feature's height,
    known to 1 cm.
    """

    no_slip: dict[float, float | None]
    size: float | None
    height: float | None


def never_at_rest(
    setup: MovingSetUp, noise_px: float, spans_s: tuple[float, ...], seed: int, still: bool = False
) -> NeverAtRest:
    """One target that moves from the start; with ``still`` the camera stands on a tripod at a known place."""
    odometry = setup.odometry.model_copy(update={"scale_sd": 0.0})
    one = setup.model_copy(update={"odometry": odometry, "duration_s": max(spans_s)})
    rng = np.random.default_rng(seed)
    scene = make_moving_scene(one, noise_px, "same", rng, rests=False, still=still)
    few = np.arange(0, round(_LEARN_S * one.frame_hz), round(_EVERY_S * one.frame_hz))
    try:
        structure = structure_up_to_scale(scene.xy_target[few], scene.noise)
    except DataError:
        return NeverAtRest(dict.fromkeys(spans_s), None, None)
    middle = structure.mean(axis=0)
    p_camera, back = _camera(one, scene, few, still)
    target = track_poses(scene.t_s, scene.xy_target, rotate(TO_SCENE, structure - middle), scene.noise)
    away, q = rotate(back, target.p), multiply(back, target.q)
    truth = scene.path.states(scene.t_s)
    place = scene.target.p_world + scene.target.r_world @ scene.arms.mean(axis=0)
    true = float(np.mean(np.linalg.norm(place - truth.p_world, axis=1)))
    unit = float(np.nanmean(np.linalg.norm(away, axis=1)))
    good = target.seen & np.isfinite(p_camera[:, 0])

    def error(found: ScaleEstimate | None) -> float | None:
        return None if found is None else found.scale * unit / true - 1.0

    no_slip = {}
    for span in spans_s:
        mine = scene.t_s < span
        whole = bool(good[mine].all())
        no_slip[span] = (
            error(scale_by_no_slip(scene.t_s[mine], p_camera[mine], away[mine], q[mine])) if whole else None
        )
    arms = scene.arms
    pair = _longest(arms)
    size = float(np.linalg.norm(arms[pair[0]] - arms[pair[1]])) + _KNOWN_SD_M * rng.standard_normal()
    tilt = exp(_LEVEL_SD_RAD * rng.standard_normal(3) * [1.0, 1.0, 0.0])
    low = int(np.argmin(arms[:, 2]))
    points = rotate(TO_SCENE, structure - middle)
    down = -rotate(tilt, away[good] + rotate(q[good], points[low]))[:, 2]
    height = float(arms[low, 2]) + _KNOWN_SD_M * rng.standard_normal()
    above = float(truth.p_world[0, 2])
    return NeverAtRest(
        no_slip,
        error(scale_by_size(structure, pair, size, _KNOWN_SD_M)),
        error(scale_by_height(down, above, height, _KNOWN_SD_M)),
    )


def _camera(setup: MovingSetUp, scene: MovingScene, few: IntArray, still: bool) -> tuple[Array, Array]:
    """Camera's positions (K, 3), m, and orientations (K, 4) in the scene: from the background, or held on a tripod."""
    if still:
        return np.zeros((len(scene.t_s), 3)), np.tile(TO_SCENE, (len(scene.t_s), 1))
    o = setup.odometry
    noise = OdometryErrors(speed_noise_mps=o.speed_noise_mps, gyro_noise_radps=o.gyro_noise_radps)
    found = learn_at_rest(scene.t_s[few], scene.xy_corners[few], scene.noise, scene.odometry, noise, 1e-3)
    camera = track_poses(scene.t_s, scene.xy_corners, rotate(TO_SCENE, found.points), scene.noise)
    back = conjugate(camera.q)
    return -rotate(back, camera.p), back


def _longest(arms: Array) -> tuple[int, int]:
    """Return the two features farthest from each other."""
    away = np.linalg.norm(arms[:, None] - arms, axis=2)
    i, j = np.unravel_index(int(np.argmax(away)), away.shape)
    return int(i), int(j)
