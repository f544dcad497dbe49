"""Theorem 3.1: no disjoint network meets it; an occlusion inside one view can."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from camnet.certification.verdict import ball_radius, occlusion_verdict, theorem_31
from camnet.errors import CertificateError


def frustum(position, rotation, half_w, half_h, near, far):
    """Half-spaces A x <= b (unit normals) of a pinhole view; columns of ``rotation``: right, down, forward."""
    cw, sw, ch, sh = math.cos(half_w), math.sin(half_w), math.cos(half_h), math.sin(half_h)
    normals_cam = np.array(
        [[cw, 0, -sw], [-cw, 0, -sw], [0, ch, -sh], [0, -ch, -sh], [0, 0, -1], [0, 0, 1]], float
    )
    offsets = np.array([0, 0, 0, 0, -near, far], float)
    normals = normals_cam @ rotation.T
    return normals, offsets + normals @ position


def depth(halfspaces, points):
    """Distance of points from the outside (negative: a lower bound of how far outside)."""
    normals, offsets = halfspaces
    return (offsets - points @ normals.T).min(axis=1)


def random_rotation(rng):
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q *= np.sign(np.diag(r))
    return q if np.linalg.det(q) > 0 else q @ np.diag([1, 1, -1])


@given(st.integers(0, 2**32 - 1), st.floats(0.05, 5.0), st.floats(0.0, 3.0), st.floats(0.0, 0.5))
@settings(max_examples=150, deadline=None)
def test_no_disjoint_network_satisfies_theorem_31(seed, v_max, on_min, extent):
    """Random layouts, random and straight-at-the-target predictors: the ball never fits another view."""
    rng = np.random.default_rng(seed)
    far = rng.uniform(2, 12)
    views = [
        frustum(
            rng.uniform(-25, 25, 3), random_rotation(rng), *rng.uniform(0.2, 0.9, 2), rng.uniform(0.1, 1), far
        )
        for _ in range(5)
    ]
    start = rng.uniform(-25, 25, 3)
    outside = [view for view in views if depth(view, start[None])[0] <= 0.0]
    tau = np.linspace(0.0, 60.0 / v_max, 121)
    for view in outside:
        inward = -view[0][int(np.argmin(view[1] - view[0] @ start))]  # straight into the nearest face
        for direction in (inward, rng.normal(size=3)):
            path = start + v_max * tau[:, None] * direction / np.linalg.norm(direction)
            gap = max(0.0, -float(depth(view, start[None])[0]))
            verdict = theorem_31(gap, v_max, on_min, extent)
            assert verdict.verdict == "unsatisfiable"
            spare = depth(view, path) - np.array([ball_radius(v_max, t, verdict.beta_m) for t in tau])
            assert spare.max() <= -verdict.shortfall_m + 1e-9
            if verdict.beta_m > 1e-9:
                assert spare.max() < 0.0


def test_the_shortfall_is_attained_at_the_moment_of_loss():
    view = frustum(np.zeros(3), np.eye(3), 0.5, 0.5, 1.0, 9.0)
    start = np.array([0.0, 0.0, 0.4])  # 0.6 m in front of the near plane
    verdict = theorem_31(0.6, 0.25, 2.0, 0.1)
    assert verdict.beta_m == pytest.approx(0.6)
    assert depth(view, start[None])[0] - verdict.beta_m == pytest.approx(-verdict.shortfall_m)
    assert "0.6 m outside" in verdict.reason


def test_an_occlusion_inside_one_view_can_be_certified():
    view = frustum(np.zeros(3), np.eye(3), 0.6, 0.6, 1.0, 9.0)
    start = np.array([[0.0, 0.0, 5.0]])
    d = float(depth(view, start)[0])
    verdict = occlusion_verdict(d, 0.25, 2.0, 0.1)
    assert verdict.verdict == "certified"
    rng = np.random.default_rng(0)
    for tau in np.linspace(0, verdict.horizon_s, 20):
        step = rng.normal(size=(50, 3))
        ends = start + 0.25 * tau * step / np.linalg.norm(step, axis=1, keepdims=True)
        assert (depth(view, ends) >= ball_radius(0.25, tau, verdict.beta_m) - 1e-12).all()
    tight = occlusion_verdict(0.5, 0.25, 2.0, 0.1)
    assert (tight.verdict, tight.shortfall_m) == ("not certified", pytest.approx(0.1))


def test_no_dwell_time_in_view_means_an_endless_ball():
    assert theorem_31(1.0, 0.25, None, 0.1).beta_m == math.inf
    assert occlusion_verdict(5.0, 0.25, None, 0.1).verdict == "not certified"


def test_overlapping_views_are_refused():
    with pytest.raises(CertificateError, match="gap_m"):
        theorem_31(-0.1, 0.25, 1.0, 0.1)
