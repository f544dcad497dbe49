"""The compiled look at the truth agrees with its parts, asked one by one."""

from __future__ import annotations

import numpy as np
from rounding import assert_rounded_alike

from camnet.geometry.regions import build_region
from camnet.geometry.settings import Box, CameraModel, Cylinder, Intrinsics
from camnet.sensing.survey import Lookout, first_seers
from camnet.sensing.visibility import VisibilityTest, who_may_see
from camnet.types import Snapshot

LENS = Intrinsics(width_px=640, height_px=480, fx_px=400.0, fy_px=400.0, cx_px=320.0, cy_px=240.0)
CAMERA = CameraModel(name="c", intrinsics=LENS, near_m=0.2, far_m=6.0)
REGIONS = [
    build_region("a", Box(min_m=(-3.0, -3.0, 0.0), max_m=(1.0, 3.0, 4.0))),
    build_region("b", Cylinder(type="cylinder", center_m=(2.0, 0.0), radius_m=2.0, z_m=(0.0, 4.0))),
    build_region("c", Box(min_m=(-4.0, -4.0, 0.0), max_m=(4.0, 4.0, 4.0))),
]


def _snapshot(rng: np.random.Generator) -> Snapshot:
    """Return two agents, three cameras, four targets anywhere."""
    q = rng.normal(size=(9, 4)) * (0.2, 1.0, 0.3, 0.2)
    q[3:] = rng.normal(size=(6, 4)) * (1.0, 0.05, 0.05, 1.0)
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    agents = rng.uniform((-3.0, -3.0, 0.0), (4.0, 3.0, 5.0), (3, 3))
    targets = rng.uniform((-3.5, -3.0, 0.0), (4.0, 3.0, 0.2), (4, 3))
    none = np.zeros((4, 3))
    return Snapshot(
        0.0, 0, agents[:2], q[3:5], none[:2], none[:2], agents, q[:3], none[:3], none[:3],
        targets, q[5:9], none, none,
    )  # fmt: skip


def test_survey_is_its_parts_one_by_one() -> None:
    rng = np.random.default_rng(2)
    features = [rng.uniform(-0.2, 0.2, (4, 3)) for _ in range(4)]
    test = VisibilityTest([CAMERA] * 3, features, [None] * 3)
    bounds = np.array([region.bounds for region in REGIONS])
    lookout = Lookout(bounds[:, 0].copy(), bounds[:, 1].copy(), 2, test.packed)
    seen = 0
    for _ in range(150):
        now, working = _snapshot(rng), rng.random(3) < 0.8
        points = np.concatenate([now.target_p_world, now.agent_p_world])
        inside = np.stack([region.contains(points) for region in REGIONS], axis=1)
        boxed = ((points[:, None] >= bounds[:, 0]) & (points[:, None] <= bounds[:, 1])).all(axis=2)
        found = lookout.look(now, boxed & ~inside, working)
        allowed, region = who_may_see(inside[:4], working, 2)
        np.testing.assert_array_equal(found.visible, test(now, None, allowed))
        np.testing.assert_array_equal(found.region, region)
        assert found.seen_by == first_seers(found.visible)
        np.testing.assert_array_equal(found.outside, ~np.diagonal(inside[4:]))
        assert_rounded_alike(found.spacing_m, np.linalg.norm(now.agent_p_world[0] - now.agent_p_world[1]))
        seen += int(found.visible.sum())
    assert seen > 50
