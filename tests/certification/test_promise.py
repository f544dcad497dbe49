"""The longest unseen way by brute force, sight lines against PyBullet's rays, and the promise as a record."""

from __future__ import annotations

import itertools
import json
import math
from dataclasses import replace

import numpy as np
import pytest

from camnet.certification.constants import EstimatorBounds
from camnet.certification.constants import sound as sound_constants
from camnet.certification.coverage import Views
from camnet.certification.dwell import DwellBounds
from camnet.certification.planar_shapes import convex_solids
from camnet.certification.premises import contradictions
from camnet.certification.promise import BlindCamera, Promise, UnseenWay, join_promises
from camnet.certification.sight_lines import Solids, seen_by, sight_blocked
from camnet.certification.site import views_of
from camnet.certification.unseen import SeenArcs, longest_unseen
from camnet.geometry.frustum import Frustum
from camnet.geometry.regions import build_region
from camnet.geometry.rotations import look_at
from camnet.geometry.settings import Box, CameraModel, Cylinder, Intrinsics


def random_graph(rng):
    """Arcs with random successors and random seen stretches."""
    n = int(rng.integers(3, 8))
    length = rng.uniform(1.0, 5.0, n)
    after = [sorted(rng.choice(n, size=rng.integers(0, 3), replace=False).tolist()) for _ in range(n)]
    arc, start, end = [], [], []
    for a in range(n):
        cuts = np.sort(rng.uniform(0.0, length[a], 2 * int(rng.integers(0, 3))))
        for k in range(0, len(cuts), 2):
            arc.append(a), start.append(cuts[k]), end.append(cuts[k + 1])
    camera = np.arange(len(arc))
    entries = rng.random(n) < 0.5
    entries[0] = True
    ptr = np.cumsum([0, *(len(x) for x in after)])
    flat = np.array([b for x in after for b in x], dtype=int)
    arcs = SeenArcs(
        length,
        ptr,
        flat,
        np.array(arc, dtype=int),
        np.array(start),
        np.array(end),
        camera,
        camera,
        entries,
        False,
    )
    return arcs, after


def longest_by_walks(x, after):
    """Longest unseen stretch over all walks from entries, without end where an unseen walk repeats an arc."""
    best = 0.0

    def onward(a, so_far, passed):
        nonlocal best
        mine = np.flatnonzero(x.arc == a)
        if len(mine):
            best = max(best, so_far + x.start[mine[0]])
            return
        if a in passed:
            best = math.inf
            return
        best = max(best, so_far + x.length[a])
        for b in after[a]:
            onward(b, so_far + x.length[a], passed | {a})

    reach, waiting = set(np.flatnonzero(x.entries).tolist()), np.flatnonzero(x.entries).tolist()
    while waiting:
        for b in after[waiting.pop()]:
            if b not in reach:
                reach.add(b), waiting.append(b)
    for a in np.flatnonzero(x.entries).tolist():
        onward(a, 0.0, frozenset())
    for a in reach:
        mine = np.flatnonzero(x.arc == a)
        for k, j in itertools.pairwise(mine):
            best = max(best, x.start[j] - x.end[k])
        if len(mine):
            best = max(best, x.length[a] - x.end[mine[-1]])
            for b in after[a]:
                onward(b, x.length[a] - x.end[mine[-1]], frozenset())
    return best


def test_the_longest_unseen_way_is_that_of_all_walks():
    rng, endless = np.random.default_rng(0), 0
    for _ in range(300):
        x, after = random_graph(rng)
        found, walked = longest_unseen(x), longest_by_walks(x, after)
        assert found.longest[0] == pytest.approx(walked)
        endless += math.isinf(walked)
        if math.isinf(walked):
            assert found.circle >= 0
    assert 20 < endless < 280


def scene(rng, rays):
    """A few boxes and a cylinder, in PyBullet and as convex solids."""
    solids = []
    for _ in range(3):
        low = rng.uniform((-8, -8, 0), (6, 6, 1))
        high = low + rng.uniform(0.3, 4.0, 3)
        rays.box(low, high)
        solids += convex_solids(build_region("b", Box(type="box", min_m=tuple(low), max_m=tuple(high))))
    centre, radius = tuple(rng.uniform(-6, 6, 2)), float(rng.uniform(0.2, 1.5))
    rays.cylinder(centre, radius, (0.0, 3.0))
    shape = Cylinder(type="cylinder", center_m=centre, radius_m=radius, z_m=(0.0, 3.0))
    return solids + convex_solids(build_region("c", shape)), (centre, radius)


def test_sight_lines_agree_with_rays(rays):
    """Random eyes, points and solids; they may disagree only where a line passes within 1 cm of an edge."""
    rng, cases, differ, hidden = np.random.default_rng(1), 0, 0, 0
    for _ in range(25):
        rays.clean()
        parts, _ = scene(rng, rays)
        eyes, points = (
            rng.uniform((-10, -10, 0.1), (10, 10, 8), (800, 3)),
            rng.uniform((-9, -9, 0), (9, 9, 3), (800, 3)),
        )
        inside = np.any([(eyes @ a.T < c + 0.01).all(axis=1) for a, c in parts], axis=0)
        eyes, points = eyes[~inside], points[~inside]
        mine, theirs = sight_blocked(eyes, points, Solids.of(parts)), ~rays.clear(eyes, points)
        wider = sight_blocked(eyes, points, Solids.of([(a, c + 0.01) for a, c in parts]))
        smaller = sight_blocked(eyes, points, Solids.of([(a, c - 0.01) for a, c in parts]))
        edge = wider & ~smaller
        assert (mine == theirs)[~edge].all()
        cases, differ, hidden = (
            cases + len(eyes),
            differ + int((mine != theirs).sum()),
            hidden + int(theirs.sum()),
        )
    assert cases > 15_000
    assert hidden > 0.15 * cases
    assert differ < 0.002 * cases


