"""State of many learning estimators as rows of arrays, and what they have in common.

One row is the estimator of one target in one environment: what `camnet.estimation.learning_estimator` keeps in objects.
`EstimatorSetup` is constant and shared by all rows. `EstimatorState` is three arrays with the row as first axis (few,
because every array that a compiled function takes is paid for at each call and when it is compiled):

| array | shape | what |
| --- | --- | --- |
| ``pose`` | (rows, POSE_COLUMNS) | instants, pose, prior, twist, exit and gap: columns T ... OFFSET |
| ``flags`` | (rows, ..) int64 | columns REGION ..., then of each model: counts, order, place |
| ``data`` | (rows, ..) | ``history``, ``samples``, ``sigma``, then the blocks of each model |

Parts of ``flags`` and ``data``, found with the functions of the same names (J models, one a region, or one for all with
``share``; p kernels; P is p rounded up to whole panels; C windows in a stack):

| part | shape | what |
| --- | --- | --- |
| history | (H, 8) | latest poses of the sighting: t, p, q |
| samples | (S, 8) | poses of the window that is being collected: t, p, q |
| sigma | (S, P) | their sigma over the active kernels |
| counts | (J, COUNT_COLUMNS) | columns ACTIVE ... below |
| order, place | (J, p) | active kernels, see below |
| model | (J, MODEL_COLUMNS) | error radius, outlier gate: columns MEAN_SQUARE ... below |
| weights, moment | (J, P, 8) | W_hat and Q over the active kernels |
| inverse | (J, P P) | (I + dt kCL gamma (Psi + delta I))^-1, rows ``counts[STRIDE]`` apart |
| rows, increments | (J, C, P), (J, C, 9) | the stack; behind each increment when it entered |
| books | (J, C + P P) | leverages and inverse of the D-optimal rule, used once a stack is full |

Weights and stack live over the *active* kernels of a model alone, in the order in which they were first reached by a
measured pose or a path across a gap: ``order[:n]`` are their numbers, ``place[kernel]`` is the way back (-1: not
active). Every other weight is exactly zero, and there the inverse of the implicit step is a multiple of the identity.
Memory that is not reached stays untouched, so most of what the arrays ask for is never taken from the machine.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from camnet.batch.compiled import inner, outer
from camnet.batch.estimator_field import Kernels, pack_kernels
from camnet.errors import ConfigError
from camnet.estimation.basis import RbfBasis
from camnet.estimation.concurrent_learning import LAYER_SHARE, SWITCHING
from camnet.estimation.gap import SUBSTEPS
from camnet.estimation.propagate import COLUMNS, PRIORS
from camnet.estimation.radius import REMEMBERED_GAPS
from camnet.estimation.road_prior import RoadMap, map_of
from camnet.estimation.settings import EstimatorSettings
from camnet.geometry.borrow import lend
from camnet.geometry.settings import Road
from camnet.types import Array, IntArray

__all__ = [
    "EstimatorSetup",
    "EstimatorState",
    "Rules",
    "allocate",
    "books_of",
    "build_setup",
    "counts_of",
    "increment_of",
    "inverse_of",
    "model_of",
    "moment_of",
    "order_of",
    "place_of",
    "reset",
    "reset_lent",
    "row_of",
    "sigma_of",
    "weights_of",
]

# --- columns of ``pose`` ---------------------------------------------------------------------------------------------
#: present instant and last measured one, s; weight steps owed, s
T, LAST_SEEN, OWED = 0, 1, 2
#: pose, prior mean (v world, w body), twist
P, Q, PRIOR, TWIST = 3, 6, 10, 16
#: how the target left (t, p, q, v, w: 14 columns), the same of the gap that waits to be learned, and when that ended
EXIT, GAP, GAP_ENTRY = 22, 36, 50
#: how far left of its way on the road it was when it left, m
OFFSET = 51
POSE_COLUMNS = 52
# --- columns of ``flags`` --------------------------------------------------------------------------------------------
#: region last seen in (-1: never seen), whether seen now, model in force
REGION, SEEN, MODEL = 0, 1, 2
#: samples of the window, poses of the history, whether a fit of the prior is due, whether the exit is known
FILLED, HELD, FIT_DUE, HAS_EXIT = 3, 4, 5, 6
#: model that the waiting gap is for (-1: none waits), gaps learned
GAP_MODEL, GAPS_LEARNED = 7, 8
#: windows a stack has room for, whether it can fill up, numbers in a model's block: fixed by ``allocate``
CAPACITY, FILLS, BLOCK = 9, 10, 11
FLAG_COLUMNS = 12
# --- columns of ``model`` --------------------------------------------------------------------------------------------
#: mean square residual while seen, m^2; error rates of the last gaps, m/s
MEAN_SQUARE, RATES = 0, 1
#: outlier gate: mean squares (position, turn), when the run of suspect windows and when the change began, s
GATE, RUN_BEGAN, CHANGED = RATES + REMEMBERED_GAPS, RATES + REMEMBERED_GAPS + 2, RATES + REMEMBERED_GAPS + 3
#: up to when the weights have been advanced, s; square of the weights' norm
ADVANCED, NORM2 = CHANGED + 1, CHANGED + 2
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
#: whether the inverse waits to be computed afresh
STALE = 15
COUNT_COLUMNS = 16

#: rows of the inverse grow by this many at a time; a multiple of a panel's rows
GROWTH = 8
_RULES = ("d_optimal",)
#: written out where it is called: without counting references a function cannot return an array
_INLINE: dict[str, Any] = {"inline": "always", "_nrt": False}
_part = njit(**_INLINE)


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


class EstimatorState(NamedTuple):
    """State of all rows; see the module's head."""

    pose: Array
    flags: IntArray
    data: Array


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
    bounds = np.array(tracking_bounds, dtype=float)
    if bounds.shape != (2, 3) or not (bounds[0] < bounds[1]).all():
        raise ConfigError(
            f"tracking_bounds: {bounds.tolist()}, expected (2, 3), the lower row below the upper"
        )
    if n_regions < 1 or not rate_hz > 0.0:
        raise ConfigError(f"n_regions {n_regions}, rate_hz {rate_hz}: both must be positive")
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
    padded = _whole(p)
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


