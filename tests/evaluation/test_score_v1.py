"""The score by the truth: every entry counts, a blind team misses all, nobody beats the bound."""

from __future__ import annotations

import numpy as np
import pytest

from camnet.agents import make_team
from camnet.env import handoff_v0
from camnet.env.infos import EPISODE
from camnet.evaluation.evaluate import normalise
from camnet.evaluation.play import Match, play
from camnet.evaluation.play_batch import play_together
from camnet.simulation.handoff import HandoffTracker

V1 = (("score", "v1"),)


def track(every: bool, script: list[tuple[float, int, int]]) -> HandoffTracker:
    tracker = HandoffTracker(0, 2.0, every)
    for step in script:
        tracker.update(*step)
    return tracker


def test_an_entry_counts_though_nobody_saw_the_target_before() -> None:
    script = [(0.0, -1, -1), (1.0, 0, -1), (4.0, -1, -1), (6.0, 1, 1), (8.0, -1, -1), (9.0, 1, -1)]
    assert track(False, script).attempted == 0
    found = track(True, script)
    assert (found.attempted, found.completed, found.entries) == (3, 1, 3)


def test_where_a_target_stands_at_the_start_is_no_entry() -> None:
    assert track(True, [(0.0, 2, 2), (1.0, 2, -1), (2.0, 2, 2)]).attempted == 0


@pytest.mark.parametrize("agent", ["learned", "blind", "static"])
def test_both_back_ends_count_alike(agent: str) -> None:
    match = Match(agent, "quickstart", 700, options=V1)
    (one,), (other,) = list(play(match, [3])), play_together(match, [3])
    for name in ("return", "bound", "time_in_view", "handoff_success"):
        assert one[name] == pytest.approx(other[name], abs=1e-6, nan_ok=True), name


def test_a_blind_team_sees_nothing_and_pays_for_every_entry() -> None:
    env = handoff_v0.parallel_env(
        world="pursuit", score="v1", cameras="off", filter_name="ekf", max_cycles=400
    )
    observations, _ = env.reset(seed=2)
    team, total = make_team("static", env), 0.0
    entries = 0
    before = env.simulation.target_region.copy()
    while env.agents:
        observations, rewards, _, _, infos = env.step(team(observations))
        total += next(iter(rewards.values()))
        now = env.simulation.target_region.copy()
        entries += int(np.count_nonzero((now >= 0) & (now != before)))
        before = now
    figures = next(iter(infos.values()))[EPISODE]
    assert figures["time_in_view"] == 0.0
    assert figures["handoffs"] == {"attempted": entries, "completed": 0}
    late = sum(
        env.simulation.snapshot.t_s - h.t_enter_s <= 2.0 for t in env.simulation.trackers for h in t.handoffs
    )
    assert total == pytest.approx(-2.0 * (entries - late), abs=0.2)  # but for the effort of keeping still
    env.close()


def test_nobody_beats_the_bound_and_the_blind_team_is_zero() -> None:
    agents = ("learned", "planner", "oracle", "planner_oracle", "auction", "static", "blind")
    matches = {agent: Match(agent, "pursuit", 400, options=V1) for agent in agents}
    seeds = (0, 1, 2)
    scores = {m: dict(zip(seeds, play_together(m, seeds), strict=True)) for m in matches.values()}
    normalise(matches, scores, seeds)
    for agent, match in matches.items():
        for seed in seeds:
            score = scores[match][seed]
            assert score["return"] <= score["bound"] + 1e-9, agent
            assert score["normalised"] == 0.0 if agent == "blind" else score["normalised"] <= 1.0, agent
    best = np.mean([scores[matches["planner_oracle"]][seed]["normalised"] for seed in seeds])
    assert best > np.mean([scores[matches["static"]][seed]["normalised"] for seed in seeds]) > 0.0
