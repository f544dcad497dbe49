"""``render_mode="human"`` opens a window, and ``reset`` and ``step`` draw in it."""

from __future__ import annotations

import shutil
import subprocess

import cv2
import numpy as np
import pytest

from camnet.env import handoff_v0
from camnet.env.single import SingleAgentEnv
from camnet.errors import ConfigError


def on_screen(display: str) -> np.ndarray:
    """Return what an X display shows, (H, W, 3), RGB: the format is that of ``xwd``, 32 bits a pixel."""
    if shutil.which("xwd") is None:
        pytest.skip("nothing to read the display with: Debian has xwd in x11-apps")
    raw = subprocess.run(
        ["xwd", "-root", "-silent", "-display", display], capture_output=True, check=True
    ).stdout
    header = np.frombuffer(raw[:100], dtype=">u4")
    size, width, height, line, colours = (int(header[k]) for k in (0, 4, 5, 12, 19))
    pixels = np.frombuffer(raw, dtype=np.uint8, offset=size + 12 * colours, count=height * line)
    return pixels.reshape(height, line // 4, 4)[:, :width, 2::-1].copy()


def test_the_window_shows_the_map_after_every_step(display: str) -> None:
    drawn = handoff_v0.parallel_env(render_mode="rgb_array")
    env = handoff_v0.parallel_env(render_mode="human")
    for one in (drawn, env):
        one.reset(seed=1)
    first = on_screen(display)
    for _ in range(10):
        for one in (drawn, env):
            one.step({name: np.full(5, 0.5, dtype=np.float32) for name in one.agents})
    assert env.render() is None
    shown, image = on_screen(display), drawn.render()
    assert image is not None
    assert (shown != first).any()
    place = cv2.minMaxLoc(cv2.matchTemplate(shown, image[100:500, 100:500], cv2.TM_SQDIFF_NORMED))
    # the window scales the picture by less than a pixel; the picture of the path grows from frame to frame
    assert place[0] < 0.05
    env.close()
    assert (on_screen(display) != shown).any()
    drawn.close()


def test_the_single_form_draws_too(display: str) -> None:
    env = SingleAgentEnv(render_mode="human")
    before = on_screen(display)
    env.reset(seed=1)
    assert (on_screen(display) != before).any()
    env.close()


def test_without_a_display_the_remedy_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr("sys.platform", "linux")
    env = handoff_v0.parallel_env(render_mode="human")
    with pytest.raises(ConfigError, match=r"no window can be opened.*xvfb-run.*render_mode='rgb_array'"):
        env.reset(seed=1)
    env.close()
