"""One run of the distance-observer experiment: every estimator on the same tracks and odometry, and the bound.

The measure is the paper's: at every image the sum over the 48 features of ``|z error|``; of that the root mean square
over the run, over the time before the last feature is learned by estimator 2 (``max tau_i``), and over the time from
then on.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Protocol

import numpy as np

from camnet.estimation.structure.bundle.covariance import depth_sd
from camnet.estimation.structure.bundle.preintegrate import preintegrate
from camnet.estimation.structure.bundle.problem import BundleState, Observations, build_problem
from camnet.estimation.structure.bundle.window import BundleSettings, SlidingBundle
from camnet.estimation.structure.compiled_observer import CompiledDistanceObserver
from camnet.estimation.structure.inverse_depth_filter import InverseDepthFilter
from camnet.estimation.structure.inverse_depth_observer import InverseDepthObserver
from camnet.estimation.structure.key_view import KeyFrameViews, KeyView
from camnet.estimation.structure.odometry import OdometryErrors
from camnet.estimation.structure.tracks import FeatureTracks, TrackedFrame
from camnet.experiments.distance_observers_scene import BoardScene, SetUp
from camnet.geometry.rotations import conjugate, multiply, to_matrix
from camnet.types import Array, BoolArray

__all__ = ["PARTS", "ROWS", "RunResult", "run_scene"]

ROWS = ("estimator_1", "estimator_2", "estimator_3", "ekf", "bundle", "bundle_depth_prior")
PARTS = ("whole", "before", "after")
#: instants at which the bound is evaluated, and images that one of its poses stands for
_BOUND_INSTANTS, _BOUND_STRIDE = 16, 3


class _Estimator(Protocol):
    def update(self, frame: TrackedFrame, view: KeyView) -> None: ...

    def depths(self, view: KeyView) -> Array: ...


class _Observer:
    """An observer that reads views."""

    def __init__(
        self, observer: CompiledDistanceObserver | InverseDepthObserver | InverseDepthFilter
    ) -> None:
        self.inner = observer

    def update(self, frame: TrackedFrame, view: KeyView) -> None:
        self.inner.update(view)

    def depths(self, view: KeyView) -> Array:
        return self.inner.depths(view)


class _Bundle:
    """The bundle adjustment, which reads frames."""

    def __init__(self, bundle: SlidingBundle) -> None:
        self.inner = bundle

    def update(self, frame: TrackedFrame, view: KeyView) -> None:
        self.inner.update(frame)

    def depths(self, view: KeyView) -> Array:
        return self.inner.depths()


@dataclass(frozen=True, eq=False, slots=True)
class RunResult:
    """One run.

    Attributes
    ----------
    t_s : (K,) times of the images, s
    error_m : by row (K,) sum over the features of the depth errors, m
    position_m : (K,) error of the camera's position by estimator 2, m
    learned : (K,) whether estimator 2 has learned every feature
    learned_share : (K,) share of the features that it has learned
    bound_m : by kind (K,) the bound of the sum, m
    path : (K, 2) the camera's way in the ground plane, m
    """

    t_s: Array
    error_m: Mapping[str, Array]
    position_m: Array
    learned: BoolArray
    learned_share: Array
    bound_m: Mapping[str, Array]
    path: Array

    def parts(self, values: Array) -> dict[str, float | None]:
        """Root mean square over the run, before and after learning; None of a part that is empty."""
        masks = {"whole": np.ones_like(self.learned), "before": ~self.learned, "after": self.learned}
        return {
            name: float(np.sqrt(np.mean(values[mask] ** 2))) if mask.any() else None
            for name, mask in masks.items()
        }


def run_scene(
    setup: SetUp, scene: BoardScene, tracks: FeatureTracks, progress: Callable[[float], None] | None = None
) -> RunResult:
    """Run every estimator on one scene.

    Parameters
    ----------
    setup : gains and weights
    scene : truth and odometry
    tracks : the features, numbered as the scene's points
    progress : told the share done
    """
    truth = scene.path.states(scene.t_s)
    turns = to_matrix(truth.q_world)
    views = KeyFrameViews(scene.camera, scene.odometry, setup.views)
    estimators: dict[str, _Estimator] = {}
    errors: dict[str, list[float]] = {name: [] for name in ROWS}
    position, share = [], []
    extended: CompiledDistanceObserver | None = None
    for k, frame in enumerate(tracks):
        view = views.view(frame)
        if extended is None:
            extended = CompiledDistanceObserver(len(view.ids), setup.observers, extended=True)
            estimators = _estimators(setup, scene, extended)
        z = ((scene.points_world[view.ids] - truth.p_world[k]) @ turns[k])[:, 2]
        for name, estimator in estimators.items():
            estimator.update(frame, view)
            errors[name].append(float(np.nansum(np.abs(estimator.depths(view) - z))))
        share.append(float(np.mean(extended.learned)))
        p_kc = (truth.p_world[0] - truth.p_world[k]) @ turns[k]
        position.append(float(np.linalg.norm(np.nan_to_num(view.u_kc) * extended.d_kc - p_kc)))
        if progress is not None:
            progress((k + 1) / len(scene.t_s))
    learned = np.maximum.accumulate(np.array(share) >= 1.0)
    bounds = {
        "start_prior": _bound(setup, scene, setup.bundle),
        "depth_prior": _bound(setup, scene, depth_prior(setup)),
    }
    return RunResult(
        scene.t_s,
        {name: np.array(values) for name, values in errors.items()},
        np.array(position),
        np.asarray(learned),
        np.array(share),
        bounds,
        truth.p_world[:, :2],
    )


def depth_prior(setup: SetUp) -> BundleSettings:
    """Bundle adjustment that is told about how far the board is: ``1/z`` about ``1/m`` with SD ``sd/m^2``."""
    mean, sd = setup.depth_prior_m
    return setup.bundle.model_copy(update={"start_m": mean, "start_inverse_sd": sd / mean**2})


def _estimators(setup: SetUp, scene: BoardScene, extended: CompiledDistanceObserver) -> dict[str, _Estimator]:
    count, s = len(extended.d_ic), setup.observers
    return {
        "estimator_1": _Observer(CompiledDistanceObserver(count, s, extended=False)),
        "estimator_2": _Observer(extended),
        "estimator_3": _Observer(InverseDepthObserver(count, s)),
        "ekf": _Observer(InverseDepthFilter(count, s)),
        "bundle": _Bundle(SlidingBundle(scene.camera, scene.odometry, setup.bundle)),
        "bundle_depth_prior": _Bundle(SlidingBundle(scene.camera, scene.odometry, depth_prior(setup))),
    }


def _bound(setup: SetUp, scene: BoardScene, prior: BundleSettings) -> Array:
    """Cramer-Rao-type figure at every image (K,), m: ``sqrt(2/pi) sum_i sigma_z,i``.

    All images up to an instant count, one pose for every third with the noise of three; odometry errors and depths
    have the estimators' priors, and no depth is worse than its prior or uniform over the range of distances. Errors
    that are one common scale reach the figure exactly in the mean of their absolute value, others exceed it.
    """
    low, high = prior.distance_m
    count, last = len(scene.points_world), len(scene.t_s) - 1
    depth = float(np.mean(np.linalg.norm(scene.points_world - scene.path.states(0.0).p_world, axis=1)))
    worst = min((high - low) / np.sqrt(12.0), prior.start_inverse_sd * depth**2)
    instants = np.unique(np.geomspace(2 * _BOUND_STRIDE, last, _BOUND_INSTANTS).astype(int))
    total = [np.sum(np.minimum(_bound_sd(setup, scene, prior, int(k)), worst)) for k in instants]
    values = np.interp(np.arange(last + 1), [0.0, *instants], [worst * count, *total])
    return np.asarray(np.sqrt(2.0 / np.pi) * values)


def _bound_sd(setup: SetUp, scene: BoardScene, prior: BundleSettings, last: int) -> Array:
    """``sigma_z`` (48,) in m at image ``last``, of the linearised problem at the truth."""
    images = np.arange(last, -1, -_BOUND_STRIDE)[::-1]
    truth = scene.path.states(scene.t_s[images])
    r = to_matrix(truth.q_world)
    p = (scene.points_world[None] - truth.p_world[:, None]) @ r
    poses, count = p.shape[:2]
    sd = max(setup.noise_px, 1e-3) / float(np.mean(scene.camera.focal)) / np.sqrt(_BOUND_STRIDE)
    seen = Observations(
        np.repeat(np.arange(poses), count),
        np.tile(np.arange(count), poses),
        (p[..., :2] / p[..., 2:]).reshape(-1, 2),
        np.full(poses * count, sd),
    )
    o = setup.odometry
    noise = OdometryErrors(
        slip=o.slip_sd,
        slip_time_s=o.slip_time_s,
        speed_noise_mps=o.speed_noise_mps,
        gyro_noise_radps=o.gyro_noise_radps,
    )
    steps = [preintegrate(scene.odometry, a, b, noise) for a, b in pairwise(truth.t_s.tolist())]
    inverse = np.column_stack([1.0 / p[0, :, 2], np.full(count, prior.start_inverse_sd * np.sqrt(count))])
    problem = build_problem(
        seen, np.zeros(count, dtype=np.int64), list(steps), o.scale_sd, o.gyro_bias_sd_radps, inverse
    )
    state = BundleState(
        (truth.p_world - truth.p_world[0]) @ r[0],
        multiply(conjugate(truth.q_world[0]), truth.q_world),
        np.column_stack([p[0, :, :2] / p[0, :, 2:], 1.0 / p[0, :, 2]]),
        np.zeros(4),
    )
    return depth_sd(problem, state)
