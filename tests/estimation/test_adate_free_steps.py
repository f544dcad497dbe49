"""AdaTE with free time steps, covariances of the smoothed states, observers that drift, and tracks in files."""

from __future__ import annotations

import numpy as np
import pytest

from camnet.errors import DataError
from camnet.estimation.adate import AdaptiveTrajectoryEstimator, AdateSettings
from camnet.estimation.adate.settings import AdaptationSettings, TruncationSettings
from camnet.estimation.pls import PowerLimitedSteering
from camnet.experiments.adate_groups import draw

MODEL = PowerLimitedSteering(power_density=1e-4, steering_density=5e-5, rest_density=3e-3)


def circle(t: np.ndarray) -> np.ndarray:
    return np.stack([32.0 * np.cos(t / 32.0), 32.0 * np.sin(t / 32.0), np.zeros_like(t)], axis=1)


def followed(t: np.ndarray, seed: int, sd: float = 3.0) -> tuple[AdaptiveTrajectoryEstimator, np.ndarray]:
    rng, truth = np.random.default_rng(seed), circle(t)
    estimator = AdaptiveTrajectoryEstimator(MODEL, 1.0)
    for k in range(len(t)):
        seen = truth[k] + rng.normal(0.0, sd, (3, 3))
        estimator.update(
            seen, np.tile(sd**2 * np.eye(3), (3, 1, 1)), dt_s=None if k == 0 else t[k] - t[k - 1]
        )
    return estimator, truth


def test_irregular_times_cost_little() -> None:
    def rmse(irregular: float) -> float:
        errors = []
        for seed in range(4):
            rng = np.random.default_rng(100 + seed)
            t = np.cumsum(1.0 + irregular * rng.uniform(-1.0, 1.0, 200))
            estimator, truth = followed(t, seed)
            errors.append(np.mean(np.sum((estimator.trajectory[:, :3] - truth) ** 2, axis=1)))
        return float(np.sqrt(np.mean(errors)))

    assert rmse(0.3) <= 1.1 * rmse(0.0)


def test_a_step_of_another_length_is_not_taken_for_the_usual_one() -> None:
    t = np.concatenate([np.arange(40.0), 39.0 + 5.0 * np.arange(1, 20)])
    estimator, truth = followed(t, 1, 0.5)
    assert np.linalg.norm(estimator.causal_state[:3] - truth[-1]) < 1.5
    with pytest.raises(DataError, match="dt_s"):
        estimator.update(truth[:1], np.eye(3)[None], dt_s=0.0)


def test_smoothed_covariances_are_those_of_the_errors() -> None:
    """50 tracks drawn from the model itself, nothing adapted: the mean squared normalised error is 3."""
    plain = AdateSettings(
        adaptation=AdaptationSettings(process="none", observation="none", learn_scale=False),
        truncation=TruncationSettings(limit=40, keep=20),
    )
    found = []
    for seed in range(25):
        rng = np.random.default_rng(seed)
        state = np.array([0, 0, 0, 4.0, 0, 0, 4.0 * (0.04 + 0.4), 0, 0, 0.02])
        estimator = AdaptiveTrajectoryEstimator(MODEL, 1.0, plain)
        truth = []
        for _ in range(90):
            mean, _, q = MODEL.linearise(state, 1.0)
            state = rng.multivariate_normal(mean, q)
            truth.append(state[:3].copy())
            estimator.update(state[None, :3] + rng.normal(0.0, 1.0, (1, 3)), np.eye(3)[None])
        covariances, path = estimator.smoothed_covariances(), estimator.trajectory
        assert np.linalg.eigvalsh(covariances[:, :3, :3]).min() > 0.0
        for k in range(30, 90, 10):
            e = path[k, :3] - truth[k]
            found.append(e @ np.linalg.solve(covariances[k, :3, :3], e))
    assert 2.3 < np.mean(found) < 3.9


def first_flag(group, start: int = 0) -> dict[int, int]:
    estimator, found = AdaptiveTrajectoryEstimator(MODEL, 1.0), {}
    for k in range(len(group.truth)):
        given = (
            (group.observations[k], group.covariance)
            if group.seen[k]
            else (np.zeros((0, 3)), np.zeros((0, 3, 3)))
        )
        estimator.update(*given)
        for name, drifts in estimator.drifting().items():
            if drifts and name not in found:
                found[name] = k
    return found


@pytest.mark.parametrize("seed", [0, 1])
def test_a_drifting_observer_is_named_soon_and_no_other(seed: int) -> None:
    group = draw("snake_drift", np.random.default_rng(seed))
    flags = first_flag(group)
    started = int(np.flatnonzero(group.drifting[:, 0])[0])
    beyond = started + int((3.0 * 8.0 / 4.0) ** 2)  # 4 sqrt(i) m reaches three deviations of 8 m
    assert set(flags) == {0}
    assert started < flags[0] <= beyond + 60


@pytest.mark.slow
def test_clean_observers_are_hardly_ever_named() -> None:
    assert sum(len(first_flag(draw("snake", np.random.default_rng(seed)))) for seed in range(50)) <= 1


def test_a_track_goes_on_from_its_file(tmp_path) -> None:
    group = draw("cruise", np.random.default_rng(3), steps=120)
    estimator = AdaptiveTrajectoryEstimator(MODEL, 1.0)
    for k in range(90):
        estimator.update(group.observations[k], group.covariance)
    estimator.save(tmp_path / "track.npz")
    other = AdaptiveTrajectoryEstimator.load(tmp_path / "track.npz")
    for k in range(90, 120):
        np.testing.assert_array_equal(
            estimator.update(group.observations[k], group.covariance),
            other.update(group.observations[k], group.covariance),
        )
    np.testing.assert_array_equal(estimator.trajectory, other.trajectory)
    np.testing.assert_array_equal(estimator.smoothed_covariances(), other.smoothed_covariances())
    assert estimator.drifting() == other.drifting()


def test_a_file_of_something_else_is_refused(tmp_path) -> None:
    (tmp_path / "x.npz").write_bytes(b"no archive")
    with pytest.raises(DataError, match=r"x\.npz"):
        AdaptiveTrajectoryEstimator.load(tmp_path / "x.npz")
