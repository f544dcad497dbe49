"""A stationary layout that ``learned`` certifies, confirmed by hostile simulation, and lost when a camera is moved."""

from __future__ import annotations

import json

import numpy as np
import pytest

from camnet.certification.benchmark import nadir_views
from camnet.certification.flow_network import FlowTargetClass, certify_flow, flow_exits
from camnet.certification.free_network import ground_views
from camnet.certification.growth import PlanarField
from camnet.errors import CertificateError

RADIUS, SPEED, EXTENT = 4.0, 0.4, 0.2
TARGET = FlowTargetClass(v_max_mps=0.6, model_error_mps=0.02, e0_m=0.05, spread_m=0.1)


def ring_field():
    axis = np.arange(-5.4, 5.41, 0.6)
    centres = np.stack(np.meshgrid(axis, axis), -1).reshape(-1, 2)
    centres = centres[np.abs(np.hypot(*centres.T) - RADIUS) < 1.5]
    angle, r = np.random.default_rng(0).uniform([0, RADIUS - 1], [2 * np.pi, RADIUS + 1], (4000, 2)).T
    x = np.c_[r * np.cos(angle), r * np.sin(angle)]
    e_r = x / r[:, None]
    v = SPEED * np.c_[-e_r[:, 1], e_r[:, 0]] - 0.25 * (r - RADIUS)[:, None] * e_r
    sig = np.exp(-0.5 * ((x[:, None] - centres) ** 2).sum(-1) / 0.7**2)
    return PlanarField.create(
        centres, 1 / 0.7**2, np.linalg.solve(sig.T @ sig + 1e-2 * np.eye(len(centres)), sig.T @ v)
    )


def layout(shift=0.0):
    angle = np.array([0.0, 120.0, 240.0]) * np.pi / 180
    places = RADIUS * np.c_[np.cos(angle), np.sin(angle)]
    places[1] *= 1.0 + shift / RADIUS
    return ground_views(nadir_views(places, 6.0, 4.0), ["a", "b", "c"], 0.0, EXTENT)


@pytest.fixture(scope="module")
def field():
    return ring_field()


def certify(field, ground, **changes):
    return certify_flow(
        field, ground, TARGET, [RADIUS, 0.0], 70.0, 20.0, on_min_s=1.0, step_s=0.25, cover_m=0.2, **changes
    )


def test_exits_of_the_ring(field):
    exits = flow_exits(field, layout(), [RADIUS, 0.0], 200.0)
    assert [e.view for e in exits] == [0, 1, 2]
    with pytest.raises(CertificateError, match="stops"):
        flow_exits(field, layout(), [50.0, 0.0], 10.0)


def hostile_lap(field, ground, rng, runs, seconds=40.0, h=0.04):
    """Longest time out of every view over runs that push outward, inward, ahead or back with all the model error."""
    p = np.array([RADIUS, 0.0]) + rng.uniform(-1, 1, (runs, 2)) * 0.05
    unseen, worst, lost = np.zeros(runs), np.zeros(runs), np.zeros(runs, dtype=bool)
    mode = rng.integers(0, 5, runs)
    for i in range(round(seconds / h)):
        v = field.velocity(p)
        ahead = v / np.maximum(np.linalg.norm(v, axis=1, keepdims=True), 1e-9)
        side = np.c_[-ahead[:, 1], ahead[:, 0]]
        if i % 50 == 0:
            mode = np.where(rng.random(runs) < 0.3, rng.integers(0, 5, runs), mode)
        push = np.select([mode[:, None] == k for k in range(4)], [ahead, -ahead, side, -side], 0.0)
        middle = field.velocity(p + 0.5 * h * v)
        p = p + h * (middle + TARGET.model_error_mps * push)
        seen = np.any([g.view.depth(p) >= 0 for g in ground], axis=0)
        unseen = np.where(seen, 0.0, unseen + h)
        worst = np.maximum(worst, unseen)
    lost |= unseen > 30
    return worst, lost


def gap_by_hand():
    """The ring leaves the first square through its upper side; the second square is straight to the left from there."""
    half = 2.0 - EXTENT / np.cos(np.arctan2(2.0, 6.0))
    return np.sqrt(RADIUS**2 - half**2) - (-0.5 * RADIUS + half)


def test_certified_layout_is_confirmed_by_hostile_targets(field):
    ground = layout()
    report = certify(field, ground, find_largest=False)
    assert report["certificates"]["learned"]["verdict"] == "certified"
    assert report["transitions"][0]["gap_m"] == pytest.approx(gap_by_hand(), abs=0.03)
    assert [(t["from"], t["to"]) for t in report["transitions"]] == [("a", "b"), ("b", "c"), ("c", "a")]
    json.dumps(report, allow_nan=False)
    latest = max(t["learned"]["seen_again_s"] for t in report["transitions"])
    worst, lost = hostile_lap(field, ground, np.random.default_rng(3), 40)
    assert not lost.any()
    assert worst.max() <= latest
    assert worst.max() > 0.5 * latest  # the bound is not vacuous


@pytest.mark.slow
def test_a_hundred_runs_lose_no_target(field):
    worst, lost = hostile_lap(field, layout(), np.random.default_rng(8), 100, seconds=150.0, h=0.02)
    assert not lost.any()
    assert worst.max() < 20.0


def test_moving_one_camera_takes_the_certificate_away_and_the_target_is_missed(field):
    moved = layout(shift=2.4)
    report = certify(field, moved, find_largest=False)
    assert report["certificates"]["learned"]["verdict"] == "not certified"
    worst, _ = hostile_lap(field, moved, np.random.default_rng(3), 20)
    assert worst.max() > 20.0


@pytest.mark.slow
def test_largest_model_error_is_the_border_of_the_verdict(field):
    ground = layout()
    first = certify(field, ground)["transitions"][0]["learned"]
    limit = first["largest_model_error_mps"]
    assert limit > TARGET.model_error_mps
    for e_v, verdict in ((0.9 * limit, "certified"), (1.1 * limit, "not certified")):
        target = FlowTargetClass(0.6, e_v, 0.05, 0.1)
        report = certify_flow(
            field,
            ground,
            target,
            [RADIUS, 0.0],
            12.0,
            20.0,
            on_min_s=1.0,
            step_s=0.25,
            cover_m=0.2,
            find_largest=False,
        )
        assert report["transitions"][0]["learned"]["verdict"] == verdict
