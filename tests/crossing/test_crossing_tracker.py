"""Crossings and lessons from a stream of sightings."""

import numpy as np
import pytest

from camnet.estimation.crossing import CrossingTracker


def xy(x, y=0.0):
    return np.array([x, y])


def feed(tracker, events):
    """Sightings (t, x, camera) and misses (None); returns crossings and lessons in order."""
    crossings, lessons = [], []
    for event in events:
        if event is None:
            tracker.miss()
            continue
        t, x, camera = event
        crossing = tracker.sight(t, xy(x), camera)
        if crossing is not None:
            crossings.append(crossing)
        lessons.extend(tracker.lessons(crossing))
    return crossings, lessons


def test_a_gap_is_seen_unseen_seen():
    crossings, _ = feed(CrossingTracker(3, 60.0), [(0, 0, 0), (10, 12, 0), None, None, (40, 50, 2)])
    (crossing,) = crossings
    assert (crossing.exit.t_s, crossing.entry.t_s) == (10, 40)
    assert (crossing.exit.camera, crossing.entry.camera, crossing.exit.target) == (0, 2, 3)
    np.testing.assert_allclose(crossing.exit.v_world, [1.2, 0.0])
    assert crossing.before.t_s == 0


def test_no_gap_without_a_miss_or_before_the_first_sighting():
    assert feed(CrossingTracker(0, 60.0), [None, (0, 0, 0), (10, 5, 1), (20, 9, 1)])[0] == []


def test_a_recording_that_stops_ends_the_visit():
    tracker = CrossingTracker(0, 60.0)
    feed(tracker, [(0, 0, 0), None])
    tracker.leave()
    assert tracker.last is None
    assert feed(tracker, [(50, 0, 0)])[0] == []


def test_an_exit_after_one_sighting_has_no_velocity():
    crossings, _ = feed(CrossingTracker(0, 60.0), [(0, 0, 0), None, (200, 5, 0), None, (220, 9, 0)])
    np.testing.assert_allclose(crossings[1].exit.v_world, 0.0)
    assert crossings[1].before is None


def test_lessons_and_when_they_are_known():
    events = [(0, 0, 0), (10, 10, 0), None, (30, 30, 1), (40, 42, 1)]
    _, lessons = feed(CrossingTracker(0, 60.0), events)
    told = [
        (
            round(x.exit.p_world[0]),
            round(x.entry.p_world[0]),
            x.entry.t_s - x.exit.t_s,
            x.known_s,
            x.reversed,
            x.extended,
        )
        for x in lessons
    ]
    assert told == [
        (10, 30, 20, 30, False, False),
        (0, 30, 30, 30, False, True),
        (30, 10, 20, 40, True, False),
        (30, 0, 30, 40, True, True),
        (10, 42, 30, 40, False, True),
        (42, 10, 30, 40, True, True),
    ]
    backwards = lessons[2]
    np.testing.assert_allclose(backwards.exit.v_world, [-1.2, 0.0])
    assert (backwards.exit.camera, backwards.entry.camera) == (1, 0)


def test_no_lesson_is_known_before_what_it_tells():
    rng = np.random.default_rng(0)
    tracker = CrossingTracker(0, 60.0)
    positions = {}
    for k in range(400):
        if rng.random() < 0.4:
            tracker.miss()
            continue
        t = 10.0 * k
        positions[t] = rng.normal(0, 30, 2)
        for lesson in tracker.lessons(tracker.sight(t, positions[t], 0)):
            assert lesson.known_s == t
            ends = (lesson.entry.p_world, lesson.exit.p_world)
            early, late = ends if lesson.reversed else ends[::-1]
            np.testing.assert_array_equal(early, positions[lesson.exit.t_s])
            np.testing.assert_array_equal(late, positions[lesson.entry.t_s])


@pytest.mark.parametrize("gap", [2, 5])
def test_single_sightings_between_gaps_teach_the_way_back_too(gap):
    events = [(0, 0, 0), None, (20, 20, 1), None, (20 + 10 * gap, 30, 0)]
    _, lessons = feed(CrossingTracker(0, 60.0), events)
    assert [x.reversed for x in lessons] == [False, True, False]
    np.testing.assert_allclose(lessons[1].exit.v_world, [-1.0 / gap, 0.0])
