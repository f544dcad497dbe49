"""Does structure and motion keep up? A window of the bundle adjustment, and the distance observers at 30 Hz.

CPU time on one core, median of several runs, beside a plain way to the same result in the same run:

| case | ours | baseline |
| --- | --- | --- |
| bundle, 10 key poses, 50 features, to convergence | compiled, points eliminated | SciPy on the plain residuals |
| observers 1 and 2, 50 features, a frame | compiled | NumPy |
| view of a frame (directions, key frame's pose) | NumPy | - |
"""

from __future__ import annotations

import platform
import time
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from camnet.estimation.structure.bundle.plain import moved, residuals
from camnet.estimation.structure.bundle.preintegrate import preintegrate
from camnet.estimation.structure.bundle.problem import BundleProblem, BundleState, Observations, build_problem
from camnet.estimation.structure.bundle.solver import adjust
from camnet.estimation.structure.compiled_observer import CompiledDistanceObserver
from camnet.estimation.structure.distance_observer import DistanceObserver
from camnet.estimation.structure.key_view import KeyFrameViews, KeyView
from camnet.estimation.structure.tracks import SimulatedTracks
from camnet.experiments.distance_observers_scene import BoardScene, SetUp, make_scene
from camnet.geometry.rotations import IDENTITY, multiply, rotate, to_matrix

__all__ = ["run", "window_problem"]

_POSES, _FEATURES, _RUNS = 10, 50, 15
#: promised: ms of a window, ms of a frame
_WINDOW_MS, _FRAME_MS = 20.0, 1.0


def run(seed: int = 0, progress: Callable[[float], None] | None = None) -> dict[str, Any]:
    """Measure times in ms and ratios, and on which machine."""
    tell = progress or (lambda share: None)
    setup = SetUp()
    rng = np.random.default_rng(seed)
    scene = make_scene(setup, rng)
    bundle = _bundle(setup, scene, rng)
    tell(0.5)
    frames = _frames(setup, scene, rng)
    tell(1.0)
    cases = {"bundle_window": bundle, **frames}
    kept = bundle["ms"] <= _WINDOW_MS and frames["observers"]["ms"] <= _FRAME_MS
    return {"machine": _machine(), "cases": cases, "keeps_up": kept}


def _machine() -> str:
    """Processor, system, Python."""
    name = platform.processor() or platform.machine()
    described = Path("/proc/cpuinfo")
    if described.exists():
        named = [
            line.split(":", 1)[1].strip()
            for line in described.read_text().splitlines()
            if "model name" in line
        ]
        name = named[0] if named else name
    return f"{name}, {platform.system()}, Python {platform.python_version()}"


def _ms(work: Callable[[], object], runs: int) -> float:
    """Median CPU time of a call, ms; the first call, which compiles, is left out."""
    work()
    spent = []
    for _ in range(runs):
        start = time.process_time()
        work()
        spent.append(time.process_time() - start)
    return 1e3 * float(np.median(spent))


def window_problem(
    setup: SetUp, scene: BoardScene, rng: np.random.Generator, poses: int = _POSES, features: int = _FEATURES
) -> tuple[BundleProblem, BundleState]:
    """Make a window as the estimator meets it: poses by odometry, all depths at the mean of the truth."""
    t = np.linspace(setup.rest_s, float(scene.t_s[-1]), poses)
    truth = scene.path.states(t)
    r = to_matrix(truth.q_world)
    extra = scene.points_world[: features - len(scene.points_world)] + np.array([0.3, 0.0, 0.1])
    points = np.concatenate([scene.points_world, extra])[:features]
    p = (points[None] - truth.p_world[:, None]) @ r
    sd = setup.noise_px / float(np.mean(scene.camera.focal))
    xy = p[..., :2] / p[..., 2:] + sd * rng.standard_normal((poses, features, 2))
    seen = Observations(
        np.repeat(np.arange(poses), features),
        np.tile(np.arange(features), poses),
        xy.reshape(-1, 2),
        np.full(poses * features, sd),
    )
    steps = [preintegrate(scene.odometry, a, b, setup.bundle.noise) for a, b in pairwise(t.tolist())]
    o = setup.odometry
    problem = build_problem(
        seen, np.zeros(features, dtype=np.int64), list(steps), o.scale_sd, o.gyro_bias_sd_radps
    )
    at, turned = [np.zeros(3)], [np.array(IDENTITY)]
    for step in steps:
        at.append(at[-1] + rotate(turned[-1], step.shift))
        turned.append(multiply(turned[-1], step.turn))
    start = np.column_stack([xy[0], np.full(features, 1.0 / np.mean(p[0, :, 2]))])
    return problem, BundleState(np.array(at), np.array(turned), start, np.zeros(4))


def _bundle(setup: SetUp, scene: BoardScene, rng: np.random.Generator) -> dict[str, Any]:
    problem, start = window_problem(setup, scene, rng)
    _, cost, steps = adjust(problem, start)
    unknowns = 6 * (len(start.p) - 1) + 4 + 3 * len(start.points)

    def plain() -> float:
        found = least_squares(
            lambda x: residuals(problem, moved(start, x)), np.zeros(unknowns), x_scale="jac"
        )
        return float(found.cost)

    begin = time.process_time()
    plain_cost = plain()
    plain_ms = 1e3 * (time.process_time() - begin)
    ms = _ms(lambda: adjust(problem, start), _RUNS)
    return {
        "poses": _POSES,
        "features": _FEATURES,
        "ms": ms,
        "baseline_ms": plain_ms,
        "ratio": plain_ms / ms,
        "steps": steps,
        "cost": cost,
        "baseline_cost": plain_cost,
        "promised_ms": _WINDOW_MS,
    }


def _frames(setup: SetUp, scene: BoardScene, rng: np.random.Generator) -> dict[str, Any]:
    extra = scene.points_world[: _FEATURES - len(scene.points_world)] + np.array([0.3, 0.0, 0.1])
    points = np.concatenate([scene.points_world, extra])
    frames = list(SimulatedTracks(points, scene.path, scene.camera, scene.t_s, setup.noise_px, rng))
    views: list[KeyView] = []
    builder = KeyFrameViews(scene.camera, scene.odometry, setup.views)
    start = time.process_time()
    for frame in frames:
        views.append(builder.view(frame))
    view_ms = 1e3 * (time.process_time() - start) / len(frames)

    def both(kind: type[DistanceObserver] | type[CompiledDistanceObserver]) -> None:
        observers = [kind(len(views[0].ids), setup.observers, extended) for extended in (False, True)]
        for view in views:
            for observer in observers:
                observer.update(view)

    ms = _ms(lambda: both(CompiledDistanceObserver), 3) / len(views)
    plain_ms = _ms(lambda: both(DistanceObserver), 3) / len(views)
    return {
        "observers": {
            "features": len(views[0].ids),
            "ms": ms,
            "baseline_ms": plain_ms,
            "ratio": plain_ms / ms,
            "promised_ms": _FRAME_MS,
        },
        "view": {"features": len(views[0].ids), "ms": view_ms},
    }
