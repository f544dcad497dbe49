import numpy as np
import pytest
from scipy.optimize import least_squares

from camnet.errors import DataError
from camnet.estimation.adate import AdaptiveTrajectoryEstimator, AdateSettings, descent
from camnet.estimation.adate.objective import objective
from camnet.estimation.adate.settings import AdaptationSettings, TruncationSettings
from camnet.estimation.pls import ConstantTurn, PowerLimitedSteering

NOTHING = np.zeros((0, 3)), np.zeros((0, 3, 3))
FIXED = AdaptationSettings(process="none", observation="none", learn_scale=False)


def _circle(steps, radius=40.0, speed=1.3):
    angle = speed / radius * np.arange(steps)
    return radius * np.stack([np.cos(angle), np.sin(angle), np.zeros(steps)], axis=1)


def _follow(est, truth, rng, sd=2.0, observers=4, told=None, gap=(), alter=None):
    noise = rng.normal(size=(len(truth), observers, 3)) * sd
    cov = np.tile(np.eye(3) * (sd if told is None else told) ** 2, (observers, 1, 1))
    causal = []
    for k, x in enumerate(truth):
        obs = x + noise[k]
        if alter is not None:
            alter(k, obs)
        causal.append(est.update(*(NOTHING if k in gap else (obs, cov)))[:3])
        assert np.linalg.eigvalsh(est.covariance)[0] > 0.0
    return np.array(causal)


def _rms(a, b):
    return float(np.sqrt(np.mean(np.sum((a - b) ** 2, axis=1))))


@pytest.mark.parametrize("model", [PowerLimitedSteering(), ConstantTurn()])
def test_smooths_well_below_the_noise_of_one_step(model):
    truth = _circle(200)
    est = AdaptiveTrajectoryEstimator(model=model, dt_s=1.0)
    causal = _follow(est, truth, np.random.default_rng(0))
    assert est.trajectory.shape == (200, 10)
    assert est.causal_state.shape == (10,)
    assert _rms(est.trajectory[:, :3], truth) < 0.75  # the mean of one step's observations: 1.73
    assert _rms(causal[40:], truth[40:]) < 1.2
    assert _rms(est.trajectory[:, :3], truth) < _rms(causal, truth)


def test_converged_trajectory_is_a_minimum_of_the_objective():
    truth = _circle(40, radius=15.0)
    settings = AdateSettings(iterations=30, rescue=30, tolerance=1e-9, adaptation=FIXED)
    est = AdaptiveTrajectoryEstimator(PowerLimitedSteering(), settings=settings)
    _follow(est, truth, np.random.default_rng(3), sd=0.5)
    w = est._track.win
    args = (w.tau, False, w.q.copy(), w.z, w.rbar, w.seen, est._track.mean, est._track.cov)
    best = objective(w.n, est._track.par, w.s, *args)
    scale = np.sqrt(np.diag(est.covariance))

    def value(x):
        return [np.sqrt(objective(w.n, est._track.par, w.s + x.reshape(w.s.shape) * scale, *args))]

    rng = np.random.default_rng(0)
    for _ in range(50):
        direction = 1e-3 * rng.normal(size=w.s.size)
        assert value(direction)[0] ** 2 > best
    # a solver that knows nothing of the chain finds nothing better nearby
    found = least_squares(value, np.zeros(w.s.size), method="trf", max_nfev=3)
    assert found.fun[0] ** 2 > best * (1.0 - 1e-6)


def test_a_drifting_observer_is_found_and_left_out():
    truth = _circle(220)

    def drift(k, obs):
        if k >= 100:
            obs[0, :2] += 1.5 * np.sqrt(k - 100.0)

    error = {}
    for rule in ("local", "none"):
        settings = AdateSettings(adaptation=AdaptationSettings(observation=rule, learn_scale=rule == "local"))
        est = AdaptiveTrajectoryEstimator(settings=settings)
        _follow(est, truth, np.random.default_rng(1), alter=drift)
        error[rule] = _rms(est.trajectory[100:, :3], truth[100:])
    assert error["local"] < 1.0
    assert error["none"] > 3.0 * error["local"]


@pytest.mark.parametrize("rule", ["local", "gate", "student"])
def test_lone_outliers_do_little_harm(rule):
    truth = _circle(120)

    def spoil(k, obs):
        if k % 10 == 7:
            obs[k % 4] += 40.0

    est = AdaptiveTrajectoryEstimator(settings=AdateSettings(adaptation=AdaptationSettings(observation=rule)))
    _follow(est, truth, np.random.default_rng(2), alter=spoil)
    plain = AdaptiveTrajectoryEstimator(settings=AdateSettings(adaptation=FIXED))
    _follow(plain, truth, np.random.default_rng(2), alter=spoil)
    assert _rms(est.trajectory[:, :3], truth) < _rms(plain.trajectory[:, :3], truth)


