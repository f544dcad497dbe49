"""The compiled rows against the class: the same measurements in, the same estimate out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from camnet.batch.estimator import (
    ESTIMATE,
    EstimatorSetup,
    EstimatorState,
    allocate,
    build_setup,
    correct,
    estimate,
    predict,
    reset,
    rollout,
)
from camnet.batch.estimator_transfer import extract_models, install_models, learned_weights
from camnet.errors import ConfigError, DataError
from camnet.estimation.basis import RbfBasis
from camnet.estimation.learning_estimator import LearningEstimator
from camnet.estimation.persistence import extract, install, load_models, save_models
from camnet.estimation.settings import EstimatorSettings, GapSettings, StackSettings
from camnet.geometry import rotations
from camnet.geometry.settings import Road
from camnet.types import CameraMotion, PoseMeasurement

RATE_HZ = 30.0
TOLERANCE = 1e-9
BOUNDS = np.array([[-3.0, -3.0, -1.0], [3.0, 3.0, 1.0]])
_STILL = CameraMotion(np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3), np.zeros(3))


def grid_basis() -> RbfBasis:
    """Kernels along a circle of radius 1.5 m, on a grid with holes."""
    x, y = np.meshgrid(np.arange(-2.4, 2.5, 0.4), np.arange(-2.4, 2.5, 0.4), indexing="ij")
    centres = np.column_stack((x.ravel(), y.ravel()))
    return RbfBasis.create(centres[np.abs(np.hypot(*centres.T) - 1.5) < 0.7], 0.16)


def scattered_basis() -> RbfBasis:
    """Kernels over position and heading, without a grid, each with a covariance of its own."""
    rng = np.random.default_rng(5)
    a = rng.uniform(0.0, 2.0 * math.pi, 40)
    centres = np.column_stack((1.5 * np.cos(a), 1.5 * np.sin(a), -0.5 * np.sin(a), 0.5 * np.cos(a)))
    root = 0.15 * rng.standard_normal((40, 4, 4))
    return RbfBasis.create(centres, 0.3 * np.eye(4) + root @ root.transpose(0, 2, 1), 0.5)


class Lap:
    """A target on a circle, seen in three regions, two of which meet; it can turn round half-way."""

    def __init__(self, seconds: float, turns_at_s: float = math.inf, seed: int = 1) -> None:
        rng = np.random.default_rng(seed)
        self.t = np.arange(round(seconds * RATE_HZ)) / RATE_HZ
        sense = np.where(self.t < turns_at_s, 1.0, -1.0)
        angle = np.cumsum(0.5 * sense * (1.0 + 0.1 * np.sin(self.t))) / RATE_HZ
        noise = rng.standard_normal((2, len(self.t), 3))
        self.p = 1.5 * np.column_stack((np.cos(angle), np.sin(angle), 0.0 * angle)) + 0.01 * noise[0]
        yaw = rotations.from_yaw(angle + 0.5 * math.pi * sense)
        self.q = rotations.multiply(yaw, rotations.exp(0.01 * noise[1])) * rng.choice(
            [-1, 1], (len(self.t), 1)
        )
        part = np.floor(np.mod(angle, 2.0 * math.pi) / (0.4 * math.pi)).astype(int)
        # parts 0, 1 and 3 are seen; 0 and 1 meet; one measurement in fifty is missing
        self.region = np.array([0, 1, -1, 2, -1])[part]
        self.region[rng.random(len(self.t)) < 0.004] = -1


def feed(
    lap: Lap, i: int, twin: LearningEstimator, setup: EstimatorSetup, state: EstimatorState, row: int
) -> None:
    """Give measurement ``i`` to both; a few come late."""
    t, p, q, region = float(lap.t[i]), lap.p[i], lap.q[i], int(lap.region[i])
    if region < 0:
        twin.predict(t)
        predict(setup, state, row, t)
        return
    late = t - (0.05 if i % 101 == 0 else 0.0)
    twin.correct(PoseMeasurement(late, 0, 0, p, q, _STILL), region)
    correct(setup, state, row, late, p, q, region)


def compare(twin: LearningEstimator, setup: EstimatorSetup, state: EstimatorState, row: int) -> None:
    """Compare all fields of the estimate."""
    out, wanted = np.empty(16), twin.estimate
    assert estimate(setup, state, row, out) == wanted.region
    for name, (first, count) in ESTIMATE.items():
        np.testing.assert_allclose(
            out[first : first + count],
            np.ravel(getattr(wanted, name)),
            rtol=0.0,
            atol=TOLERANCE,
            err_msg=name,
        )


def run(
    lap: Lap, settings: EstimatorSettings, basis: RbfBasis, roads: Sequence[Road] = ()
) -> tuple[LearningEstimator, EstimatorSetup, EstimatorState]:
    """Drive both over the lap and compare them on the way."""
    twin = LearningEstimator(settings, basis, 3, RATE_HZ, BOUNDS, roads=roads)
    setup = build_setup(settings, basis, 3, RATE_HZ, BOUNDS, roads)
    state = allocate(setup, settings, 2)
    out = np.empty((40, 8))
    for i in range(len(lap.t)):
        feed(lap, i, twin, setup, state, 1)
        compare(twin, setup, state, 1)
        if i % 50 == 7:
            path = twin.rollout(8.0, 0.2)
            rollout(setup, state, 1, 0.2, out)
            wanted = np.column_stack((path.p_world, path.q_world, path.radius_m))
            np.testing.assert_allclose(out, wanted, rtol=0.0, atol=TOLERANCE)
            weights = learned_weights(setup, state, 1)
            for j in range(setup.rules.models):
                np.testing.assert_allclose(weights[j], twin.model(j).weights, rtol=0.0, atol=TOLERANCE)
    return twin, setup, state


def _stack(**values: Any) -> EstimatorSettings:
    return EstimatorSettings(stack=StackSettings(**values))


@pytest.mark.parametrize(
    ("settings", "basis"),
    [
        (EstimatorSettings(), grid_basis()),
        (EstimatorSettings(share=True, gap=GapSettings(prior="constant_velocity")), grid_basis()),
        (EstimatorSettings(gap=GapSettings(prior="none"), leakage=0.0, switching="sat"), grid_basis()),
        (EstimatorSettings(weight_bound=0.3, reset_on_sighting=False), grid_basis()),
        (EstimatorSettings(), scattered_basis()),
    ],
    ids=["default", "shared", "printed", "projected", "scattered"],
)
def test_rows_follow_the_class(settings: EstimatorSettings, basis: RbfBasis) -> None:
    twin, setup, state = run(Lap(45.0), settings, basis)
    found = extract_models(setup, state, 1, basis)
    for j, model in enumerate(found):
        wanted = extract(twin.model(j), basis)
        assert len(model.stacks[0][0]) == twin.model(j).integral.count > 5
        for a, b in zip(model.stacks[0], wanted.stacks[0], strict=True):
            np.testing.assert_allclose(a, b, rtol=0.0, atol=TOLERANCE)
    # the row beside it saw nothing
    assert estimate(setup, state, 0, np.empty(16)) == -1


def test_the_prior_along_roads_is_the_same() -> None:
    """A ring of corners under the lap and a road beside it, other gaps off both; no path is learned across."""
    corners = tuple((1.5 * math.cos(a), 1.5 * math.sin(a)) for a in np.arange(0.0, 6.2, 0.5).tolist())
    roads = (
        Road(name="ring", closed=True, points_m=corners, width_m=0.5),
        Road(name="beside", points_m=((-2.0, 0.5), (-2.0, 2.0)), width_m=0.2),
    )
    gap = GapSettings(prior="road", learn_across=False)
    lap, kernels = Lap(30.0), grid_basis().centres
    sparse = RbfBasis.create(kernels[kernels[:, 1] > 0.0], 0.16)
    twin, _, _ = run(lap, EstimatorSettings(gap=gap), sparse, roads)
    plain, _, _ = run(lap, EstimatorSettings(gap=gap), sparse)
    ahead, without = twin.rollout(8.0, 0.2).p_world, plain.rollout(8.0, 0.2).p_world
    radius = [np.hypot(*path[:20, :2].T) for path in (ahead, without)]
    assert np.abs(radius[0] - 1.5).max() < 0.3 < np.abs(radius[1] - 1.5).max()


def test_a_full_stack_keeps_the_same_windows() -> None:
    twin, setup, state = run(Lap(60.0), _stack(size=12), grid_basis())
    for j, model in enumerate(extract_models(setup, state, 1, grid_basis())):
        assert twin.model(j).integral.count == 12
        np.testing.assert_allclose(model.stacks[0][2], twin.model(j).integral.entered_s, atol=1e-12)
    assert twin.model(0).integral.refused > 0


def test_what_has_changed_is_forgotten_alike() -> None:
    settings = EstimatorSettings(share=True, stack=StackSettings(outlier_gate=3.0))
    twin, _, _ = run(Lap(75.0, turns_at_s=40.0), settings, grid_basis())
    assert twin.diagnostics()["forgotten_0"] > 0


def test_saved_models_continue_in_rows(tmp_path: Path) -> None:
    settings, basis, lap = EstimatorSettings(), grid_basis(), Lap(30.0)
    twin, setup, state = run(lap, settings, basis)
    save_models(tmp_path / "m.npz", extract_models(setup, state, 1, basis))
    models = load_models(tmp_path / "m.npz")
    fresh = LearningEstimator(settings, basis, 3, RATE_HZ, BOUNDS)
    for j, model in enumerate(models):
        install(fresh.model(j), basis, model)
    install_models(setup, state, 0, basis, models)
    for i in range(300):
        feed(lap, i, fresh, setup, state, 0)
        compare(fresh, setup, state, 0)
    with pytest.raises(DataError, match="already"):
        install_models(setup, state, 0, basis, models)
    reset(setup, state, 0)
    assert not learned_weights(setup, state, 0).any()
    with pytest.raises(DataError, match="2, but the estimator has 3"):
        install_models(setup, state, 0, basis, models[:2])
    small = allocate(setup, settings, 1, duration_s=0.5)
    with pytest.raises(ConfigError, match="has room for"):
        install_models(setup, small, 0, basis, models)
    del twin


@pytest.mark.parametrize(
    ("change", "name"),
    [
        ({"form": "stacked"}, "form"),
        ({"frame": "relative"}, "frame"),
        ({"alpha": 0.5}, "alpha"),
        ({"stack": StackSettings(rule="lambda_min")}, "stack.rule"),
        ({"gap": GapSettings(pace=True)}, "gap.pace"),
    ],
)
def test_settings_without_a_compiled_form_are_refused(change: dict[str, Any], name: str) -> None:
    with pytest.raises(ConfigError, match=rf"estimator\.{name}"):
        build_setup(EstimatorSettings().model_copy(update=change), grid_basis(), 3, RATE_HZ, BOUNDS)


def test_numbers_without_sense_are_refused() -> None:
    settings, basis = EstimatorSettings(), grid_basis()
    with pytest.raises(ConfigError, match="tracking_bounds"):
        build_setup(settings, basis, 3, RATE_HZ, BOUNDS[::-1])
    with pytest.raises(ConfigError, match="n_regions"):
        build_setup(settings, basis, 0, RATE_HZ, BOUNDS)
    setup = build_setup(settings, basis, 3, RATE_HZ, BOUNDS)
    with pytest.raises(ConfigError, match="rows"):
        allocate(setup, settings, 0)
    with pytest.raises(ConfigError, match="duration_s"):
        allocate(setup, settings, 1, duration_s=0.0)
