"""The tracker on scenes whose truth is known, at borders, on tiny and lost targets, and on bad input."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from camnet.errors import DataError
from camnet.sensing.visual import Box, CorrelationSettings, CorrelationTracker, TrackResult, overlap
from camnet.sensing.visual.patch import cut


def follow(scene, count: int, grey: bool = False, hints: bool = False, options=None) -> list[TrackResult]:
    tracker = CorrelationTracker(options)
    results = []
    for k in range(count):
        image = scene.image(k)
        if grey:
            image = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
        if k == 0:
            results.append(tracker.start(image, Box.about(scene.centre(0), 40.0, 60.0)))
        else:
            hint = scene.centre(k) if hints else None
            results.append(tracker.update(image, hint, 40.0 * scene.zoom(k) if hints else None))
    return results


@pytest.mark.parametrize("grey", [False, True])
def test_moving_target(scene, grey: bool) -> None:
    world = scene(velocity=(2.3, -0.7))
    results = follow(world, 40, grey)
    errors = [np.linalg.norm(r.box.centre - world.centre(k)) for k, r in enumerate(results)]
    widths = [r.box.width for r in results]
    assert max(errors) < 1.2
    assert max(abs(np.array(widths) - 40.0)) < 1.2
    assert min(r.psr for r in results) > 15.0


@pytest.mark.parametrize("growth", [0.008, -0.008])
def test_growing_target(scene, growth: float) -> None:
    world = scene(velocity=(0.5, 0.2), growth=growth)
    last = follow(world, 40)[-1].box
    assert abs(np.log(last.width / (40.0 * world.zoom(39)))) < 0.06
    assert np.linalg.norm(last.centre - world.centre(39)) < 2.0
    assert last.height / last.width == pytest.approx(1.5)
    hinted = follow(world, 40, hints=True)[-1].box
    assert abs(np.log(hinted.width / (40.0 * world.zoom(39)))) < 0.02  # about the true size there is no lag


@pytest.mark.parametrize("cell", [1, 2, 3, 4])
def test_every_cell_size(scene, cell: int) -> None:
    world = scene()
    options = CorrelationSettings(cell_px=cell, max_target_px=1000)
    errors = [
        np.linalg.norm(r.box.centre - world.centre(k))
        for k, r in enumerate(follow(world, 12, options=options))
    ]
    assert max(errors) < max(0.5 * cell / np.sqrt(1000 / 2400), 1.5)  # half a cell, in image pixels


def test_two_runs_agree_to_the_last_bit(scene) -> None:
    a, b = (follow(scene(growth=0.004), 12) for _ in range(2))
    assert a == b


def test_leaving_the_image_and_beyond(scene) -> None:
    world = scene(velocity=(-6.0, -8.0))
    for result in follow(world, 40):
        assert np.isfinite(result.box.as_array()).all()
        assert np.all(result.box.centre >= 0.0)
        assert np.all(result.box.centre <= [320.0, 240.0])


def test_target_that_reaches_over_the_border(scene) -> None:
    world = scene(start=(8.0, 20.0), velocity=(0.3, 0.4))
    results = follow(world, 30)
    assert np.linalg.norm(results[-1].box.centre - world.centre(29)) < 3.0


@given(
    st.floats(0.3, 30.0),
    st.floats(0.3, 30.0),
    st.floats(0, 1),
    st.floats(0, 1),
    st.integers(1, 60),
    st.integers(1, 60),
)
@settings(max_examples=12)
def test_no_box_or_image_is_too_small(
    w: float, h: float, u: float, v: float, rows: int, columns: int
) -> None:
    rng = np.random.default_rng(0)
    tracker = CorrelationTracker(CorrelationSettings(max_target_px=900))
    images = rng.integers(0, 256, size=(3, rows, columns), dtype=np.uint8)
    tracker.start(images[0], Box.about([u * columns, v * rows], w, h))
    for image in images[1:]:
        assert np.isfinite(tracker.update(image).box.as_array()).all()


def test_lost_target_is_reported_and_not_learnt(scene) -> None:
    world = scene(velocity=(0.0, 0.0))
    tracker = CorrelationTracker()
    first = tracker.start(world.image(0), Box.about(world.centre(0), 40.0, 60.0))
    seen = tracker.update(world.image(1))
    blank = np.full((240, 320, 3), 90, dtype=np.uint8)
    lost = [tracker.update(blank) for _ in range(30)]
    assert max(r.psr for r in lost) < 15.0 < seen.psr
    assert all(r.box == seen.box for r in lost)
    again = tracker.update(world.image(2))
    assert overlap(again.box, first.box) > 0.95
    assert again.psr > 15.0


def test_hint_finds_a_target_that_jumped(scene) -> None:
    world = scene(velocity=(0.0, 0.0))
    moved = scene(start=(230.0, 150.0), velocity=(0.0, 0.0))
    for hint, found in ((None, False), ((220.0, 155.0), True)):
        tracker = CorrelationTracker()
        tracker.start(world.image(0), Box.about(world.centre(0), 40.0, 60.0))
        result = tracker.update(moved.image(1), hint)
        assert bool(np.linalg.norm(result.box.centre - [230.0, 150.0]) < 1.5) is found


def test_static_border_does_not_hold_a_target_back() -> None:
    """A tall target whose patch reaches far over the image; what repeats at the border does not move with it."""
    scene = np.asarray(
        cv2.GaussianBlur(np.random.default_rng(4).integers(0, 256, (500, 300, 3)).astype(np.uint8), (0, 0), 3)
    )
    scene = cv2.normalize(scene, None, 0, 255, cv2.NORM_MINMAX)
    tracker = CorrelationTracker(CorrelationSettings(max_target_px=4000))
    shift = 0.25
    for k in range(60):
        part = cut(scene, np.array([150.0, 250.0 + shift * k]), np.array([200.0, 200.0]), (200, 200))
        result = tracker.update(part) if k else tracker.start(part, Box.about([100.0, 100.0], 50.0, 150.0))
    assert result.box.centre[1] == pytest.approx(100.0 - shift * 59, abs=1.2)


def test_cut_is_exact_on_a_ramp() -> None:
    """Bilinear samples and block means of a plane are its values at the sample's centre."""
    v, u = np.mgrid[0:60, 0:80]
    image = (2 * u + v).astype(np.uint8)[:, :, None]
    for size, shape in (((10.0, 8.0), (16, 20)), ((40.0, 32.0), (8, 10)), ((61.0, 41.0), (10, 12))):
        centre = np.array([40.3, 30.1])
        patch = cut(image, centre, np.array(size), shape)[:, :, 0].astype(float)
        x = centre[0] + size[0] * ((np.arange(shape[1]) + 0.5) / shape[1] - 0.5) - 0.5
        y = centre[1] + size[1] * ((np.arange(shape[0]) + 0.5) / shape[0] - 0.5) - 0.5
        assert np.max(np.abs(patch - (2 * x[None, :] + y[:, None]))) < 1.1