def test_seen_targets_are_projected_into_the_image_and_not_hidden(rays):
    rng = np.random.default_rng(2)
    parts, _ = scene(rng, rays)
    intrinsics = Intrinsics(width_px=640, height_px=480, fx_px=400.0, fy_px=410.0, cx_px=310.0, cy_px=250.0)
    camera = CameraModel(name="c", intrinsics=intrinsics, near_m=0.5, far_m=15.0)
    eyes = rng.uniform((-10, -10, 3.5), (10, 10, 8), (6, 3))
    poses = [look_at(e, rng.uniform((-3, -3, 0), (3, 3, 0))) for e in eyes]
    frusta = [Frustum.from_camera(camera).in_world(e, q) for e, q in zip(eyes, poses, strict=True)]
    views: Views = views_of(frusta, eyes)
    points = rng.uniform((-9, -9, 0), (9, 9, 0.5), (1500, 3))
    mine = seen_by(points[:, None], views, Solids.of(parts))
    from camnet.geometry.rotations import to_matrix

    for k, (e, q) in enumerate(zip(eyes, poses, strict=True)):
        ray = (points - e) @ to_matrix(q)
        u, v = 400.0 * ray[:, 0] / ray[:, 2] + 310.0, 410.0 * ray[:, 1] / ray[:, 2] + 250.0
        inside = (ray[:, 2] > 0.5) & (ray[:, 2] < 15.0) & (u > 0) & (u < 640) & (v > 0) & (v < 480)
        assert ((inside & rays.clear(e, points)) != mine[:, k]).mean() < 0.003
    assert 0.02 < mine.mean() < 0.9


PROMISE = Promise("everybody", 10.0, 5.0, UnseenWay("between views", 10.0, 5.0, "a", "b"), limit_s=6.0)


def test_a_promise_is_certified_only_within_limits_for_enough_targets_and_without_refusals():
    assert PROMISE.verdict == "certified"
    assert PROMISE.reasons == ()
    for change, words in (
        ({"limit_s": 4.0}, "exceeds what is allowed"),
        ({"limit_m": 9.0}, "exceeds what is allowed"),
        ({"unseen_max_m": math.inf}, "between views"),
        ({"served": 1, "at_once": 2}, "holds for 1"),
        ({"served": 1, "at_once": None}, "any number"),
        ({"refusals": ("the agent is late",)}, "the agent is late"),
        ({"nobody_sees": ("guard",), "blind": (BlindCamera("a", "looks away"),)}, "looks away"),
    ):
        worse = replace(PROMISE, **change)
        assert worse.verdict == "not certified"
        assert any(words in reason for reason in worse.reasons)
        json.dumps(worse.as_dict(), allow_nan=False)
    assert "always in view" in replace(PROMISE, unseen_max_m=0.0, unseen_max_s=0.0, longest=None).sentence


def test_joined_promises_are_as_good_as_the_worst():
    other = replace(PROMISE, unseen_max_s=20.0, targets=("van",), served=1, at_once=3, refusals=("late",))
    both = join_promises([replace(PROMISE, targets=("car",), at_once=3), other])
    assert (both.unseen_max_s, both.served, both.at_once) == (20.0, 1, 3)
    assert both.targets == ("car", "van")
    assert both.refusals == ("late",)
    assert both.verdict == "not certified"


BOUNDS = EstimatorBounds(
    k=2.0, kcl=1.0, gamma_inv_min=1.0, gamma_inv_max=1.0, alpha=1.0, window_s=0.5, stack_size=10, eps_bar=0.01,
    etadot_max=0.5, sigma_bar=1.0, weight_bound=0.5, lambda_min_psi=4.0,
)  # fmt: skip


def test_premises_that_cannot_all_be_true_are_named():
    fine = {"v_max_mps": 0.4, "pose_rate": 0.5, "projection_radius": 0.5, "sigma_attained": 1.0}
    assert contradictions(BOUNDS, **fine) == ()
    for change, words in (
        ({"v_max_mps": 0.6}, "v_max"),
        ({"projection_radius": 0.6}, "projection"),
        ({"sigma_attained": 1.5}, "sigma_bar"),
        ({"pose_rate": 0.505}, "etadot_max"),
    ):
        (reason,) = contradictions(BOUNDS, **(fine | change))
        assert words in reason


@pytest.mark.parametrize("mobile", [False, True])
def test_views_with_models_of_their_own_start_at_a_higher_level(mobile):
    """Worked by hand: beta_1 = 0.50625, c_2 = 0.5; (3-35) from V_hi = 2 or V_hi + c_2 = 2.5 down to 1."""
    constants = sound_constants(BOUNDS, mobile=mobile)
    times = {}
    for shared in (True, False):
        times[shared] = DwellBounds(constants, 2.0, 1.0, shared_model=shared).on_min(h=False).seconds
    assert times[True] == pytest.approx(0.25 * math.log(2.0 / 0.49375))
    assert times[False] == pytest.approx(0.25 * math.log(2.5 / 0.49375))
