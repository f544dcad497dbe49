"""The size of a target that is followed, by the agent's own motion."""

from __future__ import annotations

import math

import numpy as np
import pytest

from camnet.config.load import load_scenario
from camnet.estimation.structure.moving.size_from_motion import SizeFromMotion
from camnet.simulation.run import run_network
from camnet.types import CameraMotion, PoseMeasurement

#: looks straight down: camera x is world x, y and z are reversed
DOWN = np.array([0.0, 1.0, 0.0, 0.0])


def follow(
    sizes: SizeFromMotion, seconds: float, sway_m: float, noise_m: float, start_s: float = 0.0
) -> list[float]:
    """Follow a vehicle on an S-shaped way from 3 m above, going round it; return the scales after each image."""
    rng, scales = np.random.default_rng(3), []
    heading, place = 0.3, np.array([0.0, 0.0, 0.0])
    for k in range(round(seconds * 30)):
        t = start_s + k / 30.0
        heading += 0.25 * math.cos(0.35 * t) / 30.0
        place = place + 0.5 / 30.0 * np.array([math.cos(heading), math.sin(heading), 0.0])
        round_ = sway_m * np.array([math.cos(0.9 * t), math.sin(0.9 * t), 0.0])
        camera = place + round_ + np.array([0.0, 0.0, 3.0])
        way = place - camera + noise_m * rng.standard_normal(3)
        # about the camera's z, which points down, headings turn the other way
        q_cam = np.array([0.0, math.cos(heading / 2), -math.sin(heading / 2), 0.0])
        motion = CameraMotion(camera, DOWN, np.zeros(3), np.zeros(3))
        z = PoseMeasurement(t, 0, 0, way * [1.0, -1.0, -1.0], q_cam, motion)
        found = sizes.take(z)
        assert found.p_cam == pytest.approx(sizes.scale * z.p_cam)
        scales.append(sizes.scale)
    return scales


def test_going_round_tells_the_size() -> None:
    for assumed in (1.4, 0.6):
        sizes = SizeFromMotion(assumed)
        scales = follow(sizes, 40.0, 0.8, 0.01)
        assert scales[0] == assumed
        assert abs(scales[-1] - 1.0) < 0.02
        assert abs(scales[-1] - 1.0) < 4.0 * sizes.sd


def test_sightings_are_joined() -> None:
    sizes = SizeFromMotion(1.4)
    follow(sizes, 30.0, 0.8, 0.02)
    alone = sizes.sd
    follow(sizes, 30.0, 0.8, 0.02, start_s=60.0)
    assert sizes.sightings == 1  # the second goes on
    assert sizes.sd < alone
    assert abs(sizes.scale - 1.0) < 0.02


def test_an_agent_that_moves_as_its_target_learns_nothing() -> None:
    sizes = SizeFromMotion(1.4)
    assert set(follow(sizes, 30.0, 0.0, 0.01)) == {1.4}
    assert math.isinf(sizes.sd)


@pytest.mark.slow
def test_a_vehicle_is_followed_with_its_size_within_two_percent() -> None:
    for seed, assumed in ((1, 1.4), (2, 0.6)):
        scenario = load_scenario(
            "unknown_size", (f"targets.vehicle.assumed_size={assumed}", "run.duration_s=120")
        )
        summary = run_network(scenario, seed, ("learned",)).summary
        assert summary["sizes"]["vehicle"]["scale"] == pytest.approx(1.0, abs=0.02)
        assert summary["region_exits"] == 0
