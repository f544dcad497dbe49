"""Image sequences with hand-drawn boxes, in the layout of the visual-tracking benchmarks (OTB, VOT 2013), and videos.

A sequence is a folder that holds ``img/`` (or the images themselves) and, if known, ``groundtruth_rect.txt``: a line
``x y w h`` an image, separated by commas, tabs or spaces, in pixels, the top left pixel being (1, 1). One line
alone is the box to start from. A line of four zeros or four NaN says that the target is not visible. A video may have a
file of the same form beside it, named as the video with ``.txt``.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from camnet.errors import DataError
from camnet.importers._reading import number, text_lines
from camnet.sensing.visual.box import Box

__all__ = ["ImageSequence", "open_images", "open_sequence", "read_boxes"]

_IMAGES = (".jpg", ".jpeg", ".png", ".bmp", ".ppm", ".pgm", ".tif", ".tiff")
_NAMES = ("groundtruth_rect.txt", "groundtruth.txt")
_FIELDS = ("x", "y", "width", "height")


@dataclass(frozen=True, slots=True)
class ImageSequence:
    """Images in order, read when they are asked for.

    Attributes
    ----------
    name : of the folder or video
    source : video file, or folder of the sequence
    images : files in order; empty for a video
    boxes : true boxes, None where the target is not visible; one alone is the box to start from; may be empty
    rate_hz : of a video, None for a folder
    """

    name: str
    source: Path
    images: tuple[Path, ...]
    boxes: tuple[Box | None, ...]
    rate_hz: float | None

    def frames(self) -> Iterator[NDArray[np.uint8]]:
        """Yield the images (H, W, 3), blue first.

        Raises
        ------
        DataError : an image cannot be decoded, or not even one could be read from the video
        """
        yield from self._from_files() if self.images else self._from_video()

    def _from_files(self) -> Iterator[NDArray[np.uint8]]:
        for path in self.images:
            image = cv2.imread(str(path), cv2.IMREAD_COLOR)
            if image is None:
                raise DataError(f"{path}: cannot be decoded as an image; a whole image file was expected")
            yield np.asarray(image, dtype=np.uint8)

    def _from_video(self) -> Iterator[NDArray[np.uint8]]:
        capture = cv2.VideoCapture(str(self.source))
        count = 0
        try:
            while True:
                sound, image = capture.read()
                if not sound:
                    break
                count += 1
                yield np.asarray(image, dtype=np.uint8)
        finally:
            capture.release()
        if count == 0:
            raise DataError(f"{self.source}: no frame could be decoded; a video file was expected")


def open_images(source: str | Path) -> ImageSequence:
    """Open a video, or a folder of images, without boxes.

    Raises
    ------
    DataError : no such place, no images, or a hole in their numbers
    """
    path = Path(source)
    if path.is_dir():
        return ImageSequence(path.resolve().name, path, _image_files(path), (), None)
    if not path.is_file():
        raise DataError(f"{path}: no such file or folder; name a folder of images or a video")
    return ImageSequence(path.stem, path, (), (), _video_rate(path))


def open_sequence(source: str | Path, first: Box | None = None) -> ImageSequence:
    """Open a folder of images or a video.

    Parameters
    ----------
    source : folder (see the head of this module) or video file
    first : box in the first image, for a source without a ground truth

    Raises
    ------
    DataError : no images, a hole in their numbers, a malformed ground truth, or no box to start from
    """
    path = Path(source)
    if path.is_dir():
        images, rate = _image_files(path), None
        candidates = (
            [folder / name for folder in (path, path.parent) for name in _NAMES] if path.name == "img" else []
        )
        candidates += [path / name for name in _NAMES]
    elif path.is_file():
        images, rate = (), _video_rate(path)
        candidates = [path.with_suffix(".txt")]
    else:
        raise DataError(f"{path}: no such file or folder; name a folder of images or a video")
    truth = next((file for file in candidates if file.is_file()), None)
    boxes: tuple[Box | None, ...] = () if truth is None else tuple(read_boxes(truth))
    if first is not None:
        boxes = (first, *boxes[1:])
    if not boxes:
        wanted = candidates[0]
        raise DataError(f"{path}: where is the target? Give its box in the first image, or the file {wanted}")
    if boxes[0] is None:
        raise DataError(
            f"{truth}, line 1: the target is not visible in the first image; a box to start from was expected"
        )
    if images and len(boxes) not in (1, len(images)):
        raise DataError(
            f"{truth}: {len(boxes)} boxes for {len(images)} images in {images[0].parent}; one each was expected"
        )
    return ImageSequence(path.resolve().name, path, images, boxes, rate)


def read_boxes(path: Path) -> list[Box | None]:
    """Boxes of a ground-truth file, in our coordinates (the image's corner is (0, 0)); None where not visible."""
    boxes: list[Box | None] = []
    for line, text in text_lines(path):
        if not text.strip():
            continue
        where = f"{path}, line {line}"
        parts = [part for part in re.split(r"[,;\s]+", text.strip()) if part]
        if len(parts) != 4:
            raise DataError(
                f"{where}: {text!r} has {len(parts)} values; x, y, width and height were expected"
            )
        if all(part.lower() == "nan" for part in parts):
            boxes.append(None)
            continue
        x, y, width, height = (number(part, where, field) for part, field in zip(parts, _FIELDS, strict=True))
        if x == y == width == height == 0.0:
            boxes.append(None)
            continue
        for field, value in (("width", width), ("height", height)):
            if value <= 0.0:
                raise DataError(f"{where}: {field} is {value:g}; a number of pixels above 0 was expected")
        boxes.append(Box(x - 1.0, y - 1.0, width, height))
    if not boxes:
        raise DataError(f"{path}: is empty; a line x, y, width, height an image was expected")
    return boxes


def _image_files(folder: Path) -> tuple[Path, ...]:
    inside = folder / "img" if (folder / "img").is_dir() else folder
    files = sorted((f for f in inside.iterdir() if f.suffix.lower() in _IMAGES), key=_order)
    if not files:
        raise DataError(
            f"{inside}: holds no images ({', '.join(_IMAGES[:3])}, ...); numbered images were expected"
        )
    numbers = [_order(file)[0] for file in files]
    for before, after, file in zip(numbers, numbers[1:], files[1:], strict=False):
        if after - before > 1 and before >= 0:
            raise DataError(
                f"{inside}: image {before + 1} is missing before {file.name}; consecutive numbers were expected"
            )
    return tuple(files)


def _order(path: Path) -> tuple[int, str]:
    digits = re.findall(r"\d+", path.stem)
    return (int(digits[-1]) if digits else -1, path.name)


def _video_rate(path: Path) -> float:
    capture = cv2.VideoCapture(str(path))
    try:
        if not capture.isOpened():
            raise DataError(
                f"{path}: cannot be opened as a video; a video file or a folder of images was expected"
            )
        rate = float(capture.get(cv2.CAP_PROP_FPS))
    finally:
        capture.release()
    return rate if np.isfinite(rate) and 0.1 < rate < 1000.0 else 25.0