def test_wrong_scale_of_an_observers_covariance_is_learnt():
    est = AdaptiveTrajectoryEstimator()
    truth = _circle(400)
    rng = np.random.default_rng(5)
    sd = np.array([1.0, 2.0, 2.0, 4.0])
    for x in truth:
        est.update(x + rng.normal(size=(4, 3)) * sd[:, None], np.tile(4.0 * np.eye(3), (4, 1, 1)))
    learnt = [np.trace(est._track.win.r[-30, j]) / 3.0 for j in range(4)]
    assert learnt[0] < 2.0
    assert 2.5 < learnt[1] < 6.0
    assert 2.5 < learnt[2] < 6.0
    assert learnt[3] > 8.0


def test_densities_adapt_to_the_motion():
    steady = AdaptiveTrajectoryEstimator(PowerLimitedSteering(steering_density=1e-3))
    _follow(steady, _circle(300), np.random.default_rng(0), sd=0.5)
    x = np.arange(300.0)
    weaving = np.stack([x, 8.0 * np.sin(x / 5.0), np.zeros(300)], axis=1)
    agile = AdaptiveTrajectoryEstimator(PowerLimitedSteering(steering_density=1e-6))
    _follow(agile, weaving, np.random.default_rng(0), sd=0.5)
    assert steady.steering_scale < 0.3
    assert agile.steering_scale > 10.0


def test_window_stays_bounded_and_older_states_are_frozen():
    est = AdaptiveTrajectoryEstimator()
    truth = _circle(400)
    rng = np.random.default_rng(0)
    longest = 0
    for k, x in enumerate(truth):
        before = est.trajectory[: max(0, k - est.settings.truncation.limit)]
        est.update(x + 2.0 * rng.normal(size=(4, 3)), np.tile(4.0 * np.eye(3), (4, 1, 1)))
        np.testing.assert_array_equal(est.trajectory[: len(before)], before)
        longest = max(longest, est.window)
    assert longest <= est.settings.truncation.limit
    assert est.window < 130


def test_truncation_costs_no_accuracy_against_the_whole_trajectory():
    truth = _circle(150)
    results = []
    for limit in (60, 200):
        settings = AdateSettings(
            adaptation=FIXED, truncation=TruncationSettings(keep=min(limit, 50), limit=limit)
        )
        est = AdaptiveTrajectoryEstimator(settings=settings)
        _follow(est, truth, np.random.default_rng(7))
        results.append(est)
    np.testing.assert_allclose(results[0].causal_state[:6], results[1].causal_state[:6], atol=0.05)
    assert np.abs(results[0].trajectory[:, :3] - results[1].trajectory[:, :3]).max() < 0.3


def test_gap_is_predicted_by_the_mean_and_closed_again():
    truth = _circle(160)
    est = AdaptiveTrajectoryEstimator()
    gap = range(80, 110)
    sizes = []
    rng = np.random.default_rng(0)
    for k, x in enumerate(truth):
        obs = x + 0.5 * rng.normal(size=(3, 3))
        est.update(*(NOTHING if k in gap else (obs, np.tile(0.25 * np.eye(3), (3, 1, 1)))))
        sizes.append(np.trace(est.covariance[:3, :3]))
        if k == 79:
            times, means, covs = est.predict(30.0)
        if k == 109:
            np.testing.assert_allclose(est.trajectory[80:110, :3], means[:, :3], atol=0.3)
            np.testing.assert_allclose(np.trace(est.covariance), np.trace(covs[-1]), rtol=0.2)
            assert np.linalg.norm(est.causal_state[:3] - x) < 3.0 * np.sqrt(np.trace(covs[-1][:3, :3]))
    assert times[-1] == pytest.approx(30.0)
    assert np.all(np.diff(sizes[79:110]) > 0.0)
    assert sizes[115] < 0.05 * sizes[109]
    assert _rms(est.trajectory[80:110, :3], truth[80:110]) < 2.0


