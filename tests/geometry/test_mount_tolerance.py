"""What is seen at every pose within a mount's tolerance, against sampled poses."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from camnet.errors import ConfigError
from camnet.geometry.frustum import Frustum
from camnet.geometry.mount_tolerance import held_frustum


@pytest.mark.parametrize("seed", range(8))
def test_every_pose_within_the_tolerance_sees_what_is_held(seed):
    rng = np.random.default_rng(seed)
    wide, high = np.tan(np.radians(rng.uniform((15.0, 10.0), (60.0, 45.0))))
    whole = Frustum.from_tangents([-wide, wide * rng.uniform(0.7, 1.0), -high, high], 0.5, 40.0)
    delta, angle = rng.uniform((0.0, 0.2), (0.3, 5.0))
    held = held_frustum(whole, delta, angle)
    low, top = whole.corners.min(axis=0), whole.corners.max(axis=0)
    points = rng.uniform(low, top, (50_000, 3))
    inside = points[held.contains(points)]
    assert len(inside) > 250
    of_whole = whole.contains(points).sum()
    assert len(inside) < of_whole
    seen = np.ones(of_whole, dtype=bool)
    every = points[whole.contains(points)]
    for _ in range(300):
        axis, off = rng.normal(size=(2, 3))
        turn = Rotation.from_rotvec(np.radians(angle) * axis / np.linalg.norm(axis)).as_matrix()
        shift = delta * off / np.linalg.norm(off)
        assert whole.contains((inside - shift) @ turn).all()
        seen &= whole.contains((every - shift) @ turn)
    assert len(inside) > 0.5 * seen.sum()  # not vacuous: a pyramid within what all poses see


def test_no_tolerance_changes_nothing_and_too_much_leaves_nothing():
    whole = Frustum.from_tangents([-0.5, 0.5, -0.3, 0.3], 0.5, 40.0)
    held = held_frustum(whole, 0.0, 0.0)
    np.testing.assert_allclose(held.A, whole.A, atol=1e-12)
    np.testing.assert_allclose(held.b, whole.b, atol=1e-12)
    assert held_frustum(whole, 0.0, 20.0) is None
    with pytest.raises(ConfigError, match="below 45 degrees"):
        held_frustum(whole, 0.0, 60.0)
