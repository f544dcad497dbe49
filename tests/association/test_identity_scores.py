"""Identity scores against TrackEval, and against sums over everything."""

from itertools import permutations

import numpy as np
import pytest

from camnet.association.identity_scores import Frame, label_scores, track_scores


def _frames(rng, n=5, k=6, length=30, noise=0.25):
    frames = []
    for _ in range(length):
        truths = np.flatnonzero(rng.random(n) < 0.8)
        tracks = np.flatnonzero(rng.random(k) < 0.8)
        same = (truths[:, None] == tracks[None, :]).astype(float)
        similarity = np.clip(0.75 * same + noise * rng.random(same.shape), 0.0, 1.0)
        if rng.random() < 0.2:
            similarity = similarity[:, rng.permutation(len(tracks))]
        frames.append(Frame(truths, tracks, similarity))
    return frames


def _trackeval(frames, monkeypatch):
    monkeypatch.setattr(np, "float", float, raising=False)
    trackeval = pytest.importorskip("trackeval", exc_type=ImportError)
    n = 1 + max(int(f.truths.max(initial=0)) for f in frames)
    k = 1 + max(int(f.tracks.max(initial=0)) for f in frames)
    data = {
        "gt_ids": [f.truths for f in frames],
        "tracker_ids": [f.tracks for f in frames],
        "similarity_scores": [f.similarity for f in frames],
        "num_gt_ids": n,
        "num_tracker_ids": k,
        "num_gt_dets": sum(len(f.truths) for f in frames),
        "num_tracker_dets": sum(len(f.tracks) for f in frames),
        "num_timesteps": len(frames),
    }
    identity = trackeval.metrics.Identity({"PRINT_CONFIG": False}).eval_sequence(data)
    hota = trackeval.metrics.HOTA().eval_sequence(data)
    clear = trackeval.metrics.CLEAR({"PRINT_CONFIG": False}).eval_sequence(data)
    return {
        "IDF1": identity["IDF1"],
        "IDP": identity["IDP"],
        "IDR": identity["IDR"],
        "HOTA": hota["HOTA"].mean(),
        "AssA": hota["AssA"].mean(),
        "DetA": hota["DetA"].mean(),
        "switches": clear["IDSW"],
    }


@pytest.mark.parametrize("seed", range(8))
def test_equals_trackeval(seed, monkeypatch):
    frames = _frames(np.random.default_rng(seed))
    assert track_scores(frames) == pytest.approx(_trackeval(frames, monkeypatch), abs=1e-9)


def test_idf1_is_the_best_of_all_assignments():
    rng = np.random.default_rng(3)
    frames = _frames(rng, n=4, k=4)
    near = np.zeros((4, 4))
    for f in frames:
        near[np.ix_(f.truths, f.tracks)] += f.similarity >= 0.5
    best = max(sum(near[i, p[i]] for i in range(4)) for p in permutations(range(4)))
    count = sum(len(f.truths) + len(f.tracks) for f in frames)
    assert track_scores(frames)["IDF1"] == pytest.approx(2 * best / count)


@pytest.mark.parametrize("seed", range(4))
def test_labels_are_tracks_that_match_exactly(seed):
    rng = np.random.default_rng(seed)
    frames, truth, label, when = [], [], [], []
    for t in range(40):
        truths = np.flatnonzero(rng.random(5) < 0.7)
        tracks = rng.permutation(7)[: len(truths)]
        frames.append(Frame(truths, tracks, np.eye(len(truths))))
        truth += list(truths)
        label += list(tracks)
        when += [float(t)] * len(truths)
    quick = label_scores(np.array(truth), np.array(label), np.array(when))
    assert quick == pytest.approx(track_scores(frames))


def test_a_perfect_tracker_scores_one_and_no_tracker_nothing():
    frames = [Frame(np.arange(3), np.arange(3), np.eye(3)) for _ in range(4)]
    full = track_scores(frames)
    assert [full[k] for k in ("IDF1", "HOTA", "AssA", "switches")] == [1.0, 1.0, 1.0, 0.0]
    none = track_scores([Frame(np.arange(3), np.arange(0), np.zeros((3, 0)))])
    assert none["IDF1"] == none["HOTA"] == 0.0
