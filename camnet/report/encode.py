"""H.264 video files that are whole or absent."""

from __future__ import annotations

import struct
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import imageio_ffmpeg
import numpy as np
from numpy.typing import NDArray

from camnet.storage.whole_file import whole_file

__all__ = ["video_file"]

Frame = NDArray[np.uint8]


@contextmanager
def video_file(path: Path, fps: float, **options: Any) -> Iterator[Callable[[Frame], None]]:  # noqa: ANN401
    """Yield a function that adds a frame (H, W, 3), all of one size; at least one is needed.

    Parameters
    ----------
    path : ends in ``.mp4``
    fps : frames a second
    options : for `imageio_ffmpeg.write_frames`

    Raises
    ------
    OSError
        The encoder could not be started, or could not write: a full disk shows here as well.
    """
    writer: Generator[None, Frame | None, None] | None = None
    with whole_file(path) as temporary:

        def add(frame: Frame) -> None:
            nonlocal writer
            if writer is None:
                writer = imageio_ffmpeg.write_frames(
                    str(temporary),
                    (frame.shape[1], frame.shape[0]),
                    fps=fps,
                    codec="libx264",
                    macro_block_size=2,
                    ffmpeg_log_level="error",
                    **options,
                )
                writer.send(None)  # starts the encoder
            try:
                writer.send(np.ascontiguousarray(frame))
            except OSError as error:
                raise OSError(f"{path.name}: the video encoder stopped; is the disk full?") from error

        try:
            yield add
        finally:
            if writer is not None:
                writer.close()
        if not _is_whole(temporary):
            raise OSError(f"{path.name}: the video encoder could not write all of it; is the disk full?")


def _is_whole(path: Path) -> bool:
    """Whether the file is a sequence of whole MP4 boxes with an index (ISO 14496-12, 4.2) among them."""
    if not path.is_file():
        return False
    end, names = path.stat().st_size, set()
    with path.open("rb") as stream:
        at = 0
        while at + 8 <= end:
            stream.seek(at)
            size, name = struct.unpack(">I4s", stream.read(8))
            if size == 1 and at + 16 <= end:  # a box of more than 4 GB
                (size,) = struct.unpack(">Q", stream.read(8))
            if size < 8:
                return False
            names.add(name)
            at += size
    return at == end and b"moov" in names