@pytest.mark.parametrize(
    ("image", "words"),
    [
        (np.zeros((20, 20)), "dtype float64"),
        (np.zeros((20, 20, 4), dtype=np.uint8), r"shape \(20, 20, 4\)"),
        (np.zeros((0, 20), dtype=np.uint8), "not empty"),
        ([[1, 2]], "is a list"),
    ],
)
def test_bad_images(image, words: str) -> None:
    with pytest.raises(DataError, match=words):
        CorrelationTracker().start(image, Box(2, 2, 5, 5))


def test_bad_boxes_and_hints() -> None:
    image = np.zeros((50, 50), dtype=np.uint8)
    for values, words in (((0, 0, 0, 5), "width is 0"), ((0, float("nan"), 2, 5), "y is nan")):
        with pytest.raises(DataError, match=words):
            Box(*values)
    tracker = CorrelationTracker()
    with pytest.raises(DataError, match="before start"):
        tracker.update(image)
    with pytest.raises(DataError, match="outside of the image"):
        tracker.start(image, Box(100, 100, 5, 5))
    tracker.start(image, Box(10, 10, 20, 20))
    with pytest.raises(DataError, match="centre_hint"):
        tracker.update(image, (1.0, float("inf")))
    with pytest.raises(DataError, match="width_hint"):
        tracker.update(image, None, -3.0)
    with pytest.raises(DataError, match="3 channels; 1 as in the first"):
        tracker.update(np.zeros((50, 50, 3), dtype=np.uint8))


def test_overlap_by_counting_pixels() -> None:
    rng = np.random.default_rng(5)
    for _ in range(20):
        a, b = (Box(*(int(v) for v in rng.integers((0, 0, 1, 1), (20, 20, 20, 20)))) for _ in range(2))
        masks = np.zeros((2, 40, 40), dtype=bool)
        for mask, box in zip(masks, (a, b), strict=True):
            mask[int(box.y) : int(box.y + box.height), int(box.x) : int(box.x + box.width)] = True
        assert overlap(a, b) == pytest.approx((masks[0] & masks[1]).sum() / (masks[0] | masks[1]).sum())
