"""Visual tracking with and without AdaTE (li2019, section V.C, table II).

| row | what |
| --- | --- |
| tracker | the correlation tracker alone: each search about the last place |
| adate_causal | AdaTE on a second tracker's boxes, its prediction the next search centre; from the images so far |
| adate_smoothed | the same run's trajectory after the last image: also from later images, within AdaTE's window |

The published "with AdaTE" compares a smoothed trajectory with an online tracker; here the two are apart. Overlap is
the intersection over the union of the estimated and the hand-drawn box, averaged over all images in which the
target is visible, the first included. ``fps`` is the number of images of the AdaTE run over the processor time, on
one core, to decode, track and filter them: what other programs take meanwhile does not count.
"""

from __future__ import annotations

import csv
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from camnet.errors import DataError
from camnet.estimation.visual_filter import (
    VisualFilterSettings,
    VisualTrajectoryFilter,
    follow,
    nominal_intrinsics,
)
from camnet.experiments.adate_visual_pictures import write_overlap_plot, write_tracking_video
from camnet.geometry.settings import Intrinsics
from camnet.importers.image_sequence import ImageSequence, open_sequence
from camnet.sensing.visual import Box, CorrelationSettings, CorrelationTracker, overlap
from camnet.storage.whole_file import whole_file
from camnet.types import Array

__all__ = ["VisualRun", "run", "summarise", "track_sequence"]

Progress = Callable[[float], None]
_PASSES = 3


@dataclass(frozen=True, eq=False, slots=True)
class VisualRun:
    """Boxes of every image: ``rows`` by name and ``truth`` (None where not visible or not known).

    ``response_peak`` (n,) and ``psr`` (n,) are those of the AdaTE run's tracker, ``fps`` is that run's speed.
    """

    sequence: ImageSequence
    rows: dict[str, list[Box]]
    truth: list[Box | None]
    response_peak: Array
    psr: Array
    fps: float

    def overlaps(self, row: str) -> Array:
        """Overlap (n,) of a row with the truth, NaN where there is none."""
        pairs = zip(self.rows[row], self.truth, strict=True)
        return np.array([np.nan if b is None else overlap(a, b) for a, b in pairs])


def run(
    sequence: Path,
    out_dir: Path | None = None,
    seed: int = 0,
    progress: Progress | None = None,
    *,
    first: Box | None = None,
    tracking: CorrelationSettings | None = None,
    filtering: VisualFilterSettings | None = None,
    intrinsics: Intrinsics | None = None,
) -> dict[str, Any]:
    """Track a target through a folder of images or a video; ``{"sequence", "overlap", "fps"}``.

    Parameters
    ----------
    sequence : folder with ``img/`` and ``groundtruth_rect.txt``, or a video file
    out_dir : where ``tracking.mp4``, ``overlap.png`` and ``boxes.csv`` go; nothing is written when left out
    seed : has no effect, as nothing is drawn at random; part of every experiment's signature
    progress : called with the share of the work done
    first : box in the first image, for a sequence without ground truth (the overlaps are then None)
    tracking, filtering : settings
    intrinsics : of the camera; nominal when left out

    Raises
    ------
    DataError : missing or unreadable images, malformed ground truth
    """
    result = track_sequence(open_sequence(sequence, first), progress, tracking, filtering, intrinsics)
    if out_dir is not None:
        out_dir.mkdir(parents=True, exist_ok=True)
        _write_boxes(result, out_dir / "boxes.csv")
        write_overlap_plot({row: result.overlaps(row) for row in result.rows}, out_dir / "overlap.png")
        rate = result.sequence.rate_hz or 25.0
        write_tracking_video(
            result.sequence.frames(), result.rows, result.truth, rate, out_dir / "tracking.mp4"
        )
    if progress is not None:
        progress(1.0)
    return summarise(result)


def reproduce(
    seeds: int,
    out_dir: Path | None,
    seed: int,
    progress: Progress | None,
    data: Path,
) -> dict[str, Any]:
    """Run the experiment on the sequence ``data``; nothing is random, so ``seeds`` is without effect."""
    return run(data, out_dir, seed, progress)


def print_table(result: dict[str, Any]) -> None:
    """Print the mean overlaps and the speed."""
    for row, value in result["overlap"].items():
        shown = "no ground truth" if value is None else f"{value:.4f}"
        print(f"mean overlap, {row:16s} {shown}")  # noqa: T201 - the command's table
    print(f"{result['fps']:.1f} frames a second of CPU time")  # noqa: T201


