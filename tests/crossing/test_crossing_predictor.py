"""The learned predictor on planted worlds whose answer is known, and what it must not know."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from camnet.errors import DataError
from camnet.estimation.crossing import CrossingPredictor, CrossingSettings, Lesson, Sighting

PLAIN = CrossingSettings(prior_distance=None)


def sighting(t, p, v=(0.0, 0.0), camera=0, target=0):
    return Sighting(float(t), np.array(p, dtype=float), np.array(v, dtype=float), camera, target)


def lesson(t, start, end, duration, v=(0.0, 0.0), cameras=(0, 1), target=0, **changes):
    exit_ = sighting(t, start, v, cameras[0], target)
    entry = sighting(t + duration, end, camera=cameras[1], target=target)
    return Lesson(exit_, entry, known_s=t + duration, **changes)


def corridors(predictor, rng, count=200, noise=0.5):
    """Two corridors from one door: who walks east comes out at A (camera 1), who walks north at B (camera 2)."""
    t = 0.0
    for k in range(count):
        east = k % 2 == 0
        v = np.array([1.2, 0.0] if east else [0.0, 1.2]) + rng.normal(0.0, 0.05, 2)
        end = np.array([50.0, 10.0] if east else [-10.0, 60.0]) + rng.normal(0.0, noise, 2)
        duration = 40.0 + rng.normal(0.0, 2.0)
        start = rng.normal(0.0, noise, 2)
        predictor.learn(lesson(t, start, end, duration, v, (0, 1 if east else 2), target=k % 7))
        t += 60.0
    return t


def test_each_corridor_is_told_by_the_exit_velocity():
    predictor = CrossingPredictor(PLAIN, 3)
    t = corridors(predictor, np.random.default_rng(0))
    for v, end, camera in (((1.2, 0.0), (50, 10), 1), ((0.0, 1.2), (-10, 60), 2)):
        prediction = predictor.predict(sighting(t, (0, 0), v, target=99), t + 40.0)
        np.testing.assert_allclose(prediction.p_world, end, atol=1.0)
        assert prediction.next_camera[camera] > 0.99
        assert predictor.next_camera(sighting(t, (0, 0), v, target=99))[camera] > 0.99
        assert prediction.support > 5.0


def test_the_place_depends_on_the_time_taken():
    predictor = CrossingPredictor(PLAIN, 3)
    for k in range(60):
        predictor.learn(lesson(200.0 * k, (0, 0), (20, 0), 20.0, cameras=(0, 1)))
        predictor.learn(lesson(200.0 * k + 50, (0, 0), (90, 0), 100.0, cameras=(0, 2)))
    exit_ = sighting(20_000.0, (0, 0))
    near, far = predictor.predict(exit_, 20_020.0), predictor.predict(exit_, 20_100.0)
    np.testing.assert_allclose(near.p_world, [20, 0], atol=0.1)
    np.testing.assert_allclose(far.p_world, [90, 0], atol=0.1)
    assert (near.next_camera.argmax(), far.next_camera.argmax()) == (1, 2)


def test_an_untaught_predictor_answers_with_the_fading_exit_velocity():
    predictor = CrossingPredictor(CrossingSettings(prior_memory_s=20.0), 4)
    prediction = predictor.predict(sighting(100, (5, 5), (1.0, 0.0), camera=3), 130.0)
    np.testing.assert_allclose(prediction.p_world, [5.0 + 20.0 * (1.0 - math.exp(-1.5)), 5.0])
    np.testing.assert_array_equal(prediction.next_camera, [0, 0, 0, 1])
    assert prediction.support == 0.0
    assert prediction.radius_m == math.inf
    assert predictor.next_camera(sighting(0, (0, 0), camera=2))[2] == 1.0


def test_what_becomes_known_after_the_exit_changes_nothing():
    rng = np.random.default_rng(1)
    taught, more = CrossingPredictor(CrossingSettings(), 3), CrossingPredictor(CrossingSettings(), 3)
    t = corridors(taught, rng)
    corridors(more, np.random.default_rng(1))
    exit_ = sighting(t, (0.3, 0.1), (1.0, 0.4))
    more.learn(
        lesson(t - 30.0, (0.3, 0.1), (500.0, 500.0), 30.0, (1.0, 0.4), target=0)
    )  # known at the exit itself
    more.learn(lesson(t - 30.0, (0.3, 0.1), (500.0, 500.0), 50.0, (1.0, 0.4), target=0))
    a, b = taught.predict(exit_, t + 40.0), more.predict(exit_, t + 40.0)
    np.testing.assert_array_equal(a.p_world, b.p_world)
    np.testing.assert_array_equal(a.next_camera, b.next_camera)
    assert a.radius_m == b.radius_m
    np.testing.assert_array_equal(taught.next_camera(exit_), more.next_camera(exit_))


def test_with_information_now_later_lessons_count_until_the_time_asked_for():
    settings = PLAIN.model_copy(update={"information": "now"})
    predictor = CrossingPredictor(settings, 2)
    predictor.learn(lesson(0.0, (0, 0), (10, 0), 30.0))
    predictor.learn(lesson(90.0, (0, 0), (80, 0), 30.0, target=5))
    exit_ = sighting(100.0, (0, 0), target=5)
    np.testing.assert_allclose(predictor.predict(exit_, 120.0).p_world, [10, 0], atol=1e-6)
    np.testing.assert_allclose(predictor.predict(exit_, 130.0).p_world, [80, 0], atol=1.0)


def test_lessons_out_of_order_are_refused():
    predictor = CrossingPredictor(CrossingSettings(), 2)
    predictor.learn(lesson(100.0, (0, 0), (10, 0), 30.0))
    with pytest.raises(DataError, match=r"known at 90\.0 s follows one known at 130\.0"):
        predictor.learn(lesson(60.0, (0, 0), (10, 0), 30.0))


def test_switched_off_lessons_are_not_learned():
    predictor = CrossingPredictor(CrossingSettings(learn_reversed=False, learn_extended=False), 2)
    predictor.learn(lesson(0.0, (0, 0), (10, 0), 30.0, reversed=True))
    predictor.learn(lesson(0.0, (0, 0), (10, 0), 30.0, extended=True))
    assert predictor.lessons == 0


def test_the_way_back_is_learned_from_the_way_there():
    predictor = CrossingPredictor(PLAIN, 2)
    for k in range(20):
        there = lesson(100.0 * k, (0, 0), (40, 0), 30.0, (1.3, 0.0))
        predictor.learn(there)
        back = Lesson(
            sighting(there.exit.t_s, (40, 0), (-1.3, 0.0), camera=1),
            sighting(there.entry.t_s, (0, 0), camera=0),
            there.known_s,
            reversed=True,
        )
        predictor.learn(back)
    prediction = predictor.predict(sighting(5000.0, (40, 0), (-1.3, 0), camera=1), 5030.0)
    np.testing.assert_allclose(prediction.p_world, [0, 0], atol=0.5)
    assert prediction.next_camera.argmax() == 0


@given(st.floats(-300.0, 300.0), st.floats(-300.0, 300.0), st.integers(0, 50))
def test_moving_the_world_moves_the_prediction(dx, dy, seed):
    rng = np.random.default_rng(seed)
    shift = np.array([dx, dy])
    here, there = CrossingPredictor(CrossingSettings(), 2), CrossingPredictor(CrossingSettings(), 2)
    for k in range(12):
        start, end, v = rng.normal(0, 5, 2), rng.normal(40, 5, 2), rng.normal(0, 1, 2)
        here.learn(lesson(100.0 * k, start, end, 40.0, v))
        there.learn(lesson(100.0 * k, start + shift, end + shift, 40.0, v))
    exit_, p = sighting(5000.0, (0, 0), (1, 0)), np.zeros(2)
    moved = sighting(5000.0, p + shift, (1, 0))
    np.testing.assert_allclose(
        there.predict(moved, 5040.0).p_world - shift, here.predict(exit_, 5040.0).p_world, atol=0.05
    )


@pytest.mark.parametrize("location", ["mode", "geometric_median", "mean"])
def test_every_location_answers_a_single_lesson_with_its_vote(location):
    predictor = CrossingPredictor(PLAIN.model_copy(update={"location": location, "carry": 0.25}), 2)
    predictor.learn(lesson(0.0, (0, 0), (30, 0), 20.0))
    prediction = predictor.predict(sighting(100.0, (4, 8)), 120.0)
    np.testing.assert_allclose(prediction.p_world, [31, 2])


def test_the_radius_holds_the_stated_share_of_later_entries():
    rng = np.random.default_rng(3)
    predictor = CrossingPredictor(CrossingSettings(coverage=0.8, prior_distance=None), 3)
    t = corridors(predictor, rng, count=400, noise=6.0)
    inside = []
    for k in range(300):
        east = k % 2 == 0
        end = np.array([50.0, 10.0] if east else [-10.0, 60.0]) + rng.normal(0.0, 6.0, 2)
        exit_ = sighting(t, rng.normal(0.0, 6.0, 2), (1.2, 0) if east else (0, 1.2), target=50)
        prediction = predictor.predict(exit_, t + 40.0)
        inside.append(np.hypot(*(prediction.p_world - end)) <= prediction.radius_m)
    assert abs(np.mean(inside) - 0.8) < 0.07  # binomial standard deviation 0.023
