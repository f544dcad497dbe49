"""Pedestrians: windows, causality, the mix against brute force, and the figures measured elsewhere."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from camnet.errors import DataError
from camnet.experiments.pedestrians import ekf, predictions, run
from camnet.experiments.pedestrians_data import FUTURE, OBSERVED, Experience, experience_of, load, windows_of
from camnet.experiments.pedestrians_flow import MOTION_M, PLACE_M, field_prediction, learned_deviation
from camnet.experiments.pedestrians_mix import better_so_far, mix


def _write(path: Path, rows: list[tuple[float, float, float, float]]) -> Path:
    path.write_text("".join(f"{f}\t{i}\t{x}\t{y}\n" for f, i, x, y in rows))
    return path


def _crowd(folder: Path, people: int = 10, length: int = 30, seed: int = 0) -> Path:
    """People who walk along x and all turn left at x = 6, one after another."""
    rng = np.random.default_rng(seed)
    rows = []
    for i in range(people):
        p, v = np.array([0.0, rng.normal(0.0, 0.2)]), np.array([0.5, 0.0]) + rng.normal(0.0, 0.02, 2)
        for k in range(length):
            rows.append((10.0 * (8 * i + k), float(i + 1), float(p[0]), float(p[1])))
            if p[0] > 6.0:
                v = np.array([0.05, 0.5])
            p = p + v
    return _write(folder / "crowd.txt", rows)


def test_windows_are_runs_of_consecutive_samples(tmp_path: Path) -> None:
    rows = [(10.0 * k, 1.0, 0.1 * k, 0.0) for k in range(50) if k != 25]
    windows = windows_of(load(_write(tmp_path / "one.txt", rows)))
    # 25 samples before the missing one and 24 after it
    assert len(windows.now) == (25 - 19) + (24 - 19)
    assert windows.seen.shape[1:] == (OBSERVED, 2)
    assert windows.future.shape[1:] == (FUTURE, 2)
    np.testing.assert_allclose(windows.future[:, -1, 0], 1.2)


def test_too_short_tracks_are_refused(tmp_path: Path) -> None:
    rows = [(10.0 * k, 1.0, 0.1 * k, 0.0) for k in range(19)]
    with pytest.raises(DataError, match="20 consecutive"):
        windows_of(load(_write(tmp_path / "short.txt", rows)))
    with pytest.raises(DataError, match=r"no \*\.txt"):
        run(data=tmp_path / "nowhere")


def test_no_prediction_knows_the_future(tmp_path: Path) -> None:
    """What happens after a sample changes nothing that is predicted at or before it."""
    path = _crowd(tmp_path)
    windows, rows = predictions(path)
    cut = int(np.median(windows.now))
    lines = [line.split() for line in path.read_text().splitlines()]
    rng = np.random.default_rng(1)
    spoilt = [
        (float(f), float(i), float(x) + (rng.normal() if float(f) > 10.0 * cut else 0.0), float(y))
        for f, i, x, y in lines
    ]
    other_windows, other_rows = predictions(_write(tmp_path / "spoilt.txt", spoilt))
    early = windows.now <= cut
    np.testing.assert_array_equal(windows.now, other_windows.now)
    for name, prediction in rows.items():
        np.testing.assert_allclose(prediction[early], other_rows[name][early], atol=1e-9, err_msg=name)
        assert not np.allclose(prediction[~early], other_rows[name][~early]), name


def test_a_turn_that_others_took_is_learned(tmp_path: Path) -> None:
    windows, rows = predictions(_crowd(tmp_path))
    late = windows.now > np.median(windows.now)
    error = {name: np.linalg.norm(p - windows.future, axis=2)[late].mean() for name, p in rows.items()}
    assert error["learned"] < 0.6 * error["constant_velocity"]
    assert error["learned_own_velocity"] < 0.6 * error["constant_velocity"]


def test_deviation_equals_the_plain_sum(tmp_path: Path) -> None:
    walkers = load(_crowd(tmp_path, people=5))
    windows, known = windows_of(walkers), experience_of(walkers)
    found = learned_deviation(windows, known)
    v = windows.seen[:, -1] - windows.seen[:, -2]
    for a in range(0, len(windows.now), 7):
        place = np.sum((windows.seen[a, -1] - known.p) ** 2, axis=1) / PLACE_M**2
        square = place + np.sum((v[a] - known.v) ** 2, axis=1) / MOTION_M**2
        for h in (0, 5, 11):
            told = known.at + h + 1 <= windows.now[a]
            use = told & (known.ahead > h) & (known.person != windows.person[a]) & (square <= 12.0)
            w = np.exp(-0.5 * square[use])
            expected = (w @ known.deviation[use, h]) / (w.sum() + 3.0) if use.any() else np.zeros(2)
            np.testing.assert_allclose(found[a, h], expected, atol=1e-12)


def test_flow_field_without_experience_is_constant_velocity(tmp_path: Path) -> None:
    walkers = load(_crowd(tmp_path, people=2))
    windows = windows_of(walkers)
    none = Experience(*(value[:0] for value in _fields(experience_of(walkers))))
    v = windows.seen[:, -1] - windows.seen[:, -2]
    straight = v[:, None, :] * np.arange(1.0, FUTURE + 1.0)[:, None]
    np.testing.assert_allclose(field_prediction(windows, none), straight)
    np.testing.assert_allclose(learned_deviation(windows, none), 0.0)


def _fields(known: Experience) -> list[np.ndarray]:
    return [known.person, known.at, known.p, known.v, known.ahead, known.deviation]


def test_mix_finds_the_better_prediction_and_never_keeps_a_bad_one(tmp_path: Path) -> None:
    windows = windows_of(load(_crowd(tmp_path, people=20)))
    rng = np.random.default_rng(0)
    good = windows.future + rng.normal(0.0, 0.01, windows.future.shape)
    bad = windows.future + rng.normal(0.0, 2.0, windows.future.shape)
    late = windows.now > np.median(windows.now)
    mixed = np.linalg.norm(mix(windows, bad, (good,)) - windows.future, axis=2)[late].mean()
    assert mixed < 0.1
    # alone, a bad prediction gives way once there is evidence; a good one stays
    assert not better_so_far(windows, bad, good)[late].any()
    assert better_so_far(windows, good, bad).all()


def test_filter_equals_least_squares_in_the_limit(tmp_path: Path) -> None:
    """On straight paths without noise the filter's velocity is the path's, to the weight of its prior."""
    rows = [(10.0 * k, 1.0, 0.4 * k, -0.2 * k) for k in range(25)]
    windows = windows_of(load(_write(tmp_path / "line.txt", rows)))
    np.testing.assert_allclose(ekf(windows), windows.future, atol=0.02)


def test_constant_velocity_as_measured_elsewhere(shared_data: Path) -> None:
    for name, ade, fde in (("biwi_hotel", 0.319, 0.614), ("crowds_zara01", 0.427, 0.952)):
        windows, rows = predictions(shared_data / "ethucy" / f"{name}.txt")
        error = {key: np.linalg.norm(row - windows.future, axis=2) for key, row in rows.items()}
        plain = error["constant_velocity"]
        assert (plain.mean(), plain[:, -1].mean()) == pytest.approx((ade, fde), abs=6e-4)
        assert error["learned"].mean() < plain.mean()
        assert error["learned_own_velocity"].mean() < plain.mean()
