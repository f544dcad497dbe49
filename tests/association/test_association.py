"""Association across gaps on worlds whose answer is known."""

from itertools import permutations, product

import numpy as np
import pytest

from camnet.association.appearance import appearance_ratio
from camnet.association.calibration import calibration_error, reliability
from camnet.association.choice import cross_fitted, fit_choice, group_log_softmax
from camnet.association.crossing_density import Ends, Lessons, pair_densities
from camnet.association.marginals import assignment_marginals, exact_marginals
from camnet.association.settings import DensitySettings
from camnet.association.tracklets import tracklets_of


def _brute(weights):
    n, k = weights.shape
    out, total = np.zeros((n, k)), 0.0
    for rows in permutations(range(n), k):
        p = np.prod([weights[i, j] for j, i in enumerate(rows)])
        total += p
        for j, i in enumerate(rows):
            out[i, j] += p
    return out / total


@pytest.mark.parametrize("seed", range(5))
def test_exact_marginals_are_sums_over_all_assignments(seed):
    weights = np.exp(np.random.default_rng(seed).normal(size=(6, 4)))
    assert exact_marginals(weights) == pytest.approx(_brute(weights))


@pytest.mark.parametrize("seed", range(5))
def test_messages_find_marginals_nearly(seed):
    weights = np.exp(2.0 * np.random.default_rng(seed).normal(size=(6, 4)))
    assert np.abs(assignment_marginals(weights) - exact_marginals(weights)).max() < 0.09
    assert assignment_marginals(weights).sum(axis=0) == pytest.approx(np.ones(4))


def test_scale_of_an_entry_does_not_matter():
    weights = np.exp(np.random.default_rng(1).normal(size=(5, 3)))
    assert assignment_marginals(weights * [1.0, 1e-5, 1e4]) == pytest.approx(assignment_marginals(weights))


def _ends(t_s, p, v, owner):
    return Ends(np.array(t_s, float), np.array(p, float), np.array(v, float), np.ones(len(t_s), bool), owner)


def _crowd(n=400, seed=0):
    """Two doors: who leaves north comes back at (30, 0) after 20 s, who leaves south at (30, 40) after 60 s."""
    rng = np.random.default_rng(seed)
    south = rng.random(n) < 0.5
    t = np.sort(rng.uniform(0, 40_000, n))
    away = np.where(south, 60.0, 20.0) * np.exp(0.2 * rng.normal(size=n))
    v = np.where(south[:, None], [0.0, -1.2], [0.0, 1.2]) + 0.1 * rng.normal(size=(n, 2))
    end = np.where(south[:, None], [30.0, 40.0], [30.0, 0.0]) + rng.normal(size=(n, 2))
    owner = np.arange(n)
    exits = _ends(t, rng.normal(size=(n, 2)), v, owner)
    entries = _ends(t + away, end, v, owner)
    return exits, entries, south


def test_density_integrates_to_the_share_that_returns():
    exits, entries, _ = _crowd()
    settings = DensitySettings(prior_weight=1e-6, time_floor_s=0.0)
    lessons = Lessons.of(exits, entries, np.ones(400, bool), np.ones(400), 50.0)
    one = _ends([50_000.0], [[0.0, 0.0]], [[0.0, 1.2]], np.array([-1]))
    times, xs = np.exp(np.linspace(np.log(5), np.log(90), 40)), np.arange(-60, 121, 4.0)
    grid = np.array(list(product(times, xs, xs - 30)))
    probe = _ends(50_000.0 + grid[:, 0], grid[:, 1:], np.zeros((len(grid), 2)), np.zeros(len(grid), int))
    pairs = np.zeros(len(grid), int), np.arange(len(grid))
    density = np.exp(pair_densities(one, probe, pairs, lessons, settings, False).log_f)
    log_step = np.log(times[1] / times[0])
    assert np.sum(density * grid[:, 0] * log_step * 16.0) == pytest.approx(1.0, abs=0.03)


def test_survival_is_the_share_of_lessons_that_lasted_longer():
    exits, entries, south = _crowd()
    settings = DensitySettings(prior_weight=1e-6, time_floor_s=0.0, log_time_scale=0.02)
    lessons = Lessons.of(exits, entries, np.ones(400, bool), np.ones(400), 50.0)
    one = _ends([50_000.0], [[0.0, 0.0]], [[0.0, -1.2]], np.array([-1]))
    probe = _ends([50_060.0], [[0.0, 0.0]], [[0.0, 0.0]], np.array([0]))
    got = np.exp(pair_densities(one, probe, (np.array([0]), np.array([0])), lessons, settings, False).log_s)
    away = (entries.t_s - exits.t_s)[south]
    assert got[0] == pytest.approx(np.mean(away > 60.0), abs=0.06)


