"""What blind replay of another episode is worth, and the check that says so."""

from __future__ import annotations

import pytest

from camnet.agents import make_team
from camnet.env import handoff_v0
from camnet.env.conformance import ConformanceError
from camnet.env.conformance_replay import check_replay, replay_scores
from camnet.env.presets import PRESETS

V1 = [name for name in PRESETS if name.endswith("-v1")]


@pytest.mark.slow
@pytest.mark.parametrize("task", V1)
def test_replayed_actions_lose_to_the_team_that_chose_them(task: str) -> None:
    options = dict(PRESETS[task])
    own, replayed = replay_scores(
        lambda: handoff_v0.parallel_env(**options, max_cycles=400),
        lambda env: make_team("planner", env, 1),
        others=(101, 102),
    )
    assert own > replayed + 0.05


def test_a_world_that_starts_alike_is_replayed() -> None:
    def make() -> handoff_v0.HandoffEnv:
        return handoff_v0.parallel_env(world="quickstart", score="v1", max_cycles=300)

    own, replayed = replay_scores(make, lambda env: make_team("static", env), others=(5,))
    assert replayed == pytest.approx(own, rel=0.2)
    with pytest.raises(ConformanceError, match="too much alike"):
        check_replay(make, lambda env: make_team("static", env), others=(5,))


def test_a_crowd_that_starts_anywhere_is_not() -> None:
    own, replayed = replay_scores(
        lambda: handoff_v0.parallel_env(world="crowd_8", score="v1", max_cycles=250),
        lambda env: make_team("planner", env, 1),
        others=(7,),
    )
    assert own > replayed
