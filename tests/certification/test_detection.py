"""What counts as seen where detectors miss: against random frames, every walk, certificates and designs."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import yaml

from camnet.certification.coverage import Coverage
from camnet.certification.detection import detected, frames_needed, time_in_view_s
from camnet.certification.road_arcs import arcs_from_polylines
from camnet.certification.settings import DetectionSettings
from camnet.cli.main import main


@pytest.fixture(scope="module")
def depot():
    return Path(__file__).parent / "data" / "depot.yaml"


@pytest.mark.parametrize(
    ("count", "probability", "confidence"), [(1, 0.5, 0.9), (3, 0.8, 0.99), (5, 0.3, 0.95)]
)
def test_so_many_frames_hold_the_detections_and_one_fewer_does_not(count, probability, confidence):
    settings = DetectionSettings(
        rate_hz=7.0, probability=probability, count=count, confidence=confidence, latency_s=0.3
    )
    n, rng = frames_needed(settings), np.random.default_rng(0)
    assert time_in_view_s(settings) == pytest.approx(n / 7.0 + 0.3)
    for frames, enough in ((n, True), (n - 1, False)):
        hits = (rng.random((400_000, frames)) < probability).sum(axis=1) >= count
        assert (hits.mean() >= confidence - 0.002) == enough or abs(hits.mean() - confidence) < 0.002
    # a target that is in view for n / f meets n frames whenever the first of them comes
    phase = rng.random(10_000) / 7.0
    inside = np.floor((n / 7.0 - phase) * 7.0 + 1e-9) + 1
    assert inside.min() >= n


def _random_site(rng):
    """Return roads whose arcs lead on at random, and stretches in view of two cameras."""
    n = 6
    lengths = rng.integers(2, 9, n).astype(float)
    lines = [np.array([[0.0, 10.0 * k], [lengths[k], 10.0 * k]]) for k in range(n)]
    successors = [sorted(set(rng.choice(n, int(rng.integers(1, 3))).tolist())) for _ in range(n)]
    rows = []
    for arc in range(n):
        for camera in range(2):
            kind = int(rng.integers(0, 5))
            whole = lengths[arc]
            cuts = {0: [], 1: [(0, whole)], 2: [(0, whole / 2)], 3: [(whole / 2, whole)]}.get(
                kind, [(0, whole / 4), (whole / 2, whole)]
            )
            rows += [(arc, camera, a, b) for a, b in cuts]
    arc, camera, start, end = np.array(sorted(rows, key=lambda r: (r[0], r[2])), dtype=float).T
    nothing = np.zeros(len(arc))
    cover = Coverage(arc.astype(int), camera.astype(int), start, end, nothing, 0.5 * (start + end))
    return arcs_from_polylines(lines, successors), successors, lengths, cover


def _in_view(cover, arc, camera, s):
    rows = (cover.arc == arc) & (cover.camera == camera)
    return bool((rows & (cover.start_m - 1e-9 <= s) & (s <= cover.end_m + 1e-9)).any())


def _always(cover, follow, lengths, arc, camera, cell, cells, forward):
    """Whether each walk from a cell of 0.25 m has the next ``cells`` in view, by brute force."""
    if cells == 0:
        return True
    cell += 1 if forward else -1
    if 0 <= cell < 4 * lengths[arc]:
        seen = _in_view(cover, arc, camera, 0.25 * cell + 0.125)
        return seen and _always(cover, follow, lengths, arc, camera, cell, cells - 1, forward)
    return bool(follow[arc]) and all(
        _always(cover, follow, lengths, b, camera, -1 if forward else 4 * int(lengths[b]), cells, forward)
        for b in follow[arc]
    )


@pytest.mark.parametrize("seed", range(12))
def test_trimmed_views_agree_with_every_walk(seed):
    rng = np.random.default_rng(seed)
    roads, successors, lengths, cover = _random_site(rng)
    before = [[a for a, b in enumerate(successors) if arc in b] for arc in range(len(lengths))]
    d = float(rng.choice([0.5, 1.5, 3.5]))
    left = detected(cover, roads, d)
    for arc in range(len(lengths)):
        for camera in range(2):
            for cell in range(4 * int(lengths[arc])):  # views begin and end between cells
                s = 0.25 * cell + 0.125
                back = _always(cover, before, lengths, arc, camera, cell, round(4 * d), False)
                ahead = _always(cover, successors, lengths, arc, camera, cell, round(4 * d), True)
                counts = _in_view(left, arc, camera, s)
                assert counts == (_in_view(cover, arc, camera, s) and back and ahead), (arc, camera, s, d)


def _certified(capsys, *words):
    status = main(["certify", *map(str, words), "--json", "--quiet"])
    return status, json.loads(capsys.readouterr().out)


def test_a_certificate_counts_detections_and_a_design_keeps_to_them(capsys, depot, rays, tmp_path):
    _, plain = _certified(capsys, depot)
    _, strict = _certified(capsys, depot, "--detections", "2,0.9,10,0.99")
    frames = frames_needed(DetectionSettings(rate_hz=10, probability=0.9, count=2))
    d = 2.0 * frames / 10.0  # the guard's v_max is 2 m/s
    longer = strict["promise"]["unseen_max_m"] - plain["promise"]["unseen_max_m"]
    assert longer == pytest.approx(2.0 * d, abs=0.01)  # the same gap, later seen and earlier lost
    assert any(f"{frames} frames" in words for words in strict["assumptions"])
    words = ("--mounts", "walls:8,5", "--existing", "replace", "--aim-step", "45", "--off-max", "30")
    folder = tmp_path / "d"
    asked = [
        "design",
        str(depot),
        *words,
        "--detections",
        "2,0.9,10,0.99",
        "--out",
        str(folder),
        "--json",
        "--quiet",
    ]
    assert main(asked) == 0
    report = json.loads(capsys.readouterr().out)
    world = yaml.safe_load((folder / "world.yaml").read_text())
    assert world["certificate"]["detection"]["count"] == 2
    status, again = _certified(capsys, folder / "world.yaml")
    assert (status, again["promise"]["unseen_max_m"]) == (0, report["promise"]["unseen_max_m"])
    hidden = rays.longest_hidden(world)
    assert hidden + 2.0 * d <= report["promise"]["unseen_max_m"] + 0.2 <= 0.8 * 30.0 + 0.2


@pytest.mark.parametrize(
    "text", ["3", "3,0.8", "0,0.8,10", "1.5,0.8,10", "3,1.8,10", "3,0.8,0", "3,0.8,10,1", "a,b,c"]
)
def test_detections_that_are_none_are_refused(capsys, depot, text):
    assert main(["certify", str(depot), "--detections", text, "--quiet"]) == 2
    assert f"--detections {text}: " in capsys.readouterr().err


def test_agents_have_no_detections(capsys):
    assert main(["certify", "quickstart", "--detections", "3,0.8,10", "--quiet"]) == 2
    assert "is about fixed cameras" in capsys.readouterr().err