def test_own_lessons_and_later_ones_are_left_out():
    exits, entries, _ = _crowd(6)
    lessons = Lessons.of(exits, entries, np.ones(6, bool), np.ones(6), 0.6)
    pairs = np.array([0]), np.array([0])
    settings = DensitySettings()
    mine = lessons.owner != 0
    without = Lessons(*(getattr(lessons, f)[mine] for f in Lessons.__slots__))
    out = [pair_densities(exits, entries, pairs, x, settings, False).log_f for x in (lessons, without)]
    earlier = pair_densities(exits, entries, pairs, lessons, settings, True).log_f
    nothing = Lessons(*(getattr(lessons, f)[:0] for f in Lessons.__slots__))
    assert out[0] != pytest.approx(earlier)
    assert abs(out[0] - out[1]) < 0.5  # only the law of all durations differs
    assert np.isfinite(pair_densities(exits, entries, pairs, nothing, settings, True).log_f).all()


def test_hazard_finds_the_right_one_of_two():
    exits, entries, south = _crowd()
    lessons = Lessons.of(exits, entries, np.ones(400, bool), np.ones(400), 0.6)
    i, j = int(np.flatnonzero(south)[0]), int(np.flatnonzero(~south)[0])
    two = _ends([0.0, 0.0], exits.p_world[[i, j]], exits.v_world[[i, j]], np.array([-1, -2]))
    came = _ends([20.0, 60.0], [[30.0, 0.0], [30.0, 40.0]], np.zeros((2, 2)), np.array([-2, -1]))
    pairs = np.array([0, 0, 1, 1]), np.array([0, 1, 0, 1])
    d = pair_densities(two, came, pairs, lessons, DensitySettings(), False)
    assert d.log_hazard[2] > d.log_hazard[0] + 2.0
    assert (
        d.log_f[1] > d.log_f[3] + 2.0
    )  # hardly anybody who left north is still away: the hazard knows little


def test_choice_finds_the_coefficients_that_made_the_data():
    rng = np.random.default_rng(0)
    groups, per, b = 3000, 4, np.array([1.5, -0.7])
    x = rng.normal(size=(groups * per, 2))
    group = np.repeat(np.arange(groups), per)
    p = np.exp(group_log_softmax(x @ b, group, groups)).reshape(groups, per)
    pick = (np.cumsum(p, axis=1) > rng.random((groups, 1))).argmax(axis=1)
    right = np.zeros(groups * per, bool)
    right[np.arange(groups) * per + pick] = True
    assert fit_choice(x, right, group, np.ones(groups)) == pytest.approx(b, abs=0.1)
    fold = np.arange(groups) % 3
    scores = cross_fitted(x, np.ones(len(x), bool), right, group, fold)
    stated = np.exp(group_log_softmax(scores, group, groups))
    assert calibration_error(stated, right) < 0.01


def test_calibration_error_of_a_known_lie():
    stated, true = np.full(1000, 0.9), np.arange(1000) % 2 == 0
    assert calibration_error(stated, true) == pytest.approx(0.4, abs=1e-9)
    assert [r["count"] for r in reliability(stated, true)] == [100] * 10


def test_appearance_ratio_is_that_of_the_two_densities():
    from scipy.stats import multivariate_normal

    a, b, s = np.array([0.3, -1.2]), np.array([0.5, 0.4]), 0.8
    v = 1 + s**2
    want = 0.0
    for p, q in zip(a, b, strict=True):
        want += multivariate_normal([0, 0], [[v, 1], [1, v]]).logpdf([p, q])
        want -= multivariate_normal([0, 0], [[v, 0], [0, v]]).logpdf([p, q])
    assert appearance_ratio(a[None], b[None], s) == pytest.approx([want])


def test_tracklets_of_two_targets_in_turn():
    t = np.array([0, 1, 2, 3, 4, 0, 1, 2], float)
    target = np.array([0, 0, 0, 0, 0, 1, 1, 1])
    seen = np.array([True, True, False, True, False, False, True, True])
    p = np.stack([t, 10.0 * target], axis=1)
    order = np.lexsort((target, t))
    x = tracklets_of(t[order], p[order], target[order], target[order], seen[order])
    assert x.entries.t_s.tolist() == [0, 3, 1]
    assert x.exits.t_s.tolist() == [1, 3, 2]
    assert x.after.tolist() == [1, -1, -1]
    assert x.before.tolist() == [-1, 0, -1]
    assert x.open_until_s.tolist() == [3, 4, 2]
    assert x.exits.v_world[0].tolist() == [1.0, 0.0]
    assert x.exits.moving.tolist() == [True, False, True]
    assert x.resighted.tolist() == [1]
