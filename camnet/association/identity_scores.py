"""How well identities were kept: IDF1, HOTA and identity switches.

| symbol | name | meaning |
| --- | --- | --- |
| IDTP | | detections of a truth that the track it is assigned to also has, one track a truth, as many as can be |
| IDF1, IDP, IDR | | 2 IDTP / (truths + detections), IDTP / detections, IDTP / truths |
| A(c) | | TPA / (TPA + FNA + FPA) of a match c: how much of both identities is matched with one another |
| AssA, DetA, HOTA | | mean of A(c), TP / (TP + FN + FP), their geometric mean; averaged over 19 similarities |
| switches | | matches of a truth whose track is not the one it was matched with last |

IDF1: Ristani et al. 2016, eqs. (5) to (11). HOTA: Luiten et al. 2021, eqs. (9), (12), (15), (18). Switches:
Bernardin and Stiefelhagen 2008.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from camnet.types import Array, IntArray

__all__ = ["Frame", "label_scores", "track_scores"]

_ALPHAS = np.arange(1, 20) * 0.05
_EPS = np.finfo(np.float64).eps


@dataclass(frozen=True, eq=False, slots=True)
class Frame:
    """One instant: truths (n,) and tracks (k,), numbered from 0, each once, and their similarity (n, k) in [0, 1]."""

    truths: IntArray
    tracks: IntArray
    similarity: Array


def track_scores(frames: Sequence[Frame], threshold: float = 0.5) -> dict[str, float]:
    """Score tracks against truths; ``threshold`` is the least similarity of a match for IDF1 and switches."""
    n = 1 + max((int(f.truths.max()) for f in frames if len(f.truths)), default=-1)
    k = 1 + max((int(f.tracks.max()) for f in frames if len(f.tracks)), default=-1)
    near, align = np.zeros((n, k)), np.zeros((n, k))
    truths, tracks = np.zeros(n), np.zeros(k)
    for f in frames:
        cell = np.ix_(f.truths, f.tracks)
        near[cell] += f.similarity >= threshold
        either = f.similarity.sum(0)[None, :] + f.similarity.sum(1)[:, None] - f.similarity
        align[cell] += np.where(either > _EPS, f.similarity / np.maximum(either, _EPS), 0.0)
        truths[f.truths] += 1
        tracks[f.tracks] += 1
    jaccard = align / np.maximum(truths[:, None] + tracks[None, :] - align, _EPS)
    scores = _id_scores(near, truths, tracks)
    return scores | _hota(frames, jaccard, truths, tracks) | {"switches": _switches(frames, n, threshold)}


def label_scores(truth: IntArray, label: IntArray, t_s: Array) -> dict[str, float]:
    """Score labels (n,) of detections of known true identity (n,) at times (n,), none of which is missing.

    What `track_scores` gives where every detection matches its own truth and nothing else.
    """
    n, k = int(truth.max()) + 1, int(label.max()) + 1
    both = np.zeros((n, k))
    np.add.at(both, (truth, label), 1.0)
    rows, columns = both.sum(axis=1), both.sum(axis=0)
    a = both / np.maximum(rows[:, None] + columns[None, :] - both, 1.0)
    ass = float((both * a).sum() / len(truth))
    order = np.lexsort((t_s, truth))
    changed = (np.diff(label[order]) != 0) & (np.diff(truth[order]) == 0)
    hota = {"HOTA": float(np.sqrt(ass)), "AssA": ass, "DetA": 1.0}
    return _id_scores(both, rows, columns) | hota | {"switches": float(changed.sum())}


def _id_scores(near: Array, truths: Array, tracks: Array) -> dict[str, float]:
    rows, columns = linear_sum_assignment(-near)
    both = float(near[rows, columns].sum())
    n, k = float(truths.sum()), float(tracks.sum())
    return {
        "IDF1": 2.0 * both / max(n + k, 1.0),
        "IDP": both / max(k, 1.0),
        "IDR": both / max(n, 1.0),
    }


def _hota(frames: Sequence[Frame], jaccard: Array, truths: Array, tracks: Array) -> dict[str, float]:
    matches = np.zeros((len(_ALPHAS), *jaccard.shape))
    for f in frames:
        if not len(f.truths) or not len(f.tracks):
            continue
        rows, columns = linear_sum_assignment(-jaccard[np.ix_(f.truths, f.tracks)] * f.similarity)
        similar = f.similarity[rows, columns]
        for a, alpha in enumerate(_ALPHAS):
            good = similar >= alpha - _EPS
            matches[a, f.truths[rows[good]], f.tracks[columns[good]]] += 1.0
    found = matches.sum(axis=(1, 2))
    total = truths.sum() + tracks.sum()
    either = np.maximum(truths[:, None] + tracks[None, :] - matches, 1.0)
    ass = (matches * matches / either).sum(axis=(1, 2)) / np.maximum(found, 1.0)
    det = found / np.maximum(total - found, 1.0)
    return {
        "HOTA": float(np.mean(np.sqrt(ass * det))),
        "AssA": float(ass.mean()),
        "DetA": float(det.mean()),
    }


def _switches(frames: Sequence[Frame], n: int, threshold: float) -> float:
    """Identity switches; matches of the instant before are kept where they still hold."""
    ever, just, count = np.full(n, -1), np.full(n, -1), 0
    for f in frames:
        if not len(f.truths) or not len(f.tracks):
            continue
        score = 1000.0 * (f.tracks[None, :] == just[f.truths][:, None]) + f.similarity
        score = np.where(f.similarity < threshold - _EPS, 0.0, score)
        rows, columns = linear_sum_assignment(-score)
        good = score[rows, columns] > _EPS
        who, track = f.truths[rows[good]], f.tracks[columns[good]]
        count += int(np.sum((ever[who] >= 0) & (ever[who] != track)))
        ever[who] = track
        just[:] = -1
        just[who] = track
    return float(count)