def _whole(n: int) -> int:
    """Round up to whole vectors and panels."""
    return -(-n // GROWTH) * GROWTH


def _places(kernels: int, history: int, samples: int) -> Places:
    padded = _whole(kernels)
    sigma = 8 * (history + samples)
    weights = _whole(MODEL_COLUMNS)
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


def _stack_capacity(c: Rules, size: int, duration_s: float) -> int:
    """Windows that a stack of ``size`` can come to hold within ``duration_s``.

    A measured window takes as long as its intervals, one of a path across a gap at least half of ``window_s``.
    """
    if not duration_s > 0.0:
        raise ConfigError(f"duration_s {duration_s}: must be positive")
    shortest = min(c.intervals * c.dt_s, 0.5 * c.window_s)
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
    c = setup.rules
    capacity = _stack_capacity(c, settings.stack.size, duration_s)
    fills, padded = capacity == settings.stack.size, c.at.padded
    block = c.at.rows + _whole(capacity * (padded + COLUMNS + 1))
    if fills:
        block += _whole(padded * padded + capacity)
    state = EstimatorState(
        pose=np.zeros((rows, POSE_COLUMNS)),
        flags=np.zeros((rows, FLAG_COLUMNS + c.models * (COUNT_COLUMNS + 2 * c.size)), dtype=np.int64),
        data=np.zeros((rows, c.at.models + c.models * block)),
    )
    state.flags[:, CAPACITY], state.flags[:, FILLS], state.flags[:, BLOCK] = capacity, fills, block
    for row in range(rows):
        reset(setup, state, row)
    return state


@inner
def reset_lent(setup: EstimatorSetup, state: EstimatorState, row: int) -> None:
    """Make row ``row`` as new: nothing seen, nothing learned."""
    pose, flags = state.pose[row], state.flags[row]
    for i in range(POSE_COLUMNS):
        pose[i] = 0.0
    for i in range(CAPACITY):
        flags[i] = 0
    pose[T], pose[LAST_SEEN] = -math.inf, -math.inf
    pose[P], pose[P + 1], pose[P + 2] = math.nan, math.nan, math.nan
    pose[Q] = 1.0
    flags[REGION], flags[GAP_MODEL] = -1, -1
    for j in range(setup.rules.models):
        _reset_model(setup.rules, flags, state.data[row], j)


@outer
def reset(setup: EstimatorSetup, state: EstimatorState, row: int) -> None:
    """See ``reset_lent``."""
    reset_lent(lend(setup), lend(state), row)


@inner
def _reset_model(c: Rules, k: IntArray, d: Array, j: int) -> None:
    """Make model ``j`` of a row as new."""
    model, counts, places = model_of(c, k, d, j), counts_of(c, k, j), place_of(c, k, j)
    for i in range(MODEL_COLUMNS):
        model[i] = 0.0
    for i in range(COUNT_COLUMNS):
        counts[i] = 0
    for i in range(len(places)):
        places[i] = -1
    # radius: three standard deviations of 5 cm before anything was measured
    model[MEAN_SQUARE] = (0.05 / 3.0) ** 2
    model[GATE], model[GATE + 1] = math.inf, math.inf
    model[RUN_BEGAN], model[CHANGED] = math.inf, math.inf


# --- parts of a row: ``k`` is a row of ``flags``, ``d`` one of ``data``, ``j`` a model -------------------------------


@_part
def counts_of(c: Rules, k: IntArray, j: int) -> IntArray:
    """Return the counts (COUNT_COLUMNS,) of a model."""
    return k[FLAG_COLUMNS + j * (COUNT_COLUMNS + 2 * c.size) :]


@_part
def order_of(c: Rules, k: IntArray, j: int) -> IntArray:
    """Numbers of the active kernels."""
    return k[FLAG_COLUMNS + j * (COUNT_COLUMNS + 2 * c.size) + COUNT_COLUMNS :]


@_part
def place_of(c: Rules, k: IntArray, j: int) -> IntArray:
    """Places (p,) of the kernels among the active ones."""
    p = c.size
    first = FLAG_COLUMNS + j * (COUNT_COLUMNS + 2 * p) + COUNT_COLUMNS + p
    return k[first : first + p]


@_part
def model_of(c: Rules, k: IntArray, d: Array, j: int) -> Array:
    """Block of a model, its numbers (MODEL_COLUMNS,) first."""
    return d[c.at.models + j * k[BLOCK] :]


@_part
def weights_of(c: Rules, k: IntArray, d: Array, j: int) -> Array:
    """Weights, flat: 8 numbers an active kernel."""
    return d[c.at.models + j * k[BLOCK] + c.at.weights :]


@_part
def moment_of(c: Rules, k: IntArray, d: Array, j: int) -> Array:
    """Moment Q, flat: 8 numbers an active kernel."""
    return d[c.at.models + j * k[BLOCK] + c.at.moment :]


@_part
def inverse_of(c: Rules, k: IntArray, d: Array, j: int) -> Array:
    """Inverse of the implicit step, flat."""
    return d[c.at.models + j * k[BLOCK] + c.at.inverse :]


@_part
def row_of(c: Rules, k: IntArray, d: Array, j: int, index: int) -> Array:
    """Regressor of stack entry ``index`` over the active kernels."""
    return d[c.at.models + j * k[BLOCK] + c.at.rows + index * c.at.padded :]


@_part
def increment_of(c: Rules, k: IntArray, d: Array, j: int, index: int) -> Array:
    """Increment (8,) of stack entry ``index``, and in the ninth place when it entered, s."""
    first = c.at.models + j * k[BLOCK] + c.at.rows + k[CAPACITY] * c.at.padded
    return d[first + index * (COLUMNS + 1) :]


@_part
def books_of(c: Rules, k: IntArray, d: Array, j: int) -> Array:
    """Leverages (C,) and after them the inverse of the D-optimal rule."""
    first = c.at.models + j * k[BLOCK] + c.at.rows
    return d[first + -(-k[CAPACITY] * (c.at.padded + COLUMNS + 1) // GROWTH) * GROWTH :]


@_part
def sigma_of(c: Rules, d: Array, sample: int) -> Array:
    """Sigma over the active kernels of a sample of the window."""
    return d[c.at.sigma + sample * c.at.padded :]
