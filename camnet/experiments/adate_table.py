"""Table I of li2019: normalised error of AdaTE and its rivals on the six groups of `adate_groups`.

Published definition: at every step k the root mean square error of the whole trajectory so far (each state at
its latest,
smoothed estimate), averaged over k and divided by the root mean square error of the observations. The paper's own
program divides by the error of the drifting observer alone; the table follows it and reports the error over all four
observers, and that of the causal estimate, beside it.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from camnet.errors import ConfigError
from camnet.estimation.adate import AdaptiveTrajectoryEstimator, AdateSettings
from camnet.estimation.adate.settings import AdaptationSettings, TruncationSettings
from camnet.estimation.kalman import ExtendedKalmanFilter, UnscentedKalmanFilter, constant_acceleration
from camnet.estimation.pls import ConstantTurn, PowerLimitedSteering
from camnet.experiments.adate_groups import GROUPS, Group, draw
from camnet.storage.whole_file import write_json
from camnet.types import Array

__all__ = ["DEFINITION", "METHODS", "PUBLISHED", "Track", "follow", "run", "run_adate_table", "time_update"]

#: rows of the table, best published method first
METHODS = ("AdaTE-PLS", "EKF-CA", "UKF-CA", "EKF-PLS", "UKF-PLS", "MAP-CT")

#: mean normalised error as published (Table I); None where it diverged
PUBLISHED: dict[str, dict[str, float | None]] = {
    "AdaTE-PLS": dict(zip(GROUPS, (0.128, 0.056, 0.152, 0.045, 0.169, 0.086), strict=True)),
    "EKF-CA": dict(zip(GROUPS, (0.136, 0.107, 0.156, 0.110, 0.208, 0.113), strict=True)),
    "UKF-CA": dict(zip(GROUPS, (0.133, 0.106, 0.152, 0.110, 0.204, 0.113), strict=True)),
    "EKF-PLS": dict.fromkeys(GROUPS),
    "UKF-PLS": dict(zip(GROUPS, (0.142, 0.113, 0.230, 0.124, 0.201, 0.135), strict=True)),
    "MAP-CT": dict(zip(GROUPS, (0.164, 0.115, 0.179, 0.117, 0.257, 0.135), strict=True)),
}

DEFINITION = (
    "mean over the steps k of the RMSE of the smoothed trajectory up to k, divided by the RMSE of the observations "
    "of the first observer (the drifting one where there is drift); final: the same at the last step; pooled: divided "
    "by the RMSE over all four observers; causal: RMSE of the estimate made at each step, divided likewise"
)

_BASELINE_NOISE = np.diag([4.0] * 3 + [1.0] * 3 + [0.5] * 3) / 500.0
_LAG = 50
#: white acceleration of the start, before the heading is known, (m/s)^2/s
_REST_DENSITY = 3e-3
#: densities (D_A, D_T) of which the lower bound keeps the best
_BOUND_GRID = ((2e-4, 3e-6), (2e-4, 1e-5), (2e-3, 1e-5), (1e-2, 5e-5))


class _Estimator(Protocol):
    @property
    def trajectory(self) -> Array: ...

    @property
    def covariance(self) -> Array: ...

    def update(self, observations: ArrayLike, covariances: ArrayLike) -> Array: ...


@dataclass(frozen=True, eq=False)
class Track:
    """One method on one draw.

    Attributes
    ----------
    smoothed, causal : (n,3) trajectory at the end; estimate made at each step, m
    error_so_far : (n,) RMSE of the smoothed trajectory up to each step, m
    diverged : an estimate was not finite, a covariance not positive definite, or the error beyond ten times the
        observations'
    """

    smoothed: Array
    causal: Array
    error_so_far: Array
    diverged: bool


def densities(group: str) -> tuple[float, float]:
    """Spectral densities D_A and D_T handed to the steering models of a group (published settings)."""
    return (2e-4, 1e-4) if group.startswith("snake") else (1e-4, 5e-5)


def make(method: str, group: str) -> _Estimator:
    """Build a method of the table with the published settings of a group.

    Raises
    ------
    ConfigError : the method is not one of `METHODS`
    """
    power, steering = densities(group)
    model = PowerLimitedSteering(
        alpha=0.01, beta=0.4, power_density=power, steering_density=steering, rest_density=_REST_DENSITY
    )
    acceleration = constant_acceleration(1.0, noise=_BASELINE_NOISE)
    plain = AdateSettings(
        adaptation=AdaptationSettings(process="none", observation="none", learn_scale=False),
        truncation=TruncationSettings(keep=600, limit=600),
    )
    makers: dict[str, Callable[[], _Estimator]] = {
        "AdaTE-PLS": lambda: AdaptiveTrajectoryEstimator(model=model, dt_s=1.0),
        "EKF-CA": lambda: ExtendedKalmanFilter(acceleration, lag=_LAG),
        "UKF-CA": lambda: UnscentedKalmanFilter(acceleration, lag=_LAG, beta=0.1),
        "EKF-PLS": lambda: ExtendedKalmanFilter(model, lag=_LAG),
        "UKF-PLS": lambda: UnscentedKalmanFilter(model, lag=_LAG, beta=0.1),
        "MAP-CT": lambda: AdaptiveTrajectoryEstimator(
            model=ConstantTurn(steering_density=steering, velocity_density=power, rest_density=_REST_DENSITY),
            dt_s=1.0,
            settings=plain,
        ),
    }
    if method not in makers:
        raise ConfigError(f"method: {method!r} is not one of {', '.join(METHODS)}")
    return makers[method]()


def follow(estimator: _Estimator, group: Group, check_every: int = 10) -> Track:
    """Run an estimator over a draw; ``check_every`` steps its covariance is checked."""
    n = len(group.truth)
    causal, so_far = np.empty((n, 3)), np.empty(n)
    nothing = np.zeros((0, 3)), np.zeros((0, 3, 3))
    sound = True
    trajectory = np.empty((0, 10))
    for k in range(n):
        given = (group.observations[k], group.covariance) if group.seen[k] else nothing
        estimator.update(*given)
        trajectory = estimator.trajectory
        causal[k] = trajectory[-1, :3]
        so_far[k] = np.sqrt(np.mean(np.sum((trajectory[:, :3] - group.truth[: k + 1]) ** 2, axis=1)))
        if k % check_every == 0 or k == n - 1:
            sound = sound and bool(np.linalg.eigvalsh(estimator.covariance)[0] > 0.0)
    diverged = not (np.isfinite(so_far).all() and sound and so_far.max() < 10.0 * group.rmse(True))
    return Track(trajectory[:, :3].copy(), causal, so_far, diverged)


def _summary(tracks: Sequence[tuple[Track, Group]]) -> dict[str, float]:
    """Figures of one cell over the seeds."""
    alone = np.array([g.rmse(False) for _, g in tracks])
    pooled = np.array([g.rmse(True) for _, g in tracks])
    mean = np.array([t.error_so_far.mean() for t, _ in tracks])
    final = np.array([t.error_so_far[-1] for t, _ in tracks])
    causal = np.array([np.sqrt(np.mean(np.sum((t.causal - g.truth) ** 2, axis=1))) for t, g in tracks])
    return {
        "mean": float(np.mean(mean / alone)),
        "sd": float(np.std(mean / alone, ddof=1)) if len(tracks) > 1 else 0.0,
        "final": float(np.mean(final / alone)),
        "pooled": float(np.mean(mean / pooled)),
        "causal": float(np.mean(causal / alone)),
        "causal_pooled": float(np.mean(causal / pooled)),
        "mean_m": float(np.mean(mean)),
    }


def lower_bound(group: Group) -> Track:
    """Smoother with true statistics on a draw: true R, drifting observations left out, densities that fit the track.

    Of a small grid of densities the one with the least error against the truth is kept, which no estimator could do.
    """
    clean = Group(
        group.name,
        group.truth,
        group.observations,
        group.seen,
        np.tile(group.true_covariance, (4, 1, 1)),
        group.true_covariance,
        group.drifting,
    )
    plain = AdateSettings(
        adaptation=AdaptationSettings(process="none", observation="none", learn_scale=False)
    )
    best: Track | None = None
    for power, steering in _BOUND_GRID:
        model = PowerLimitedSteering(
            power_density=power, steering_density=steering, rest_density=_REST_DENSITY
        )
        track = follow(_Leaving(AdaptiveTrajectoryEstimator(model, settings=plain), clean), clean)
        if best is None or track.error_so_far.mean() < best.error_so_far.mean():
            best = track
    assert best is not None
    return best


class _Leaving:
    """Hands an estimator only the observations that do not drift."""

    def __init__(self, estimator: AdaptiveTrajectoryEstimator, group: Group) -> None:
        self._estimator, self._group, self._k = estimator, group, 0

    @property
    def trajectory(self) -> Array:
        return self._estimator.trajectory

    @property
    def covariance(self) -> Array:
        return self._estimator.covariance

    def update(self, observations: ArrayLike, covariances: ArrayLike) -> Array:
        obs, cov = np.asarray(observations), np.asarray(covariances)
        keep = ~self._group.drifting[self._k]
        self._k += 1
        if len(obs):
            return self._estimator.update(obs[keep], cov[keep], np.flatnonzero(keep))
        return self._estimator.update(obs, cov)


def time_update(steps: int, last: int = 40, seed: int = 0) -> float:
    """Median time of one AdaTE update at the age of ``steps`` steps, ms: four observers on a long circle."""
    rng = np.random.default_rng(seed)
    angle = np.arange(steps) / 32.0
    truth = 32.0 * np.stack([np.cos(angle), np.sin(angle), np.zeros(steps)], axis=1)
    covariance = np.tile(np.diag([256.0, 259.0, 64.0]), (4, 1, 1))
    observations = truth[:, None, :] + rng.normal(size=(steps, 4, 3)) * np.sqrt([256.0, 259.0, 64.0])
    estimator = AdaptiveTrajectoryEstimator(
        PowerLimitedSteering(power_density=1e-4, steering_density=5e-5),
        settings=AdateSettings(truncation=TruncationSettings(limit=50)),
    )
    times = []
    for k in range(steps):
        begin = time.perf_counter()
        estimator.update(observations[k], covariance)
        times.append(time.perf_counter() - begin)
    return 1e3 * float(np.median(times[-last:]))


def run_adate_table(
    seeds: int = 20,
    progress: Callable[[str], None] | None = None,
    seed: int = 0,
    methods: Sequence[str] = METHODS,
    groups: Sequence[str] = GROUPS,
    steps: int | None = None,
    bound: bool = True,
) -> dict[str, Any]:
    """Table I over ``seeds`` draws.

    Parameters
    ----------
    seeds : number of draws of each group
    progress : called with a line after each cell
    seed : first seed; draw i of a group uses ``seed + i``, the same for every method
    methods, groups, steps : parts of the experiment, for short runs
    bound : also compute the lower bound that a smoother with true statistics reaches

    Raises
    ------
    ConfigError : ``seeds`` is not positive or a method is unknown
    """
    if seeds < 1:
        raise ConfigError(f"seeds: {seeds!r} is not a number of draws; give at least 1")
    rows: dict[str, dict[str, Any]] = {m: {} for m in methods}
    diverged = dict.fromkeys(methods, 0)
    limit: dict[str, dict[str, float]] = {}
    for name in groups:
        draws = [draw(name, np.random.default_rng(seed + i), steps) for i in range(seeds)]
        for method in methods:
            tracks = [(follow(make(method, name), g), g) for g in draws]
            rows[method][name] = _summary(tracks)
            diverged[method] += sum(t.diverged for t, _ in tracks)
            if progress:
                progress(f"{name:14s} {method:10s} {rows[method][name]['mean']:.4f}")
        if bound:
            limit[name] = _summary([(lower_bound(g), g) for g in draws])
            if progress:
                progress(f"{name:14s} {'bound':10s} {limit[name]['mean']:.4f}")
    best = {g: min(methods, key=lambda m: rows[m][g]["mean"]) for g in groups}
    return {
        "seeds": seeds,
        "rows": rows,
        "definition": DEFINITION,
        "diverged": diverged,
        "update_ms": {"AdaTE-PLS": {f"n{n}": time_update(n) for n in (100, 500, 5000)}},
        "published": PUBLISHED,
        "best": best,
        "lower_bound": limit,
    }


def run(
    seeds: int = 20,
    out_dir: Path | str | None = None,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> dict[str, Any]:
    """Reproduce the table; with ``out_dir`` also write ``adate-table.json`` and its figures there.

    ``progress`` is called with the share done, 0 to 1.
    """
    cells, done = len(GROUPS) * (len(METHODS) + 1), 0

    def count(line: str) -> None:
        nonlocal done
        done += 1
        if progress is not None:
            progress(done / cells)

    result = run_adate_table(seeds, count, seed)
    if out_dir is not None:
        from camnet.report.adate import plot_error_over_time, plot_tracks

        folder = Path(out_dir)
        folder.mkdir(parents=True, exist_ok=True)
        write_json(folder / "adate-table.json", result)
        data = figure_data(seed)
        plot_tracks(data, folder / "adate-trajectories.png")
        plot_error_over_time(data, folder / "adate-rmse.png")
    return result


def print_table(result: dict[str, Any]) -> None:
    """Print our rows, the published row of the same method, and the lower bound."""
    groups = list(next(iter(result["rows"].values())))
    print(f"{'normalised RMSE':22s}" + "".join(f"{g:>16s}" for g in groups))  # noqa: T201 - the command's table
    for method, row in result["rows"].items():
        print(f"{method:22s}" + "".join(f"{row[g]['mean']:16.3f}" for g in groups))  # noqa: T201
    published = result["published"]["AdaTE-PLS"]
    print(f"{'published AdaTE-PLS':22s}" + "".join(f"{published[g]:16.3f}" for g in groups))  # noqa: T201
    print(f"{'bound':22s}" + "".join(f"{result['lower_bound'][g]['mean']:16.3f}" for g in groups))  # noqa: T201


def figure_data(seed: int = 0, methods: Sequence[str] = METHODS) -> dict[str, dict[str, Any]]:
    """Tracks of one draw of every group for the figures: truth, observations, and each method's `Track`."""
    out: dict[str, dict[str, Any]] = {}
    for name in GROUPS:
        group = draw(name, np.random.default_rng(seed))
        out[name] = {
            "truth": group.truth,
            "observations": group.observations,
            "seen": group.seen,
            "scale_m": group.rmse(False),
            "tracks": {m: follow(make(m, name), group) for m in methods},
        }
    return out
