"""The compiled observers against the plain ones, frame by frame, with features that come and go."""

import numpy as np
import pytest

from camnet.estimation.structure.compiled_observer import CompiledDistanceObserver
from camnet.estimation.structure.distance_observer import DistanceObserver
from camnet.estimation.structure.key_view import KeyFrameViews
from camnet.estimation.structure.tracks import SimulatedTracks, TrackedFrame
from camnet.experiments.distance_observers_scene import SetUp, make_scene


def noisy_views(seed, setup):
    rng = np.random.default_rng(seed)
    scene = make_scene(setup, rng)
    views = KeyFrameViews(scene.camera, scene.odometry, setup.views)
    for k, frame in enumerate(
        SimulatedTracks(scene.points_world, scene.path, scene.camera, scene.t_s, setup.noise_px, rng)
    ):
        seen = (np.arange(48) + k // 20) % 7 > 0 if k > 40 else np.ones(48, dtype=bool)
        yield views.view(TrackedFrame(frame.t_s, frame.ids[seen], frame.pixels[seen]))


@pytest.mark.parametrize("extended", [False, True])
def test_compiled_and_plain_observers_agree(extended):
    """Two programs: rounding alone may differ. A window longer than the ring makes it grow."""
    setup = SetUp()
    plain = DistanceObserver(48, setup.observers, extended)
    fast = CompiledDistanceObserver(48, setup.observers, extended)
    for view in noisy_views(3, setup):
        plain.update(view)
        fast.update(view)
        np.testing.assert_allclose(fast.d_ic, plain.d_ic, rtol=1e-9)
        np.testing.assert_allclose(fast.d_ik, plain.d_ik, rtol=1e-9)
        assert fast.d_kc == pytest.approx(plain.d_kc, rel=1e-9, abs=1e-12)
        np.testing.assert_array_equal(fast.learned, plain.learned)
        np.testing.assert_array_equal(fast.depths(view), fast.d_ic * view.u_ic[:, 2])
    assert fast.learned.mean() > 0.9
