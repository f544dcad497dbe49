import json

import numpy as np
import pytest

from camnet.errors import ConfigError
from camnet.experiments.adate_groups import GROUPS, draw, track
from camnet.experiments.adate_table import (
    METHODS,
    PUBLISHED,
    figure_data,
    follow,
    lower_bound,
    make,
    run_adate_table,
    time_update,
)
from camnet.report.adate import plot_error_over_time, plot_tracks


@pytest.mark.parametrize(("name", "steps"), [("cruise", 500), ("swaying", 500), ("snake", 600)])
def test_tracks_are_continuous_and_have_the_stated_length(name, steps):
    path = track(name)
    assert path.shape == (steps, 3)
    speed = np.linalg.norm(np.diff(path, axis=0), axis=1)
    assert speed.min() > 0.9
    assert speed.max() < 2.8


def test_cruise_joins_its_pieces_in_heading():
    v = np.diff(track("cruise"), axis=0)
    heading = np.unwrap(np.arctan2(v[:, 1], v[:, 0]))
    assert np.abs(np.diff(heading)).max() < 0.06  # 1/32 rad a step on the arcs, 1.4 degrees at the joints
    assert np.linalg.norm(v[10]) == pytest.approx(1.0)
    assert np.linalg.norm(v[299]) == pytest.approx(2.0, abs=0.01)
    assert np.linalg.norm(v[-1]) == pytest.approx(50 / 32 - 0.5, abs=0.01)


def test_noise_drift_gap_and_bias_are_as_stated():
    draws = [draw("cruise_drift", np.random.default_rng(i)) for i in range(10)]
    errors = np.array([g.observations - g.truth[:, None] for g in draws])
    np.testing.assert_allclose(np.var(errors[:, :, 1:], axis=(0, 1, 2)), [256, 259, 64], rtol=0.05)
    np.testing.assert_allclose(errors[:, 449, 0, 0].mean(), 8 * np.sqrt(149), atol=20.0)
    assert np.abs(errors[:, 450:, 0].mean(axis=(0, 1))).max() < 4.0
    ratio = np.array(
        [np.diagonal(g.covariance, axis1=1, axis2=2) / np.diag(g.true_covariance) for g in draws]
    )
    assert ratio.min() > 0.4
    assert ratio.max() < 1.4
    assert ratio.mean() == pytest.approx(0.9, abs=0.1)
    snake = draw("snake", np.random.default_rng(0))
    assert list(np.flatnonzero(~snake.seen)[[0, -1]]) == [249, 299]


def test_observation_errors_match_the_published_row():
    published = dict(zip(GROUPS, (24.78, 58.89, 23.65, 91.25, 14.19, 28.02), strict=True))
    for name, value in published.items():
        mean = np.mean([draw(name, np.random.default_rng(i)).rmse(False) for i in range(5)])
        assert mean == pytest.approx(value, rel=0.05)


def test_a_short_table_has_every_cell_and_repeats_itself():
    groups = ("cruise", "snake_drift")
    lines = []
    one = run_adate_table(1, lines.append, groups=groups, steps=60)
    two = run_adate_table(1, groups=groups, steps=60)
    assert len(lines) == len(groups) * (len(METHODS) + 1)
    for method in METHODS:
        for group in groups:
            cell = one["rows"][method][group]
            assert cell == two["rows"][method][group]
            assert {"mean", "sd", "final", "pooled", "causal"} <= set(cell)
            assert 0.0 < cell["mean"] < 1.0
    assert one["diverged"] == dict.fromkeys(METHODS, 0)
    assert set(one["update_ms"]["AdaTE-PLS"]) == {"n100", "n500", "n5000"}
    assert set(PUBLISHED) == set(METHODS)
    json.dumps(one)


def test_error_so_far_is_the_published_definition():
    group = draw("cruise", np.random.default_rng(0), 30)
    est = make("EKF-CA", "cruise")
    result = follow(est, group)
    error = result.smoothed - group.truth
    assert result.error_so_far[-1] == pytest.approx(np.sqrt(np.mean(np.sum(error**2, axis=1))))
    assert result.error_so_far[0] == pytest.approx(np.linalg.norm(result.causal[0] - group.truth[0]))


def test_figures_are_written(tmp_path, monkeypatch):
    import camnet.experiments.adate_table as module

    monkeypatch.setattr(module, "draw", lambda name, rng: draw(name, rng, 40))
    data = figure_data(0, methods=("AdaTE-PLS", "EKF-CA"))
    plot_tracks(data, tmp_path / "tracks.png")
    plot_error_over_time(data, tmp_path / "error.png")
    for name in ("tracks.png", "error.png"):
        assert (tmp_path / name).stat().st_size > 20_000


def test_bad_arguments_are_refused():
    with pytest.raises(ConfigError, match="seeds: 0"):
        run_adate_table(0)
    with pytest.raises(ConfigError, match="'PF'"):
        make("PF", "cruise")


@pytest.mark.slow
def test_adate_is_best_everywhere_and_at_or_below_the_published_figures():
    result = run_adate_table(20)
    assert set(result["best"].values()) == {"AdaTE-PLS"}
    assert result["diverged"]["AdaTE-PLS"] == 0
    for group in GROUPS:
        mean = result["rows"]["AdaTE-PLS"][group]["mean"]
        assert mean <= PUBLISHED["AdaTE-PLS"][group]
        assert (
            mean >= 0.95 * result["lower_bound"][group]["mean"]
        )  # no estimator beats its true statistics by much


@pytest.mark.slow
@pytest.mark.parametrize("name", GROUPS)
def test_a_thousand_seeds_never_diverge(name):
    nothing = np.zeros((0, 3)), np.zeros((0, 3, 3))
    for seed in range(1000):
        group = draw(name, np.random.default_rng(seed), 100)
        est = make("AdaTE-PLS", name)
        for k in range(100):
            est.update(*((group.observations[k], group.covariance) if group.seen[k] else nothing))
            assert np.linalg.eigvalsh(est.covariance)[0] > 0.0
        error = np.sqrt(np.mean(np.sum((est.trajectory[:, :3] - group.truth) ** 2, axis=1)))
        assert error < 0.5 * group.rmse(True)


def test_lower_bound_uses_the_true_statistics():
    group = draw("cruise", np.random.default_rng(1), 80)
    bound = lower_bound(group)
    ekf = follow(make("EKF-CA", "cruise"), group)
    assert bound.error_so_far.mean() < ekf.error_so_far.mean()
    assert time_update(60) > 0.0
