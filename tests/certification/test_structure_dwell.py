"""Dwell times of agents that learn structure from their own motion: hostile errors never break a sound one."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from camnet.certification.bell_dwell import (
    MovingTargetConstants,
    landmark_off_max,
    landmark_off_max_learned,
    landmark_off_max_sound,
    moving_target_off_max,
)
from camnet.certification.structure_dwell import (
    TargetErrors,
    inscribed_radius,
    target_off_max_learned,
    target_off_max_sound,
)
from camnet.certification.structure_settings import PrintedBounds
from camnet.errors import CertificateError
from camnet.experiments.structure_stretches import point_stretches, target_stretches

FIELD = TargetErrors(
    position_m=0.05, velocity_mps=0.02, slope=None, damping=0.0, drive=0.02, speed_bound_mps=0.5,
    speed_error_mps=0.02, rate_error_radps=0.002, range_m=6.0,
)  # fmt: skip
CASES = {
    "field": (FIELD, 1.2),
    "field that diverges": (replace(FIELD, damping=0.15), 1.2),
    "acceleration": (replace(FIELD, slope=0.3, drive=0.05), 1.2),
    "acceleration, steep": (replace(FIELD, slope=1.25, damping=0.2, drive=0.01), 1.5),
    "turning": (replace(FIELD, drive=0.0, speed_error_mps=0.0, rate_error_radps=0.05), 1.2),
    "slow target": (replace(FIELD, slope=1.0, speed_bound_mps=0.02, drive=0.1), 1.2),
}


@pytest.mark.parametrize("name", CASES)
def test_hostile_targets_never_leave_before_the_sound_time(name):
    errors, margin = CASES[name]
    bound = target_off_max_sound(errors, margin).seconds
    assert bound is not None
    kept = target_stretches(np.random.default_rng(0), 100, errors, margin, 1.5 * bound, 0.3, hostile=True)
    # positions are looked at every 0.05 s, so that a stretch ends up to a step late, never early
    assert kept.min() > bound - 0.06
    drawn = target_stretches(np.random.default_rng(0), 40, errors, margin, 1.5 * bound, 0.3)
    assert np.median(drawn) > bound


def test_hostile_targets_come_near_the_sound_time():
    for name in ("field", "acceleration"):
        errors, margin = CASES[name]
        bound = target_off_max_sound(errors, margin).seconds
        kept = target_stretches(np.random.default_rng(2), 100, errors, margin, 2.0 * bound, 0.3, hostile=True)
        assert kept.min() < 1.5 * bound


@pytest.mark.parametrize("errors_mps", [(0.05, 0.0), (0.0, 0.03), (0.02, 0.01), (0.3, 0.2)])
def test_hostile_velocities_never_pass_the_sound_time_of_landmarks(errors_mps):
    low, high, distance = 0.05, 0.4, 5.0
    bound = landmark_off_max_sound(low, high, *errors_mps, distance).seconds
    for hostile in (True, False):
        found = point_stretches(
            np.random.default_rng(3), 100, bound, errors_mps, distance, low, 0.5, hostile=hostile
        )
        assert found.error_m[:, 0].max() <= low + 1e-12
        assert found.error_m.max() <= high * (1.0 + 1e-3)
        if hostile and errors_mps[1] == 0.0:  # rate errors turn points, and hardly move them away
            assert found.error_m.max() > 0.3 * high


def test_the_published_landmark_time_is_no_bound_where_velocities_err():
    """A slow camera with a bad speed sensor: by print it may be out of view for long."""
    low, high = 0.05, 0.4
    published = landmark_off_max(low, high, 0.05).seconds
    found = point_stretches(np.random.default_rng(0), 50, published, (0.3, 0.0), 5.0, low, 0.05, hostile=True)
    assert found.error_m.max() > 1.2 * high
    sound = landmark_off_max_sound(low, high, 0.3, 0.0, 5.0).seconds
    assert sound < published


def test_errors_grow_as_the_differential_inequalities_say():
    errors = replace(FIELD, slope=0.4, damping=0.1, drive=0.03)

    def rate(t, x):
        return [x[1], 0.4 * x[0] + 0.1 * x[1] + 0.03, 0.02 + 0.002 * 6.0 + 0.5 * 0.002 * t]

    for t in (0.5, 2.0, 4.0):
        x = solve_ivp(rate, (0.0, t), [0.05, 0.02, 0.0], rtol=1e-10, atol=1e-12).y[:, -1]
        expected = min(x[0], 0.05 + 2.0 * 0.5 * t) + x[2]
        assert errors.after(t) == pytest.approx(expected, rel=1e-8)
    assert errors.after(1e6) < 1e13  # the cap, where the exponential would overflow
    bound = target_off_max_sound(errors, 1.0).seconds
    assert errors.after(bound) <= 1.0 < errors.after(bound + 0.01)


def test_times_of_the_restated_example():
    """A velocity field in a room of 1.47 m: 57 s and 26 s with 5 mm/s of the camera's own."""
    for drive, seconds in ((0.02, 57.0), (0.05, 26.0)):
        e = replace(FIELD, drive=drive, speed_error_mps=0.005, rate_error_radps=0.0)
        assert target_off_max_sound(e, 1.47).seconds == pytest.approx(seconds, abs=0.5)