def test_prediction_mean_and_spread_match_simulation():
    from camnet.estimation.pls.reference import simulate

    est = AdaptiveTrajectoryEstimator(settings=AdateSettings(adaptation=FIXED))
    _follow(est, _circle(80), np.random.default_rng(0), sd=0.5)
    _, means, covs = est.predict(8.0)
    rng = np.random.default_rng(1)
    starts = rng.multivariate_normal(est.causal_state, est.covariance, size=6000)
    ends = simulate(est.model, starts, 8.0, 6000, 160, rng)
    sd = np.sqrt(np.diag(covs[-1]))
    assert np.abs((ends.mean(axis=0) - means[-1]) / sd).max() < 0.15
    np.testing.assert_allclose(np.cov(ends.T)[:3, :3].trace(), covs[-1][:3, :3].trace(), rtol=0.15)


def test_braking_to_a_stop_and_moving_again():
    speed = np.concatenate(
        [np.full(60, 1.0), np.linspace(1.0, 0.0, 20), np.zeros(40), np.linspace(0, 1, 20), np.ones(40)]
    )
    truth = np.stack([np.cumsum(speed), np.zeros(180), np.zeros(180)], axis=1)
    est = AdaptiveTrajectoryEstimator(PowerLimitedSteering(power_density=1e-2))
    _follow(est, truth, np.random.default_rng(0), sd=0.3)
    assert np.isfinite(est.trajectory).all()
    assert _rms(est.trajectory[:, :3], truth) < 0.35
    assert np.abs(est.trajectory[95:110, 3:6]).max() < 0.4


def test_a_target_that_never_moves():
    est = AdaptiveTrajectoryEstimator()
    _follow(est, np.zeros((80, 3)), np.random.default_rng(0), sd=0.3)
    assert np.linalg.norm(est.trajectory[:, :3], axis=1).max() < 0.6


@pytest.mark.parametrize("lost_for", [1, 2])
def test_a_lost_trajectory_is_recovered_from_the_linear_smoother(monkeypatch, lost_for):
    truth = _circle(120)
    est = AdaptiveTrajectoryEstimator()
    original, left = descent.converge, [0]

    def spoilt(track):
        if left[0] > 0:
            left[0] -= 1
            track.win.s[3:] = np.nan
            return False
        return original(track)

    monkeypatch.setattr(descent, "converge", spoilt)
    rng = np.random.default_rng(0)
    for k, x in enumerate(truth):
        left[0] = lost_for if k == 60 else left[0]
        est.update(x + rng.normal(size=(3, 3)), np.tile(np.eye(3), (3, 1, 1)))
        assert np.isfinite(est.trajectory).all()
        assert np.linalg.eigvalsh(est.covariance)[0] > 0.0
    assert est.restarts == 1
    assert est.fallbacks == lost_for - 1
    assert _rms(est.trajectory[:, :3], truth) < 0.8


def test_observers_are_told_apart_by_name():
    truth = _circle(120)
    rng = np.random.default_rng(4)
    estimators = [AdaptiveTrajectoryEstimator() for _ in range(2)]
    for k, x in enumerate(truth):
        obs, cov = x + rng.normal(size=(3, 3)), np.tile(np.eye(3), (3, 1, 1))
        turn = np.roll(np.arange(3), k)
        estimators[0].update(obs, cov, [7, 8, 900])
        estimators[1].update(obs[turn], cov[turn], np.array([7, 8, 900])[turn])
    np.testing.assert_allclose(estimators[0].trajectory, estimators[1].trajectory, atol=1e-6)


def test_same_inputs_give_the_same_bits():
    runs = []
    for _ in range(2):
        est = AdaptiveTrajectoryEstimator()
        _follow(est, _circle(70), np.random.default_rng(9))
        runs.append(est.trajectory)
    np.testing.assert_array_equal(runs[0], runs[1])


def test_misuse_is_refused():
    est = AdaptiveTrajectoryEstimator()
    with pytest.raises(DataError, match="first update"):
        est.update(*NOTHING)
    assert est.steps == 0
    one = np.zeros((1, 3)), np.eye(3)[None]
    est.update(*one)
    with pytest.raises(DataError, match=r"\(2, 3, 3\)|does not fit"):
        est.update(np.zeros((1, 3)), np.tile(np.eye(3), (2, 1, 1)))
    with pytest.raises(DataError, match="positive definite"):
        est.update(np.zeros((1, 3)), np.zeros((1, 3, 3)))
    with pytest.raises(DataError, match="once"):
        est.update(np.zeros((2, 3)), np.tile(np.eye(3), (2, 1, 1)), [1, 1])
    with pytest.raises(DataError, match="dt_s"):
        AdaptiveTrajectoryEstimator(dt_s=-1.0)
    with pytest.raises(DataError, match="horizon_s"):
        est.predict(0.1)
