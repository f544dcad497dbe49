"""The experiment on a part of a recorded sequence, reading of sequences, and what is said of bad ones."""

from __future__ import annotations

import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

from camnet.errors import DataError
from camnet.experiments.adate_visual import run
from camnet.importers.image_sequence import open_sequence, read_boxes
from camnet.sensing.visual import Box


@pytest.fixture
def folder(tmp_path: Path, scene) -> Path:
    """Four images of a moving target, with their boxes."""
    world = scene()
    (tmp_path / "walk" / "img").mkdir(parents=True)
    lines = []
    for k in range(4):
        cv2.imwrite(str(tmp_path / "walk" / "img" / f"{k + 1:04d}.png"), world.image(k))
        x, y = world.centre(k) - [20.0, 30.0] + 1.0
        lines.append(f"{x},{y},40,60\n")
    (tmp_path / "walk" / "groundtruth_rect.txt").write_text("".join(lines))
    return tmp_path / "walk"


def test_run_writes_everything(folder: Path, tmp_path: Path) -> None:
    shares: list[float] = []
    out = tmp_path / "out"
    result = run(folder, out, 0, shares.append)
    assert set(result) == {"sequence", "overlap", "fps"}
    assert result["sequence"] == "walk"
    assert list(result["overlap"]) == ["tracker", "adate_causal", "adate_smoothed"]
    assert min(result["overlap"].values()) > 0.9
    assert shares == sorted(shares)
    assert shares[-1] == 1.0
    assert sorted(p.name for p in out.iterdir()) == ["boxes.csv", "overlap.png", "tracking.mp4"]
    assert len((out / "boxes.csv").read_text().splitlines()) == 5
    again = run(folder, None, 1, None)
    assert again["overlap"] == result["overlap"]


def test_video_with_a_box_is_tracked_as_its_images(folder: Path, tmp_path: Path) -> None:
    first = run(folder, tmp_path / "a", 0, None)
    second = run(tmp_path / "a" / "tracking.mp4", None, 0, None, first=Box(60.0, 70.0, 40.0, 60.0))
    assert second["overlap"] == {"tracker": None, "adate_causal": None, "adate_smoothed": None}
    shutil.copy(folder / "groundtruth_rect.txt", tmp_path / "a" / "tracking.txt")
    third = run(tmp_path / "a" / "tracking.mp4", None, 0, None)
    assert third["overlap"]["tracker"] > 0.9 * first["overlap"]["tracker"]


def test_invisible_targets_do_not_count(folder: Path) -> None:
    lines = (folder / "groundtruth_rect.txt").read_text().splitlines()
    lines[2] = "NaN NaN NaN NaN"
    lines[3] = "0 0 0 0"
    (folder / "groundtruth_rect.txt").write_text("\n".join(lines))
    assert [box is None for box in open_sequence(folder).boxes] == [False, False, True, True]
    assert run(folder)["overlap"]["tracker"] > 0.9


@pytest.mark.parametrize("text", ["51,53,87,290", "51\t53\t87\t290", " 51 53  87 290 \r"])
def test_boxes_are_read_in_every_layout(tmp_path: Path, text: str) -> None:
    file = tmp_path / "groundtruth_rect.txt"
    file.write_text(text + "\n\n")
    assert read_boxes(file) == [Box(50.0, 52.0, 87.0, 290.0)]


def _drop(folder: Path) -> None:
    (folder / "img" / "0003.png").unlink()


def _empty(folder: Path) -> None:
    shutil.rmtree(folder / "img")
    (folder / "img").mkdir()


def _truth(text: str):
    return lambda folder: (folder / "groundtruth_rect.txt").write_text(text)


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (_drop, r"img: image 3 is missing before 0004\.png"),
        (_empty, "img: holds no images"),
        (_truth(""), r"groundtruth_rect\.txt: is empty"),
        (_truth("1,2,3\n"), "line 1: '1,2,3' has 3 values"),
        (_truth("1,2,30,40\n1,x,30,40\n"), "line 2: y is 'x'"),
        (_truth("1,2,30,-4\n"), "line 1: height is -4"),
        (_truth("1,2,inf,4\n"), "line 1: width is 'inf'"),
        (_truth("0,0,0,0\n1,2,3,4\n1,2,3,4\n1,2,3,4\n"), "line 1: the target is not visible"),
        (_truth("60,70,40,60\n60,70,40,60\n"), "2 boxes for 4 images"),
        (_truth("600,700,40,60\n"), "outside of the image"),
        (lambda f: (f / "groundtruth_rect.txt").unlink(), "where is the target"),
        (lambda f: (f / "img" / "0002.png").write_bytes(b"no image"), r"0002\.png: cannot be decoded"),
    ],
)
def test_bad_sequences_are_named(folder: Path, spoil, words: str) -> None:
    spoil(folder)
    with pytest.raises(DataError, match=words):
        run(folder)


def test_bad_sources(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="no such file or folder"):
        run(tmp_path / "nothing")
    (tmp_path / "film.mp4").write_bytes(b"this is not a film")
    with pytest.raises(DataError, match="cannot be opened as a video"):
        run(tmp_path / "film.mp4", first=Box(1, 1, 5, 5))


def test_short_part_of_a_recorded_sequence(shared_data: Path, tmp_path: Path) -> None:
    source = shared_data / "singer1"
    (tmp_path / "part" / "img").mkdir(parents=True)
    for k in range(1, 26):
        shutil.copy(source / "img" / f"{k:04d}.jpg", tmp_path / "part" / "img")
    lines = (source / "groundtruth_rect.txt").read_text().splitlines()[:25]
    (tmp_path / "part" / "groundtruth_rect.txt").write_text("\n".join(lines))
    overlap = run(tmp_path / "part")["overlap"]
    assert overlap["tracker"] > 0.88
    assert overlap["adate_causal"] > 0.88


@pytest.mark.slow
def test_whole_recorded_sequence(shared_data: Path, tmp_path: Path) -> None:
    result = run(shared_data / "singer1", tmp_path)
    assert result["overlap"]["tracker"] > 0.84  # 0.858 measured, 0.804 published
    assert result["overlap"]["adate_causal"] > result["overlap"]["tracker"]
    assert np.isfinite(result["fps"])
    capture = cv2.VideoCapture(str(tmp_path / "tracking.mp4"))
    assert int(capture.get(cv2.CAP_PROP_FRAME_COUNT)) == 351
