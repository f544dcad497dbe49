"""The monitor against a plain reconstruction of the switching signals, and the network's report."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from camnet.certification.constants import EstimatorBounds
from camnet.certification.intervals import GapCertificate
from camnet.certification.monitor import DwellMonitor
from camnet.certification.network import (
    NetworkGap,
    certify_dwell,
    default_levels,
    dwell_report,
    estimator_bounds,
    pose_rate_bound,
    working_radius,
)
from camnet.certification.settings import CertificateSettings
from camnet.errors import CertificateError

BOUNDS = EstimatorBounds(
    k=3.0, kcl=1.0, gamma_inv_min=1.0, gamma_inv_max=1.0, alpha=1.0, window_s=0.1, stack_size=600, eps_bar=0.001,
    etadot_max=0.25, sigma_bar=3.0, weight_bound=0.2, lambda_min_psi=1.0,
)  # fmt: skip
PAIR = certify_dwell(BOUNDS, 2.0, mobile=True)


def monitor(n=3):
    return DwellMonitor(n, PAIR.published, PAIR.sound)


def run(spans, dt=0.05):
    """``spans``: (duration, region or -1, excited from this time in the span or None)."""
    m, t = monitor(), 0.0
    for duration, region, excited_from in spans:
        for i in range(round(duration / dt)):
            excited = excited_from is not None and i * dt >= excited_from - 1e-9
            m.update(t, region, region >= 0, excited)
            t += dt
    m.close()
    return m


def test_switching_signals_of_a_tour():
    m = run(
        [(1, -1, None), (4, 0, 2.0), (3, -1, None), (2, 1, None), (1, -1, None), (3, 0, 0.0), (0.5, -1, None)]
    )
    kinds = [(i.seen, i.region, i.d, i.h) for i in m.intervals]
    assert kinds == [
        (True, 0, True, False),
        (False, 0, True, False),
        (True, 1, False, False),
        (False, 1, False, False),
        (True, 0, True, True),
        (False, 0, True, True),
    ]
    assert [round(i.duration_s, 6) for i in m.intervals] == pytest.approx([4, 3, 2, 1, 3, 0.45], abs=1e-6)
    assert m.intervals[0].excited_at_s == pytest.approx(3.0)
    assert m.summary()["excited_at_s"] == [pytest.approx(3.0), None, None]


def test_violations_are_counted_per_certificate():
    limit_p = PAIR.published.off_max(6, 4, d=True, h=False).seconds
    limit_s = PAIR.sound.off_max(6, 4, d=True, h=False).seconds
    assert limit_s < limit_p
    between = round(0.5 * (limit_s + limit_p), 1)
    m = run([(6, 0, 2.0), (between, -1, None), (6, 1, 2.0)])
    off = m.intervals[1]
    assert (off.published.status, off.sound.status) == ("met", "violated")
    assert off.sound.limit_s == pytest.approx(limit_s)
    assert m.summary()["violations"] == 1
    assert m.summary()["sound"] == {"met": 2, "violated": 1, "impossible": 0, "open": 0, "broken": 0}


def test_a_short_visit_violates_and_an_unfinished_one_does_not():
    short = 0.5 * PAIR.sound.on_min(h=False).seconds
    m = run([(6, 0, None), (0.1, -1, None), (round(short, 1), 1, None), (0.1, -1, None)], dt=0.05)
    assert m.intervals[2].sound.status == "violated"
    m = run([(6, 0, None), (0.1, -1, None), (round(short, 1), 1, None)], dt=0.05)
    assert m.intervals[2].sound.status == "open"


def test_a_counterexample_is_reported_as_broken():
    m = monitor()
    for t in np.arange(0, 6, 0.05):
        m.update(float(t), 0, True, True, 0.01)
    m.update(6.0, -1, False, False, 2.5)  # an error beyond R = 2 m at once, within the certified time
    assert m.off_time_left_s(6.0) == pytest.approx(
        PAIR.sound.off_max(6, 6, d=True, h=False).seconds, rel=1e-9
    )
    m.update(6.05, 1, True, False, 0.1)
    m.close()
    assert m.intervals[1].sound.broken
    assert m.summary()["broken"] == 2


def test_margin_is_what_the_comparison_system_leaves_of_the_radius():
    m = monitor()
    for t in np.arange(0, 6, 0.05):
        m.update(float(t), 0, True, True, 0.01)
    m.update(6.0, -1, False, False, 0.01)
    c, level = PAIR.sound.constants, PAIR.sound.exit_level(6.0, 6.0, d=True, h=False)
    v, dt = level, 1e-5
    for _ in range(5000):  # V' = lambda_G V + c3, integrated
        v += dt * (c.lambda_g * v + c.c3)
    now = m.certificate(6.05)
    assert now.margin_m == pytest.approx(2.0 - math.sqrt(2 * v), abs=1e-4)
    assert now.time_left_s == pytest.approx(m.off_time_left_s(6.0) - 0.05)
    # at the end of the time allowed nothing is left
    assert m.certificate(6.0 + m.off_time_left_s(6.0)).margin_m == pytest.approx(0.0, abs=1e-9)
    m.update(6.05, 1, True, False)
    assert m.certificate(6.05) == GapCertificate(True, None, None, 0)


def test_excitation_that_ends_closes_the_excited_cases():
    m = monitor()
    for t in np.arange(0, 6, 0.05):
        m.update(float(t), 0, True, t < 5.0)
    m.update(6.0, -1, False, False)
    m.update(6.05, 0, True, True)
    m.update(6.10, -1, False, False)
    off = m.intervals[1]
    for check, bounds in ((off.published, PAIR.published), (off.sound, PAIR.sound)):
        assert check.limit_s == bounds.off_max(6.0, 0.0, d=False, h=False).seconds
    assert (off.d, off.h) == (False, False)
    assert not m.intervals[2].h  # the earlier visit ended without it


def test_stated_dwell_time_is_watched(caplog):
    m = DwellMonitor(1, PAIR.published, PAIR.sound, name="van", stated_off_s=1.0)
    m.update(0.0, 0, True, False)
    for t in np.arange(0.1, 2.0, 0.1):
        m.update(float(t), -1, False, False)
    assert m.overdue == 1
    assert [r.levelname for r in caplog.records] == ["ERROR"]
    assert "van: out of view since 0.10 s" in caplog.text


def test_direct_passage_between_touching_regions_closes_the_visit():
    m = run([(2, 0, None), (2, 1, None)])
    assert [(i.seen, i.region) for i in m.intervals] == [(True, 0), (True, 1)]


@given(st.lists(st.tuples(st.integers(1, 30), st.integers(-1, 2), st.booleans()), min_size=1, max_size=25))
@settings(max_examples=100, deadline=None)
def test_intervals_tile_the_time_from_first_sighting(spans):
    m, t, first = monitor(), 0.0, None
    for count, region, excited in spans:
        for _ in range(count):
            if first is None and region >= 0:
                first = t
            m.update(t, region, region >= 0, excited)
            last = t
            t += 0.1
    m.close()
    if first is None:
        assert m.intervals == []
        return
    assert m.intervals[0].start_s == first
    assert m.intervals[-1].end_s == last
    for a, b in zip(m.intervals, m.intervals[1:], strict=False):
        assert a.end_s == b.start_s
        assert a.seen or b.seen


def test_misuse_is_refused():
    with pytest.raises(CertificateError, match="region"):
        monitor().update(0.0, -1, True, False)
    with pytest.raises(CertificateError, match="n_regions"):
        monitor(0)


# ---- the report


def test_working_radius_against_the_ball_in_a_pyramid():
    half_w, half_h = 0.5, 0.4
    r = working_radius((half_w, half_h), 4.0, 0.2, 10.0, 0.0)
    side = np.array([0.0, math.cos(half_h), -math.sin(half_h)])  # outward normal of the lower side
    assert r == pytest.approx(-side @ np.array([0, 0, 4.0]), rel=1e-12)
    assert working_radius((1.2, 1.2), 4.0, 3.5, 10.0, 0.1) == pytest.approx(0.4)
    with pytest.raises(CertificateError, match="extent"):
        working_radius((0.1, 0.1), 1.0, 0.2, 10.0, 0.5)
    with pytest.raises(CertificateError, match="working range"):
        working_radius((0.1, 0.1), 11.0, 0.2, 10.0, 0.1)


def test_default_levels_leave_room_on_both_sides():
    for certificate in (PAIR.published, PAIR.sound):
        c = certificate.constants
        v_hi, v_lo = default_levels(c, 2.0, None)
        assert v_hi == 2.0
        assert c.beta1 < v_lo < v_hi
        assert default_levels(c, 2.0, 0.7) == (2.0, 0.7)


def report(mobile, **changes):
    bounds = estimator_bounds(
        CertificateSettings(**changes), k=3, kcl=1, gamma=1, alpha=1, window_s=0.1, stack_size=600, excitation=1.0,
        weight_bound=0.3, kernel_spacing_m=0.3, kernel_width_m=0.55, v_max_mps=0.25, w_max_radps=0.5,
        switching="tanh", switching_gain=0.1, boundary_layer=0.05,
    )  # fmt: skip
    certificates = certify_dwell(bounds, 2.0, mobile=mobile)
    return dwell_report(certificates, v_max_mps=0.25, extent_m=0.2, gaps=[NetworkGap("a", "b", 3.0)])


def test_report_of_a_stationary_network_says_unsatisfiable_with_the_numbers():
    r = report(False, eps_bar=0.001)
    assert r["published"]["verdict"] == "unsatisfiable"
    assert "3 m outside" in r["published"]["reason"]
    assert r["sound"]["verdict"] == "conditional"
    assert r["gaps"][0]["published"]["verdict"] == "unsatisfiable"
    assert "NaN" not in json.dumps(r, allow_nan=False)


def test_report_of_a_mobile_network_gives_times():
    r = report(True, eps_bar=0.001)
    assert r["published"]["verdict"] == "conditional"
    assert r["gaps"] == []
    times = r["published"]["off_max_s"]
    assert times["excited_before"]["seconds"] > times["not_excited"]["seconds"]
    assert r["sound"]["off_max_s"]["excited_before"]["seconds"] < times["excited_before"]["seconds"]


def test_hopeless_bounds_are_reported_not_raised():
    r = report(True, weight_bound=20.0, eps_bar=0.1)
    assert r["sound"]["verdict"] == "unsatisfiable"
    assert "floor" in r["sound"]["reason"]
    json.dumps(r, allow_nan=False)


def test_settings_override_the_derived_bounds():
    chosen = CertificateSettings(etadot_max=0.9, sigma_bar=2.0, weight_bound=1.5)
    b = estimator_bounds(
        chosen, k=3, kcl=1, gamma=4, alpha=1, window_s=0.1,
        stack_size=600, excitation=1.0, weight_bound=0.3, kernel_spacing_m=0.3, kernel_width_m=0.55, v_max_mps=0.25,
        w_max_radps=0.5,
    )  # fmt: skip
    assert (b.etadot_max, b.sigma_bar, b.weight_bound, b.gamma_inv_max) == (0.9, 2.0, 1.5, 0.25)
    assert pose_rate_bound(0.3, 0.8) == pytest.approx(0.5)