def track_sequence(
    sequence: ImageSequence,
    progress: Progress | None = None,
    tracking: CorrelationSettings | None = None,
    filtering: VisualFilterSettings | None = None,
    intrinsics: Intrinsics | None = None,
) -> VisualRun:
    """All rows of a sequence; parameters as in `run`."""
    if filtering is None:
        filtering = VisualFilterSettings(frame_rate_hz=sequence.rate_hz or 25.0)
    total = _PASSES * len(sequence.images)
    report = _reporter(progress, total)
    with _one_thread():
        plain = _plain(sequence, CorrelationTracker(tracking), report)
        causal, trajectory, answers, seconds = _filtered(
            sequence, CorrelationTracker(tracking), filtering, intrinsics, report
        )
    smoothed = [box or fallback for box, fallback in zip(trajectory.smoothed(), causal, strict=True)]
    truth: list[Box | None] = list(sequence.boxes) if len(sequence.boxes) > 1 else [None for _ in plain]
    if len(truth) != len(plain):
        raise DataError(
            f"{sequence.source}: {len(truth)} boxes for {len(plain)} frames; one each was expected"
        )
    rows = {"tracker": plain, "adate_causal": causal, "adate_smoothed": smoothed}
    return VisualRun(sequence, rows, truth, answers[:, 0], answers[:, 1], len(causal) / seconds)


def summarise(result: VisualRun) -> dict[str, Any]:
    """Mean overlap of each row (None without a ground truth) and the speed."""
    known = any(box is not None for box in result.truth)
    means = {row: float(np.nanmean(result.overlaps(row))) if known else None for row in result.rows}
    return {"sequence": result.sequence.name, "overlap": means, "fps": result.fps}


def _plain(sequence: ImageSequence, tracker: CorrelationTracker, report: Callable[[], None]) -> list[Box]:
    boxes: list[Box] = []
    for image in sequence.frames():
        result = tracker.update(image) if boxes else tracker.start(image, _first(sequence))
        boxes.append(result.box)
        report()
    return boxes


def _filtered(
    sequence: ImageSequence,
    tracker: CorrelationTracker,
    settings: VisualFilterSettings,
    intrinsics: Intrinsics | None,
    report: Callable[[], None],
) -> tuple[list[Box], VisualTrajectoryFilter, Array, float]:
    """Causal boxes, the filter, (n,2) response peaks and peak-to-sidelobe ratios, and the time taken."""
    causal: list[Box] = []
    answers: list[tuple[float, float]] = []
    trajectory: VisualTrajectoryFilter | None = None
    seconds, since = 0.0, time.thread_time()
    for image in sequence.frames():
        if trajectory is None:
            camera = intrinsics or nominal_intrinsics(image.shape[1], image.shape[0])
            trajectory = VisualTrajectoryFilter(camera, settings)
            result = tracker.start(image, _first(sequence))
            box = trajectory.update(result)
        else:
            result, box = follow(tracker, trajectory, image)
        causal.append(box)
        answers.append((result.response_peak, result.psr))
        seconds += time.thread_time() - since
        report()
        since = time.thread_time()
    if trajectory is None:
        raise DataError(f"{sequence.source}: holds no image")
    return causal, trajectory, np.array(answers), seconds


def _first(sequence: ImageSequence) -> Box:
    first = sequence.boxes[0]
    if first is None:
        raise DataError(
            f"{sequence.source}: the target is not visible in the first image; a box was expected"
        )
    return first


def _reporter(progress: Progress | None, total: int) -> Callable[[], None]:
    """Count images; the length of a video is not known beforehand, so that it reports at the end only."""
    done = 0

    def report() -> None:
        nonlocal done
        done += 1
        if progress is not None and total:
            progress(min(done / total, 1.0))

    return report


@contextmanager
def _one_thread() -> Iterator[None]:
    """OpenCV on one core within the block."""
    before = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(before)


def _write_boxes(result: VisualRun, path: Path) -> None:
    """``boxes.csv``: a line an image; boxes as left, top, width, height in px from the corner (0, 0)."""
    fields = ("x", "y", "width", "height")
    with whole_file(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream)
        names = [f"{row}_{field}" for row in result.rows for field in fields]
        writer.writerow(["image", *names, *(f"{row}_overlap" for row in result.rows), "response_peak", "psr"])
        overlaps = [result.overlaps(row) for row in result.rows]
        for k in range(len(result.truth)):
            boxes = [f"{value:.3f}" for row in result.rows.values() for value in row[k].as_array()]
            scores = [f"{values[k]:.4f}" for values in overlaps]
            writer.writerow(
                [k + 1, *boxes, *scores, f"{result.response_peak[k]:.4f}", f"{result.psr[k]:.2f}"]
            )
