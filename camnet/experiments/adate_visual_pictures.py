"""Pictures of visual tracking: the annotated video (H.264) and the overlap over time."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import cv2
import numpy as np
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from camnet.report.encode import video_file
from camnet.report.style import figure_style, save
from camnet.sensing.visual.box import Box
from camnet.sensing.visual.patch import Image
from camnet.types import Array

__all__ = ["annotate", "write_overlap_plot", "write_tracking_video"]

_COLOURS = {"truth": "#ffd60a", "tracker": "#2f6bff", "adate_smoothed": "#2a9d5c", "adate_causal": "#e5202c"}
_LABELS = {
    "truth": "hand-drawn",
    "tracker": "tracker alone",
    "adate_smoothed": "AdaTE, smoothed",
    "adate_causal": "AdaTE, causal",
}
_SHIFT = 4  # OpenCV draws at sixteenths of a pixel


def annotate(image: Image, boxes: Mapping[str, Box | None], number: int) -> Image:
    """Draw boxes by row name on a copy of an image (H, W, 3), blue first; returned red first."""
    frame = np.ascontiguousarray(image[:, :, ::-1])
    size = max(0.4, min(frame.shape[:2]) / 800.0)
    line = round(34 * size)
    _text(frame, f"{number}", (8, line), (255, 255, 255), size)
    for place, (row, box) in enumerate(boxes.items(), start=2):
        if box is None:
            continue
        colour = tuple(round(255 * c) for c in to_rgb(_COLOURS[row]))
        corners = np.array([[box.x, box.y], [box.x + box.width, box.y + box.height]]) - 0.5
        first, last = np.round(np.clip(corners, -1e4, 1e4) * 2**_SHIFT).astype(int).tolist()
        cv2.rectangle(frame, first, last, colour, 1, cv2.LINE_AA, _SHIFT)
        _text(frame, _LABELS[row], (8, place * line), colour, size)
    return frame


def write_tracking_video(
    frames: Iterator[Image],
    rows: Mapping[str, Sequence[Box]],
    truth: Sequence[Box | None],
    rate_hz: float,
    path: Path,
) -> None:
    """Write the images with the boxes of every row.

    Raises
    ------
    OSError : the encoder could not be started or failed
    """
    order = [row for row in _COLOURS if row in rows]
    size: tuple[int, int] | None = None
    with video_file(path, rate_hz, quality=7) as add:
        for k, image in enumerate(frames):
            frame = annotate(image, {"truth": truth[k], **{row: rows[row][k] for row in order}}, k + 1)
            size = size or (frame.shape[1], frame.shape[0])
            if (frame.shape[1], frame.shape[0]) != size:  # a video's frames are all of one size
                frame = np.asarray(cv2.resize(frame, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
            add(frame)


def write_overlap_plot(overlaps: Mapping[str, Array], path: Path) -> None:
    """Plot the overlap with the hand-drawn box over the images."""
    with figure_style():
        figure = Figure(figsize=(9, 3.6))
        axes = figure.subplots()
        for row, values in overlaps.items():
            if np.isfinite(values).any():
                label = f"{_LABELS[row]}: mean {np.nanmean(values):.4f}"
                axes.plot(
                    np.arange(1, len(values) + 1), values, color=_COLOURS[row], linewidth=0.9, label=label
                )
        if axes.lines:
            axes.legend(loc="lower left")
        else:
            axes.text(0.5, 0.5, "no hand-drawn boxes to compare with", ha="center", transform=axes.transAxes)
        axes.set(xlabel="image", ylabel="overlap (intersection / union)", ylim=(0.0, 1.02))
        save(figure, path)


def _text(frame: Image, words: str, at: tuple[int, int], colour: tuple[int, ...], size: float) -> None:
    cv2.putText(frame, words, at, cv2.FONT_HERSHEY_SIMPLEX, size, (0, 0, 0), 3, cv2.LINE_AA)
    cv2.putText(frame, words, at, cv2.FONT_HERSHEY_SIMPLEX, size, colour, 1, cv2.LINE_AA)
