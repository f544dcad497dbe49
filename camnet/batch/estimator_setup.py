"""What the rows of all learning estimators share: settings, kernels, roads, and room to work in.

Where the parts of a row begin (`Places`) follows from the number of kernels; `camnet.batch.estimator_layout` tells
what they are.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from camnet.batch.estimator_columns import GROWTH, MODEL_COLUMNS, POSE_COLUMNS
from camnet.batch.estimator_field import Kernels, pack_kernels
from camnet.errors import ConfigError
from camnet.estimation.basis import RbfBasis
from camnet.estimation.concurrent_learning import LAYER_SHARE, SWITCHING
from camnet.estimation.gap import SUBSTEPS
from camnet.estimation.propagate import COLUMNS, PRIORS
from camnet.estimation.road_prior import RoadMap, map_of
from camnet.estimation.settings import EstimatorSettings, checked_bounds
from camnet.geometry.settings import Road
from camnet.types import Array, IntArray

__all__ = ["EstimatorSetup", "Places", "Rules", "Work", "build_setup", "whole"]

_RULES = ("d_optimal",)


class Places(NamedTuple):
    """Where the parts of a row of ``data`` begin; those of a model counted from the beginning of its block.

    ``padded`` is P.
    """

    samples: int
    sigma: int
    models: int
    weights: int
    moment: int
    inverse: int
    rows: int
    padded: int


class Work(NamedTuple):
    """Room for what is computed on the way, so that nothing is made in the loops; sizes with W windows across a gap.

    Nothing in it outlives a call, and no two calls may use it at once: a setup belongs to one thread.
    """

    #: numbers and values of the kernels in reach of a place (p + 2 columns of their grid), (p,), and their factors
    places: IntArray
    sigma: Array
    factors: Array
    #: weights on the kernels' grid
    dense: Array
    #: (8,) each: W^T sigma, G^T eta_til, misfit of a window, the window's first and last pose
    field: Array
    error: Array
    residual: Array
    first: Array
    last: Array
    #: right side of a weight step and the weights before it (8 p,); an inverse (P P,)
    right: Array
    before: Array
    inverse: Array
    #: rows over the active kernels (p,)
    u: Array
    y: Array
    old: Array
    present: Array
    left: Array
    #: windows to be offered (W, p), (W, 8), (W,), and the path across a gap (6 W + 1, 7)
    rows: Array
    increments: Array
    shares: Array
    path: Array
    #: regressor of the last measured window that was offered (p,)
    offered: Array
    #: a measured position and orientation, a fit (14,), a row of ``pose``, weights of a window's samples
    position: Array
    orientation: Array
    fit: Array
    pose: Array
    samples: Array


class Rules(NamedTuple):
    """Settings that all rows share, names as in `EstimatorSettings`; ``size`` is the number of kernels."""

    size: int
    at: Places
    models: int
    dt_s: float
    k1_per_s: float
    k2: float
    kcl: float
    gamma: float
    leakage: float
    switching: int
    boundary_layer: float
    weight_bound: float
    weight_layer: float
    prior: int
    turn_memory_s: float
    handover_s: float
    learn_across: bool
    entry_s: float
    max_gap_s: float
    accel_psd_m2ps3: float
    path_std_mps: float
    window_s: float
    intervals: int
    average: int
    outlier_gate: float
    forgetting: bool
    regularisation: float
    regression_samples: int
    reset_on_sighting: bool
    low: tuple[float, float, float]
    high: tuple[float, float, float]
    work: Work


class EstimatorSetup(NamedTuple):
    """What all rows share, and the room that they work in: one thread's at a time."""

    kernels: Kernels
    rules: Rules
    roads: RoadMap


def _refuse(settings: EstimatorSettings) -> None:
    """Raise ConfigError for settings that the compiled rows do not have."""
    wanted = (
        ("form", settings.form, ("twist",)),
        ("frame", settings.frame, ("world",)),
        ("alpha", settings.alpha, (1.0,)),
        ("stack.rule", settings.stack.rule, _RULES),
        ("gap.pace", settings.gap.pace, (False,)),
    )
    for name, value, known in wanted:
        if value not in known:
            right = " or ".join(repr(k) for k in known)
            raise ConfigError(f"estimator.{name} {value!r}: the batch back end has {right} only")


