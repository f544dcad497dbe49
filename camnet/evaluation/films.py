"""Videos of the best and the worst episode of an agent."""

from __future__ import annotations

from pathlib import Path

import imageio_ffmpeg
import numpy as np

from camnet.env import handoff_v0
from camnet.evaluation.play import Match, play_one

__all__ = ["film_episode"]


def film_episode(match: Match, seed: int, path: Path, every: int = 4, fps: int = 20) -> None:
    """Play an episode again and write its moving map, one frame in ``every`` decisions (H.264).

    Raises
    ------
    OSError
        The encoder could not be started or failed.
    """
    env = match.environment(render_mode="rgb_array")
    temporary = path.with_name(f".{path.stem}.partial.mp4")
    writer, count = None, 0

    def frame(shown: handoff_v0.HandoffEnv) -> None:
        nonlocal writer, count
        count += 1
        if (count - 1) % every:
            return
        image = shown.render()
        if image is None:
            return
        if writer is None:
            size = (image.shape[1], image.shape[0])
            writer = imageio_ffmpeg.write_frames(
                str(temporary), size, fps=fps, codec="libx264", macro_block_size=2, ffmpeg_log_level="error"
            )
            writer.send(None)  # starts the encoder
        writer.send(np.ascontiguousarray(image))

    try:
        play_one(match, env, seed, frame)
        if writer is not None:
            writer.close()
            temporary.replace(path)
    finally:
        env.close()
        temporary.unlink(missing_ok=True)
