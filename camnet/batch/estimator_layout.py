"""State of many learning estimators as rows of arrays, and what they have in common.

One row is the estimator of one target in one environment: what `camnet.estimation.learning_estimator` keeps in objects.
``EstimatorSetup`` is constant and shared; ``EstimatorState`` has the row as first axis everywhere. Both are named
tuples of numbers and arrays, which compiled code takes as they are. ``J`` models (one a region, or one for all with
``share``), ``p`` kernels, ``C`` windows in a stack.

Weights and stack live over the *active* kernels of a model alone, in the order in which they were first reached by a
measured pose or a path across a gap: ``order[r, j, :n]`` are their numbers, ``place[r, j, k]`` is the way back (-1: not
active). Every other weight is exactly zero, and there the inverse of the implicit step is a multiple of the identity.
Memory that is not reached stays untouched, so most of what the arrays ask for is never taken from the machine.

| ``EstimatorState`` | shape | what |
| --- | --- | --- |
| ``pose`` | (rows, POSE_COLUMNS) | instants, pose, prior, twist, exit and gap: columns T ... GAP_ENTRY below |
| ``flags`` | (rows, FLAG_COLUMNS) int64 | columns REGION ... below |
| ``history`` | (rows, H, 8) | latest poses of the sighting: t, p, q |
| ``samples`` | (rows, S, 8) | poses of the window that is being collected: t, p, q |
| ``sigma`` | (rows, S, p) | their sigma over the active kernels |
| ``model`` | (rows, J, MODEL_COLUMNS) | error radius, outlier gate, ...: columns MEAN_SQUARE ... below |
| ``counts`` | (rows, J, COUNT_COLUMNS) int64 | columns ACTIVE ... below |
| ``order``, ``place`` | (rows, J, p) int64 | active kernels, see above |
| ``weights``, ``moment`` | (rows, J, P, 8) | W_hat and Q over the active kernels, P = p rounded up to a whole panel |
| ``inverse`` | (rows, J, P P) | (I + dt kCL gamma (Psi + delta I))^-1, rows ``counts[..., STRIDE]`` apart |
| ``rows``, ``increments``, ``entered`` | (rows, J, C, p), (.., C, 8), (.., C) | the stack |
| ``selection``, ``leverage`` | (rows, J, P P), (rows, J, C) | books of the D-optimal rule, used once a stack is full |
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from camnet.batch.estimator_field import Kernels, pack_kernels
from camnet.errors import ConfigError
from camnet.estimation.basis import RbfBasis
from camnet.estimation.concurrent_learning import LAYER_SHARE, SWITCHING
from camnet.estimation.propagate import COLUMNS, PRIORS
from camnet.estimation.radius import REMEMBERED_GAPS
from camnet.estimation.settings import EstimatorSettings
from camnet.types import Array, IntArray

__all__ = ["EstimatorSetup", "EstimatorState", "allocate", "build_setup", "reset"]

# --- columns of ``pose`` ---------------------------------------------------------------------------------------------
#: present instant and last measured one, s; weight steps owed, s
T, LAST_SEEN, OWED = 0, 1, 2
#: pose, prior mean (v world, w body), twist
P, Q, PRIOR, TWIST = 3, 6, 10, 16
#: how the target left (t, p, q, v, w: 14 columns), the same of the gap that waits to be learned, and when that ended
EXIT, GAP, GAP_ENTRY = 22, 36, 50
POSE_COLUMNS = 51
# --- columns of ``flags`` --------------------------------------------------------------------------------------------
#: region last seen in (-1: never seen), whether seen now, model in force
REGION, SEEN, MODEL = 0, 1, 2
#: samples of the window, poses of the history, whether a fit of the prior is due, whether the exit is known
FILLED, HELD, FIT_DUE, HAS_EXIT = 3, 4, 5, 6
#: model that the waiting gap is for (-1: none waits), gaps learned
GAP_MODEL, GAPS_LEARNED = 7, 8
FLAG_COLUMNS = 9
# --- columns of ``model`` --------------------------------------------------------------------------------------------
#: mean square residual while seen, m^2; error rates of the last gaps, m/s
MEAN_SQUARE, RATES = 0, 1
#: outlier gate: mean squares (position, turn), when the run of suspect windows and when the change began, s
GATE, RUN_BEGAN, CHANGED = RATES + REMEMBERED_GAPS, RATES + REMEMBERED_GAPS + 2, RATES + REMEMBERED_GAPS + 3
#: when the model was last in force, s; square of the weights' norm
LAST_IN_FORCE, NORM2 = CHANGED + 1, CHANGED + 2
MODEL_COLUMNS = NORM2 + 1
# --- columns of ``counts`` -------------------------------------------------------------------------------------------
#: active kernels, distance of two rows of ``inverse``, windows held, rank-one changes since the inverse was exact
ACTIVE, STRIDE, WINDOWS, CHANGES = 0, 1, 2, 3
#: gaps crossed, runs of far, suspect and agreeing windows
CROSSED, FAR_RUN, SUSPECT_RUN, AGREED = 4, 5, 6, 7
#: for the records: windows refused by the gate, changes noted, windows forgotten, windows refused by the stack
OUTLIERS, TURNS, FORGOTTEN, REFUSED = 8, 9, 10, 11
#: whether the books of the selection hold, and changes since they were exact
SELECTING, SELECTED = 12, 13
#: windows for which the arrays had no room: the row ran longer than ``allocate`` was told
OVERFLOWED = 14
COUNT_COLUMNS = 15

#: rows of the inverse grow by this many at a time; a multiple of a panel's rows
GROWTH = 8
_RULES = ("d_optimal",)


class EstimatorSetup(NamedTuple):
    """Settings and kernels that all rows share; names as in `EstimatorSettings`."""

    kernels: Kernels
    dt_s: float
    models: int
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
    low: Array
    high: Array


class EstimatorState(NamedTuple):
    """State of all rows; see the module's head."""

    pose: Array
    flags: IntArray
    history: Array
    samples: Array
    sigma: Array
    model: Array
    counts: IntArray
    order: IntArray
    place: IntArray
    weights: Array
    moment: Array
    inverse: Array
    rows: Array
    increments: Array
    entered: Array
    selection: Array
    leverage: Array