def test_the_inscribed_ball_lies_in_the_view_and_the_printed_one_does_not():
    d, psi = 8.0, math.radians(25.0)
    radius = inscribed_radius(d, psi)
    centre = d - radius
    points = np.random.default_rng(0).standard_normal((2000, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)

    def inside(p: np.ndarray) -> np.ndarray:
        away = np.linalg.norm(p, axis=1)
        return (away <= d + 1e-9) & (p[:, 2] >= math.cos(psi) * away - 1e-9)

    assert inside([0.0, 0.0, centre] + radius * points).all()
    assert not inside([0.0, 0.0, centre] + 1.02 * radius * points).all()
    assert not inside([0.0, 0.0, d] + d * math.sin(psi) * points).all()


def test_repaired_constants_drop_the_cameras_turning_and_count_the_stack():
    bounds = PrintedBounds().model_dump()
    noise = bounds.pop("velocity_noise")
    printed = MovingTargetConstants.from_bounds(**bounds)
    repaired = MovingTargetConstants.from_bounds(**bounds, repaired=True, velocity_noise=noise)
    assert repaired.c1 <= printed.c1
    assert repaired.c5 <= printed.c5
    assert repaired.c2 > printed.c2
    assert repaired.c2_seen == printed.c2
    turning = MovingTargetConstants.from_bounds(**{**bounds, "camera_rate_radps": 50.0}, repaired=True)
    still = MovingTargetConstants.from_bounds(**{**bounds, "camera_rate_radps": 0.0}, repaired=True)
    assert turning == still
    for constants in (printed, repaired):  # the floor is above any level
        assert moving_target_off_max(constants, 15.0, 1.47).seconds is None


def test_learned_times_hold_for_a_share():
    kept = np.random.default_rng(0).uniform(5.0, 9.0, 100)
    assert target_off_max_learned(kept.tolist()).seconds == kept.min()
    assert "59 are needed" in str(target_off_max_learned(kept[:20].tolist()).reason)
    growths = np.random.default_rng(0).uniform(-0.1, 0.2, 80)
    assert landmark_off_max_learned(0.1, 0.5, growths.tolist()).seconds == pytest.approx(0.4 / growths.max())


@pytest.mark.parametrize("value", [-1.0, math.nan, math.inf])
def test_bounds_that_are_none_are_refused(value):
    for name in ("position_m", "drive", "rate_error_radps", "range_m"):
        with pytest.raises(CertificateError, match=name):
            replace(FIELD, **{name: value})
    with pytest.raises(CertificateError, match="range_m"):
        inscribed_radius(value, 0.4)
    with pytest.raises(CertificateError, match="kept_s"):
        target_off_max_learned([1.0, value])
    with pytest.raises(CertificateError, match="half_angle"):
        inscribed_radius(5.0, 2.0)
    if not math.isfinite(value):
        with pytest.raises(CertificateError, match="margin_m"):
            target_off_max_sound(FIELD, value)
    assert target_off_max_sound(FIELD, 0.05).seconds is None
