"""Where a held model comes from: a warm-up, a file, or weights; and its tables.

The warm-up needs no flight: targets move by their law, and each is measured, with the world's noise, at every sensing
instant at which it is in some camera's region. `camnet.estimation.learning_estimator` learns from that, gaps included.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from camnet.batch.frozen import Frozen
from camnet.batch.lane_layout import on_cache_lines
from camnet.errors import ConfigError
from camnet.estimation.basis import CUTOFF, RbfBasis
from camnet.estimation.concurrent_learning import SWITCHING
from camnet.estimation.learning_estimator import LearningEstimator
from camnet.estimation.persistence import load_models
from camnet.estimation.propagate import PRIORS, UNIT
from camnet.estimation.radius import REMEMBERED_GAPS
from camnet.estimation.road_prior import map_of
from camnet.simulation.network import Network
from camnet.types import Array, CameraMotion, IntArray, PoseMeasurement

__all__ = ["FrozenModel", "frozen_state", "load_frozen", "tabulate", "warm_up"]

#: spacing of the tables over the kernels' width, and the most places that a table may have
_FINENESS, _MOST_PLACES = 10.0, 400_000
#: instants of a roll-out that are integrated over at once, at most; longest step where it is a single one, s
_MOST_AT_ONCE, _LONGEST_STEP_S = 4, 0.2
#: error radius while seen before anything was measured, as a mean square, m^2
_START_SQUARE = (0.05 / 3.0) ** 2


@dataclass(frozen=True, eq=False)
class FrozenModel:
    """What was learned, as plain arrays; K models over p kernels.

    Attributes
    ----------
    basis : the kernels
    weights : (K, p, 8) as in `camnet.estimation.propagate`
    model_of : (M, R) model of each target in each region
    square : (K,) mean square residual while seen, m^2
    rates : (K, 9) error rates of the latest gaps, m/s, and their count
    """

    basis: RbfBasis
    weights: Array
    model_of: IntArray
    square: Array
    rates: Array


def _model_of(network: Network, models: int) -> IntArray:
    """Models in the order of targets, then regions."""
    targets, regions = network.n_targets, len(network.regions)
    each = 1 if network.scenario.estimator.share else regions
    if models == targets * each:
        first = np.arange(targets)[:, None] * each
    elif models == each:
        first = np.zeros((targets, 1), dtype=int)
    else:
        raise ConfigError(
            f"{models} learned models for {targets} targets and {regions} regions: {each} (for all targets) or "
            f"{targets * each} were expected"
        )
    return np.asarray(
        first + (0 if each == 1 else np.arange(regions)) + np.zeros((1, regions), int), dtype=np.int64
    )


def load_frozen(network: Network, path: Path | str) -> FrozenModel:
    """Models from a file of `camnet.estimation.persistence`: one a region, or one a target and region.

    Raises
    ------
    DataError, ConfigError
        The file is no such file, or its models are not as many as the network needs or over other kernels.
    """
    models = load_models(path)
    if models[0].form != "twist":
        raise ConfigError(f"{path}: models of form {models[0].form!r}; the batch back end has 'twist' only")
    weights = np.stack([m.weights for m in models])
    k = len(models)
    square, rates = np.full(k, _START_SQUARE), np.zeros((k, REMEMBERED_GAPS + 1))
    return FrozenModel(models[0].basis, weights, _model_of(network, k), square, rates)


def warm_up(network: Network, duration_s: float = 200.0, seed: int = 0) -> FrozenModel:
    """Learn for ``duration_s`` of each target's time as if every region were watched; see the module's text."""
    s, rng = network.scenario, np.random.default_rng(seed)
    learned = [_learn(network, m, duration_s, rng) for m in range(network.n_targets)]
    regions = len(network.regions)
    each = 1 if s.estimator.share else regions
    memories = [f._memories[j] for f in learned for j in range(each)]
    rates = np.zeros((len(memories), REMEMBERED_GAPS + 1))
    for k, memory in enumerate(memories):
        known = list(memory.radius._rates)
        rates[k, : len(known)], rates[k, -1] = known, len(known)
    return FrozenModel(
        network.basis,
        np.stack([m.model.weights.copy() for m in memories]),
        _model_of(network, len(memories)),
        np.array([m.radius._mean_square for m in memories]),
        rates,
    )


def _learn(network: Network, m: int, duration_s: float, rng: np.random.Generator) -> LearningEstimator:
    s, motion = network.scenario, network.description.targets[m].motion
    filter_ = LearningEstimator(
        s.estimator, network.basis, len(network.regions), s.sensing.rate_hz, network.bounds, roads=s.roads
    )
    dt, still = 1.0 / s.sensing.rate_hz, np.zeros(3)
    at_origin = CameraMotion(still, np.array([1.0, 0.0, 0.0, 0.0]), still, still)
    state = motion.reset(rng)
    for k in range(round(duration_s * s.sensing.rate_hz)):
        inside = np.flatnonzero(network.containment(state.p_world[None])[0])
        if inside.size:
            p = state.p_world + rng.normal(scale=s.sensing.position_noise_m, size=3)
            measured = PoseMeasurement(k * dt, int(inside[0]), m, p, state.q_world.copy(), at_origin)
            filter_.correct(measured, int(inside[0]))
        else:
            filter_.predict(k * dt)
        state = motion.step(state, k * dt, dt, rng)
    return filter_


def _width(basis: RbfBasis) -> float:
    """Return the standard deviation of a kernel in its narrowest direction, m."""
    return 1.0 / math.sqrt(float(np.linalg.eigvalsh(basis.precision).max()))


def tabulate(model: FrozenModel, bounds: Array) -> tuple[Array, Array]:
    """Table (K, rows, columns, 8) of twist and support over the ground, and its grid (3,): corner and 1 / spacing.

    A place has eight numbers, the last one unused, so that it lies in one cache line.

    Raises
    ------
    ConfigError
        The kernels look at the heading as well, which a table over places cannot.
    """
    basis = model.basis
    if basis.centres.shape[1] != 2:
        raise ConfigError(
            f"estimator.basis.inputs with {basis.centres.shape[1]} coordinates: a held model is tabulated over "
            "places; use inputs 'position'"
        )
    low, high = bounds[0, :2] - 1.0, bounds[1, :2] + 1.0
    width = _width(basis)
    spacing = max(width / _FINENESS, math.sqrt(float(np.prod(high - low)) / _MOST_PLACES))
    if spacing > 0.5 * width:
        raise ConfigError(
            f"kernels {width:.2g} m wide over {np.prod(high - low):.3g} m^2: too many places for a table of the "
            f"learned motion; widen estimator.basis.width_m to {2.0 * spacing:.2g} or use the learning estimator"
        )
    columns, rows = np.ceil((high - low) / spacing).astype(int) + 1
    x, y = low[0] + spacing * np.arange(columns), low[1] + spacing * np.arange(rows)
    outputs = np.r_[0:6, UNIT]
    weights = model.weights[:, :, outputs].transpose(1, 0, 2).reshape(basis.size, -1)  # (p, K 7)
    table = np.zeros((rows, columns, len(model.weights), 8))
    for i, place_y in enumerate(y):
        e = np.stack(np.broadcast_arrays(x, place_y), axis=-1)[:, None] - basis.centres
        quad = np.einsum("ckd,kdf,ckf->ck", e, basis.precision, e)
        sigma = np.where(quad < CUTOFF, np.exp(-0.5 * quad), 0.0)
        table[i, :, :, :7] = (sigma @ weights).reshape(columns, -1, 7)
    return on_cache_lines(table.transpose(2, 0, 1, 3)), np.array([*low, 1.0 / spacing])


def _period(network: Network) -> tuple[float, float, float, float]:
    """Return the sensing period, s, and what `camnet.batch.frozen` makes of it: of half a period the first."""
    s, dt = network.scenario.estimator, 1.0 / network.scenario.sensing.rate_hz
    fade, handover = math.exp(-0.5 * dt / s.gap.turn_memory_s), -math.expm1(-dt / s.gap.handover_s)
    return dt, fade, handover, -math.expm1(-s.k1_per_s * dt)


def _strides(network: Network, basis: RbfBasis) -> tuple[int, int]:
    """Return how many instants of a roll-out are integrated over at once, and in how many steps.

    In a step of several instants a target at its top speed comes no farther than a kernel is wide. Off the roads, where
    nothing leads a path back, steps are shorter.
    """
    s = network.scenario
    dt, most = s.handoff.rollout_dt_s, _MOST_AT_ONCE if s.estimator.gap.prior == "road" and s.roads else 2
    reach = _width(basis) / (dt * max(t.v_max_mps for t in s.targets))
    return min(max(math.floor(reach), 1), most), max(1, math.ceil(dt / _LONGEST_STEP_S - 1e-9))


def frozen_state(
    network: Network, model: FrozenModel, table: Array, grid: Array, environments: int
) -> Frozen:
    """Room for the estimators of E environments.

    Raises
    ------
    ConfigError
        A setting of the estimator has no held form.
    """
    s = network.scenario.estimator
    for name, value, known in (
        ("form", s.form, "twist"),
        ("frame", s.frame, "world"),
        ("gap.pace", s.gap.pace, False),
    ):
        if value != known:
            raise ConfigError(f"estimator.{name} = {value!r}: a held model has {known!r} only")
    e, m = environments, network.n_targets
    each = 1 if s.share else len(network.regions)
    return Frozen(
        table=table,
        model_of=model.model_of,
        grid=grid,
        low=network.bounds[0].copy(),
        high=network.bounds[1].copy(),
        k1=s.k1_per_s,
        k2=s.k2,
        switching=SWITCHING[s.switching],
        layer=s.boundary_layer,
        prior=PRIORS[s.gap.prior],
        turn_memory_s=s.gap.turn_memory_s,
        handover_s=s.gap.handover_s,
        period=_period(network),
        strides=_strides(network, model.basis),
        samples=s.regression_samples,
        reset_on_sighting=s.reset_on_sighting,
        roads=map_of(s.gap.prior, network.scenario.roads),
        pose=np.zeros((e, m, 15)),
        history=np.zeros((e, m, 2 * s.regression_samples, 8)),
        fitted=np.zeros((e, m, 13)),
        held=np.zeros((e, m, 3), dtype=np.int64),
        square=np.zeros((e, m, each)),
        rates=np.zeros((e, m, each, REMEMBERED_GAPS + 1)),
    )


def reset_frozen(frozen: Frozen, model: FrozenModel, e: int) -> None:
    """Forget everything about environment ``e`` but the model."""
    frozen.pose[e], frozen.history[e], frozen.held[e] = 0.0, 0.0, 0
    frozen.pose[e, :, 4] = 1.0
    each = frozen.square.shape[2]
    models = model.model_of[:, :1] + np.arange(each)  # (M, J)
    frozen.square[e], frozen.rates[e] = model.square[models], model.rates[models]