def _refuse(settings: EstimatorSettings) -> None:
    """Settings that the compiled rows do not have."""
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
    settings: EstimatorSettings, basis: RbfBasis, n_regions: int, rate_hz: float, tracking_bounds: Array
) -> EstimatorSetup:
    """Pack what all rows share; parameters as for `LearningEstimator`.

    Raises
    ------
    ConfigError
        If a setting is one that the compiled rows do not have, or the numbers make no sense.
    """
    _refuse(settings)
    bounds = np.array(tracking_bounds, dtype=float)
    if bounds.shape != (2, 3) or not (bounds[0] < bounds[1]).all():
        raise ConfigError(
            f"tracking_bounds: {bounds.tolist()}, expected (2, 3), the lower row below the upper"
        )
    if n_regions < 1 or not rate_hz > 0.0:
        raise ConfigError(f"n_regions {n_regions}, rate_hz {rate_hz}: both must be positive")
    gap, stack, dt = settings.gap, settings.stack, 1.0 / rate_hz
    intervals = max(1, round(stack.window_s / dt))
    return EstimatorSetup(
        kernels=pack_kernels(basis),
        dt_s=dt,
        models=1 if settings.share else n_regions,
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
        low=bounds[0].copy(),
        high=bounds[1].copy(),
    )


def stack_capacity(setup: EstimatorSetup, size: int, duration_s: float) -> int:
    """Windows that a stack of ``size`` can come to hold within ``duration_s``.

    A measured window takes as long as its intervals, one of a path across a gap at least half of ``window_s``.
    """
    if not duration_s > 0.0:
        raise ConfigError(f"duration_s {duration_s}: must be positive")
    shortest = min(setup.intervals * setup.dt_s, 0.5 * setup.window_s)
    possible = duration_s / shortest + 2.0
    return size if possible >= size else math.ceil(possible)


def allocate(
    setup: EstimatorSetup, settings: EstimatorSettings, rows: int, duration_s: float = math.inf
) -> EstimatorState:
    """State of ``rows`` estimators, each as new.

    Parameters
    ----------
    setup : from `build_setup`
    settings : the same settings
    rows : number of estimators
    duration_s : longest time between two resets, s; stacks that cannot fill up in it take less memory

    Raises
    ------
    ConfigError
        If ``rows`` or ``duration_s`` is not positive.
    """
    if rows < 1:
        raise ConfigError(f"rows {rows}: must be positive")
    p, j = len(setup.kernels.centres), setup.models
    capacity = stack_capacity(setup, settings.stack.size, duration_s)
    fills = capacity == settings.stack.size
    padded = -(-p // GROWTH) * GROWTH
    samples = setup.intervals + setup.average
    state = EstimatorState(
        pose=np.zeros((rows, POSE_COLUMNS)),
        flags=np.zeros((rows, FLAG_COLUMNS), dtype=np.int64),
        history=np.zeros((rows, setup.regression_samples, 8)),
        samples=np.zeros((rows, samples, 8)),
        sigma=np.zeros((rows, samples, p)),
        model=np.zeros((rows, j, MODEL_COLUMNS)),
        counts=np.zeros((rows, j, COUNT_COLUMNS), dtype=np.int64),
        order=np.zeros((rows, j, p), dtype=np.int64),
        place=np.zeros((rows, j, p), dtype=np.int64),
        weights=np.zeros((rows, j, padded, COLUMNS)),
        moment=np.zeros((rows, j, padded, COLUMNS)),
        inverse=np.zeros((rows, j, padded * padded)),
        rows=np.zeros((rows, j, capacity, p)),
        increments=np.zeros((rows, j, capacity, COLUMNS)),
        entered=np.zeros((rows, j, capacity)),
        selection=np.zeros((rows, j, padded * padded if fills else 1)),
        leverage=np.zeros((rows, j, capacity if fills else 1)),
    )
    for row in range(rows):
        reset(setup, state, row)
    return state


@njit(cache=True, nogil=True)
def reset(setup: EstimatorSetup, state: EstimatorState, row: int) -> None:
    """Make row ``row`` as new: nothing seen, nothing learned."""
    pose, flags = state.pose[row], state.flags[row]
    pose[:] = 0.0
    flags[:] = 0
    pose[T], pose[LAST_SEEN] = -math.inf, -math.inf
    pose[P : P + 3] = math.nan
    pose[Q] = 1.0
    flags[REGION], flags[GAP_MODEL] = -1, -1
    for j in range(setup.models):
        reset_model(state, row, j)


@njit(cache=True, nogil=True)
def reset_model(state: EstimatorState, row: int, j: int) -> None:
    """Make model ``j`` of a row as new."""
    model = state.model[row, j]
    model[:] = 0.0
    state.counts[row, j, :] = 0
    state.place[row, j, :] = -1
    # radius: three standard deviations of 5 cm before anything was measured
    model[MEAN_SQUARE] = (0.05 / 3.0) ** 2
    model[GATE], model[GATE + 1] = math.inf, math.inf
    model[RUN_BEGAN], model[CHANGED] = math.inf, math.inf
