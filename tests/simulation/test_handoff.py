"""Handoffs are counted as their definition says."""

from __future__ import annotations

import numpy as np
import pytest

from camnet.simulation.handoff import HandoffTracker


def play(tracker: HandoffTracker, script: list[tuple[float, int, int]]) -> HandoffTracker:
    for t_s, region, seen_by in script:
        tracker.update(t_s, region, seen_by)
    return tracker


def test_seen_within_the_grace_time_completes() -> None:
    tracker = play(HandoffTracker(0, 2.0), [(0, 0, 0), (1, -1, -1), (5, 1, -1), (6.5, 1, 1)])
    assert (tracker.attempted, tracker.completed) == (1, 1)
    assert tracker.delays_s() == pytest.approx([1.5])
    assert (tracker.handoffs[0].from_region, tracker.handoffs[0].t_lost_s) == (0, 1)


def test_seen_at_the_instant_of_entering_has_no_delay() -> None:
    tracker = play(HandoffTracker(0, 2.0), [(0, 0, 0), (1, -1, -1), (5, 1, 1)])
    assert (tracker.completed, tracker.delays_s().tolist()) == (1, [0.0])


def test_seen_too_late_is_attempted_not_completed() -> None:
    tracker = play(HandoffTracker(0, 2.0), [(0, 0, 0), (1, -1, -1), (5, 1, -1), (7.5, 1, 1)])
    assert (tracker.attempted, tracker.completed) == (1, 0)
    assert tracker.delays_s() == pytest.approx([2.5])


def test_leaving_again_unseen_fails_and_the_next_region_is_a_new_attempt() -> None:
    script = [(0, 0, 0), (1, -1, -1), (5, 1, -1), (6, -1, -1), (9, 2, -1), (9.5, 2, 2)]
    tracker = play(HandoffTracker(0, 2.0), script)
    assert (tracker.attempted, tracker.completed) == (2, 1)
    assert np.isnan(tracker.handoffs[0].t_seen_s)


def test_coming_back_to_the_same_region_is_no_handoff() -> None:
    tracker = play(HandoffTracker(0, 2.0), [(0, 0, 0), (1, -1, -1), (3, 0, -1), (4, 0, 0)])
    assert tracker.attempted == 0


def test_crossing_a_border_while_seen_is_no_handoff() -> None:
    tracker = play(HandoffTracker(0, 2.0), [(0, 0, 0), (1, 1, 1), (2, 1, 1)])
    assert tracker.attempted == 0


def test_nothing_is_attempted_before_the_first_sighting() -> None:
    tracker = play(HandoffTracker(0, 2.0), [(0, 0, -1), (1, -1, -1), (2, 1, -1), (3, 1, 1)])
    assert tracker.attempted == 0


def test_laps_count_returns_to_the_first_region() -> None:
    tracker = HandoffTracker(0, 2.0)
    t = 0.0
    laps = []
    for region in (0, 1, 2, 0, 1, 2, 0):
        for seen_by, where in ((region, region), (-1, -1)):
            tracker.update(t, where, seen_by)
            t += 1.0
        laps.append(tracker.lap)
    assert laps == [1, 1, 1, 2, 2, 2, 3]
