"""One agent of the network as a Gymnasium environment."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import cv2
import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from camnet.agents import make_team
from camnet.env.single import SingleAgentEnv
from camnet.errors import ConfigError


@pytest.mark.parametrize(
    ("mode", "form"), [("setpoint", "flat"), ("velocity", "flat"), ("assign", "flat"), ("assign", "dict")]
)
def test_gymnasium_accepts_it(mode: str, form: str) -> None:
    env = gymnasium.make(
        "camnet/Handoff-Single-v0", action_mode=mode, observation_form=form, agent="camera_2", max_cycles=5
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error", UserWarning)
        check_env(env.unwrapped, skip_render_check=True)
    env.close()


def test_gymnasium_accepts_its_pictures(display: str) -> None:
    env = gymnasium.make("camnet/Handoff-Single-v0", max_cycles=5)
    with warnings.catch_warnings():
        warnings.simplefilter("error", UserWarning)
        check_env(env.unwrapped)
    env.close()


def test_the_others_follow_what_they_are_given() -> None:
    flown = []
    for others in (None, lambda env: make_team("static", env)):
        env = SingleAgentEnv(agent="camera_1", others=others, max_cycles=40)
        env.reset(seed=1)
        over = False
        while not over:
            *_, terminated, truncated, info = env.step(np.zeros(5, dtype=np.float32))
            over = terminated or truncated
        flown.append(env.network_env.simulation.snapshot.camera_p_world.copy())
        assert "handoff_episode" in info
        env.close()
    np.testing.assert_allclose(flown[0][1], flown[1][1], atol=1e-6)  # the same actions of camera_1
    assert np.linalg.norm(flown[0][0] - flown[1][0]) > 0.1  # camera_0 tracks the robot, or does not


def test_it_ends_when_the_agent_fails() -> None:
    env = SingleAgentEnv(max_cycles=10, failures={"schedule_s": {"camera_0": 0.3, "camera_2": 0.1}})
    env.reset(seed=1)
    ends = [env.step(np.zeros(5, dtype=np.float32))[2:] for _ in range(3)]
    assert [end[0] for end in ends] == [False, False, True]
    assert ends[-1][2]["failed"]
    with pytest.raises(ConfigError, match=r"camera_0 is gone: reset\(\)"):
        env.step(np.zeros(5, dtype=np.float32))
    env.close()


def test_unknown_agents_are_named() -> None:
    with pytest.raises(ConfigError, match="'camera_7': no such agent; there are camera_0"):
        SingleAgentEnv(agent="camera_7")


def test_videos_are_recorded(tmp_path: Path) -> None:
    pytest.importorskip("moviepy")
    env: Any = gymnasium.make("camnet/Handoff-Single-v0", render_mode="rgb_array", max_cycles=12)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # moviepy's own
        env = gymnasium.wrappers.RecordVideo(env, str(tmp_path), episode_trigger=lambda k: True)
        env.reset(seed=1)
        over = False
        while not over:
            _, _, terminated, truncated, _ = env.step(env.action_space.sample())
            over = terminated or truncated
        env.close()
    (film,) = tmp_path.glob("*.mp4")
    reader = cv2.VideoCapture(str(film))
    frames = []
    while True:
        good, frame = reader.read()
        if not good:
            break
        frames.append(frame)
    assert len(frames) in (12, 13)
    assert reader.get(cv2.CAP_PROP_FPS) == pytest.approx(10)
    assert frames[0].shape == (640, 640, 3)
    assert frames[0].std() > 10.0  # a picture, not a blank
