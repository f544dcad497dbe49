"""The three action modes: what they fly, and that nobody leaves its region."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from camnet.control.settings import ControllerSettings
from camnet.env import handoff_v0
from camnet.env.single import built_in
from camnet.env.velocity import VelocityPilot, guarded
from camnet.errors import ConfigError
from camnet.geometry.polytope import PolytopeRegion
from camnet.geometry.regions import BoxRegion, CylinderRegion, PrismRegion, Region
from camnet.simulation.run import decide, setpoints_for
from camnet.types import Array

ELL = [(-2.0, -2.0), (2.0, -2.0), (2.0, 0.0), (0.0, 0.0), (0.0, 2.0), (-2.0, 2.0)]
REGIONS: list[Region] = [
    BoxRegion("box", (-2, -1, 0), (2, 1, 3)),
    CylinderRegion("cylinder", (0, 0), 1.5, (0, 3)),
    PolytopeRegion("polytope", [(-2, -2, 0), (2, -2, 0), (2, 2, 0), (-2, 2, 0), (0, 0, 4)]),
    PrismRegion("ell", ELL, (0, 3)),
]


def make(**options: Any) -> handoff_v0.HandoffEnv:
    return handoff_v0.parallel_env(**{"max_cycles": 40, **options})


def test_assignments_of_the_built_in_rule_fly_what_the_built_in_system_flies() -> None:
    env = make(action_mode="assign")
    observations, _ = env.reset(seed=3)
    act = built_in(env)
    alone = make(action_mode="assign").simulation  # the same estimators
    alone.reset(3)
    while env.agents:
        observations, *_ = env.step(act(observations))
        alone.advance(setpoints_for(alone, decide(alone)))
    np.testing.assert_array_equal(env.simulation.snapshot.agent_p_world, alone.snapshot.agent_p_world)
    np.testing.assert_array_equal(env.simulation.snapshot.camera_q_world, alone.snapshot.camera_q_world)
    env.close()
    alone.world.close()


def test_the_built_in_rule_flies_by_velocities_too() -> None:
    env = make(action_mode="velocity", max_cycles=60)
    observations, _ = env.reset(seed=3)
    act = built_in(env)
    while env.agents:
        observations, *_ = env.step(act(observations))
    now = env.simulation.snapshot
    distance = np.linalg.norm(now.camera_p_world[0, :2] - now.target_p_world[0, :2])
    assert env.simulation.visible[0, 0]
    assert distance < 0.5  # it hovers above the robot
    env.close()


@settings(max_examples=25, deadline=None)
@given(
    st.sampled_from(REGIONS),
    st.lists(st.tuples(*[st.floats(-1.5, 1.5)] * 3), min_size=1, max_size=6),
)
def test_a_guarded_camera_never_leaves_the_shrunk_region(
    region: Region, wishes: list[tuple[float, float, float]]
) -> None:
    margin, dt, tau = 0.25, 1 / 60, 0.75
    p: Array = np.array(region.center, dtype=float)
    for wish in wishes:
        for _ in range(90):
            p = p + dt * guarded(p, np.array(wish), region, margin, tau)
            # only on the way round a corner of a region that is not convex half the margin may be used up
            allowed = -0.5 * margin if isinstance(region, PrismRegion) else -margin
            assert region.signed_distance(p) <= allowed + 1e-6


def test_free_wishes_pass_the_guard_unchanged() -> None:
    for region in REGIONS:
        p, v = np.array(region.center), np.array([0.2, -0.1, 0.05])
        np.testing.assert_allclose(guarded(p, v, region, 0.25, 0.75), v, atol=1e-9)


def test_commands_are_limited_in_size_and_slope() -> None:
    limits = ControllerSettings()
    pilot = VelocityPilot(limits, [REGIONS[0]], 1 / 60, guard=False)
    pilot.ask(np.ones((1, 6)))
    env = make(action_mode="velocity")
    env.reset(seed=0)
    snapshot, before = env.simulation.snapshot, np.zeros(3)
    for _ in range(90):
        command = pilot(snapshot)
        slope = np.linalg.norm(command.v_world[0] - before) * 60
        assert slope <= limits.reference_a_max_mps2 + 1e-9
        before = command.v_world[0]
    assert np.linalg.norm(before) == pytest.approx(limits.reference_v_max_mps)
    assert np.linalg.norm(command.w_cam[0]) == pytest.approx(limits.reference_w_max_radps)
    env.close()


def fly_outwards(guard: bool) -> tuple[handoff_v0.HandoffEnv, float]:
    env = make(action_mode="velocity", region_guard=guard, max_cycles=60)
    env.reset(seed=1)
    rewards: dict[str, float] = {}
    action = np.array([0.7, 0.7, 0.0, 0.0, 0.0, 0.0], dtype=np.float32)
    while env.agents:
        _, rewards, *_ = env.step(dict.fromkeys(env.agents, action))
    return env, rewards["camera_0"]


def test_the_guard_holds_in_flight_and_without_it_leaving_is_penalised() -> None:
    guarded_env, inside = fly_outwards(guard=True)
    assert guarded_env.simulation.statistics.region_exits == 0
    free, outside = fly_outwards(guard=False)
    assert free.simulation.agents_outside().all()
    assert outside < inside - 0.9 * 4 * 0.1 * free.settings.reward.region_exit
    guarded_env.close()
    free.close()


def test_masks_tell_what_an_assignment_means() -> None:
    env = make(action_mode="assign")
    _, infos = env.reset(seed=1)
    masks = {name: info["action_mask"] for name, info in infos.items()}
    assert env.action_space("camera_0").n == 4  # type: ignore[attr-defined] # one target
    for j, name in enumerate(env.possible_agents):
        entry = env.simulation.entries()[0][j]
        np.testing.assert_array_equal(masks[name], [1, entry is not None, 1, 1])
    env.close()


def test_hold_stays_and_loiter_goes_to_the_middle() -> None:
    env = make(action_mode="assign", max_cycles=80)
    env.reset(seed=1)
    start = env.simulation.snapshot.camera_p_world.copy()
    actions = {name: 3 if name == "camera_1" else 2 for name in env.agents}  # hold, loiter
    while env.agents:
        env.step(actions)
    moved = np.linalg.norm(env.simulation.snapshot.camera_p_world - start, axis=1)
    assert moved[1] < 0.05
    assert (moved[[0, 2, 3]] > 0.1).all()  # up to where the region is in view
    env.close()


@pytest.mark.parametrize(
    ("mode", "action", "words"),
    [
        ("velocity", np.zeros(5), "6 finite numbers"),
        ("setpoint", np.full(5, np.inf), "5 finite numbers"),
        ("assign", 4, r"whole number in 0\.\.3"),
        ("assign", 0.5, r"whole number in 0\.\.3"),
        ("assign", np.zeros(5), r"whole number in 0\.\.3"),
    ],
)
def test_bad_actions_are_named(mode: str, action: Any, words: str) -> None:
    env = make(action_mode=mode)
    env.reset(seed=0)
    with pytest.raises(ConfigError, match=f"camera_0 = .*{words}"):
        env.step(dict.fromkeys(env.agents, action))
    env.close()
