"""Videos of the best and the worst episode of an agent."""

from __future__ import annotations

from pathlib import Path

from camnet.env import handoff_v0
from camnet.evaluation.play import Match, play_one
from camnet.report.encode import video_file

__all__ = ["film_episode"]


def film_episode(match: Match, seed: int, path: Path, every: int = 4, fps: int = 20) -> None:
    """Play an episode again and write its moving map, one frame in ``every`` decisions (H.264).

    Raises
    ------
    OSError
        The encoder could not be started or failed.
    """
    env = match.environment(render_mode="rgb_array")
    count = 0
    try:
        with video_file(path, fps) as add:

            def frame(shown: handoff_v0.HandoffEnv) -> None:
                nonlocal count
                image = None if count % every else shown.render()
                count += 1
                if image is not None:
                    add(image)

            play_one(match, env, seed, frame)
    finally:
        env.close()