def build_setup(
    settings: EstimatorSettings,
    basis: RbfBasis,
    n_regions: int,
    rate_hz: float,
    tracking_bounds: Array,
    roads: Sequence[Road] = (),
) -> EstimatorSetup:
    """Pack what all rows share; parameters as for `LearningEstimator`.

    Raises
    ------
    ConfigError
        If a setting is one that the compiled rows do not have, or the numbers make no sense.
    """
    _refuse(settings)
    bounds = checked_bounds(tracking_bounds, n_regions, rate_hz)
    gap, stack, dt = settings.gap, settings.stack, 1.0 / rate_hz
    intervals = max(1, round(stack.window_s / dt))
    kernels, samples = pack_kernels(basis), intervals + min(stack.average, intervals)
    rules = Rules(
        size=basis.size,
        at=_places(basis.size, settings.regression_samples, samples),
        models=1 if settings.share else n_regions,
        dt_s=dt,
        k1_per_s=settings.k1_per_s,
        k2=settings.k2,
        kcl=settings.kcl,
        gamma=settings.gamma,
        leakage=settings.leakage,
        switching=SWITCHING[settings.switching],
        boundary_layer=settings.boundary_layer,
        weight_bound=settings.weight_bound,
        weight_layer=LAYER_SHARE * settings.weight_bound,
        prior=PRIORS[gap.prior],
        turn_memory_s=gap.turn_memory_s,
        handover_s=gap.handover_s,
        learn_across=gap.learn_across,
        entry_s=gap.entry_s,
        max_gap_s=gap.max_gap_s,
        accel_psd_m2ps3=gap.accel_psd_m2ps3,
        path_std_mps=gap.path_std_mps,
        window_s=stack.window_s,
        intervals=intervals,
        average=min(stack.average, intervals),
        outlier_gate=stack.outlier_gate,
        forgetting=stack.forgetting,
        regularisation=stack.regularisation,
        regression_samples=settings.regression_samples,
        reset_on_sighting=settings.reset_on_sighting,
        low=(float(bounds[0, 0]), float(bounds[0, 1]), float(bounds[0, 2])),
        high=(float(bounds[1, 0]), float(bounds[1, 1]), float(bounds[1, 2])),
        work=_room(kernels, samples, 1 + math.ceil(gap.max_gap_s / stack.window_s)),
    )
    return EstimatorSetup(kernels, rules, map_of(gap.prior, roads))


def _room(kernels: Kernels, samples: int, windows: int) -> Work:
    p, grid = len(kernels.centres), kernels.number.shape
    padded = whole(p)
    eight = {name: np.zeros(COLUMNS) for name in ("field", "error", "residual", "first", "last")}
    rows = {name: np.zeros(p) for name in ("sigma", "u", "y", "old", "present", "left", "offered")}
    return Work(
        **eight,
        **rows,
        places=np.zeros(p + 2 * grid[0], dtype=np.int64),
        factors=np.zeros(4 * (2 * kernels.reach + 1)),
        dense=np.zeros(COLUMNS * grid[0] * grid[1]),
        right=np.zeros(COLUMNS * padded),
        before=np.zeros(COLUMNS * padded),
        inverse=np.zeros(padded * padded),
        rows=np.zeros((windows, p)),
        increments=np.zeros((windows, COLUMNS)),
        shares=np.zeros(windows),
        path=np.zeros((windows * SUBSTEPS + 1, 7)),
        position=np.zeros(3),
        orientation=np.zeros(4),
        fit=np.zeros(14),
        pose=np.zeros(POSE_COLUMNS),
        samples=np.zeros(samples),
    )


def whole(n: int) -> int:
    """Round up to whole vectors and panels."""
    return -(-n // GROWTH) * GROWTH


def _places(kernels: int, history: int, samples: int) -> Places:
    padded = whole(kernels)
    sigma = 8 * (history + samples)
    weights = whole(MODEL_COLUMNS)
    return Places(
        samples=8 * history,
        sigma=sigma,
        models=sigma + samples * padded,
        weights=weights,
        moment=weights + COLUMNS * padded,
        inverse=weights + 2 * COLUMNS * padded,
        rows=weights + 2 * COLUMNS * padded + padded * padded,
        padded=padded,
    )
