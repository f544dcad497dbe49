"""Recorded targets with their labels hidden: who it is that a camera sees again.

*At once*: every entry is decided when it happens, from position and time alone; candidates are all gaps that are open
then (the target is out of view and its recording goes on). *Revised*: the same a window later, one-to-one against all
entries of the window, and with the evidence of companions. *Alone*: nobody confirms anything; a gap is open until the
system itself has closed it, and identities are chains of its own decisions (IDF1, HOTA, switches).

What is learned from: ``others``, the crossings of everybody but the candidate's own target, whenever they were; or
``earlier``, everybody's that ended before the entry. The coefficients of the conditional logit are always those that
the people of other folds taught. Intervals are from a bootstrap over people.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from camnet.association.appearance import simulated_appearance
from camnet.association.calibration import calibration_error, reliability
from camnet.association.choice import cross_fitted, group_log_softmax
from camnet.association.companions import companion_features
from camnet.association.crossing_density import Ends, Lessons, pair_densities
from camnet.association.identity_scores import label_scores
from camnet.association.settings import IdentitySettings
from camnet.association.tracklets import Tracklets, tracklets_of
from camnet.association.window import SURVIVAL_GRID_S, window_probabilities
from camnet.errors import DataError
from camnet.experiments.recorded_replay import Fixes
from camnet.types import Array, BoolArray, IntArray

__all__ = ["IdentityResult", "Learn", "identify"]

Learn = Literal["others", "earlier"]
_DRAWS = 1000
_LEVELS = (0.025, 0.975)


@dataclass(frozen=True, eq=False, slots=True)
class IdentityResult:
    """Outcome: a summary ready for JSON, and one row an entry (columns by name)."""

    summary: dict[str, Any]
    rows: dict[str, Any]


@dataclass(frozen=True, eq=False, slots=True)
class _Pairs:
    """Pairs of exits and entries, entries ascending.

    Attributes
    ----------
    which, to : (m,) tracklets left and entered; group (m,) counts the entries in order of tracklet
    right, candidate : (m,) the true exit; a gap that is open at the entry
    entries : (k,) tracklets
    """

    which: IntArray
    to: IntArray
    group: IntArray
    right: BoolArray
    candidate: BoolArray
    entries: IntArray


def identify(
    fixes: Fixes,
    settings: IdentitySettings | None = None,
    learn: Learn = "others",
    appearance_rank1: float | None = None,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> IdentityResult:
    """Find out who every entry is.

    Parameters
    ----------
    fixes : all fixes of all targets, and which camera sees them
    settings : scales and windows
    learn : from ``others`` or from what was ``earlier``
    appearance_rank1 : add simulated appearance that alone is right so often; None: position and time only
    seed : of folds, appearance and bootstrap
    progress : called with the share done

    Raises
    ------
    DataError
        No target is seen, lost and seen again.
    """
    s = settings or IdentitySettings()
    rng = np.random.default_rng(seed)
    told = progress or (lambda _: None)
    t = tracklets_of(fixes.t_s, fixes.p_world, fixes.target, fixes.visit, fixes.camera >= 0)
    if not len(t.resighted):
        raise DataError("no target is seen, lost and seen again; is anybody in view of the cameras?")
    pairs = _pairs(t, s)
    lessons = t.lessons(s.density.reversed_penalty)
    log_f, log_s = _densities(t, pairs, lessons, s, learn)
    told(0.5)
    grid = _survival_grid(t, lessons, s, learn)
    told(0.6)
    fold = _folds(t, pairs.entries, len(fixes.names), s.folds, rng)
    extra, noise = None, None
    if appearance_rank1 is not None:
        extra, noise = simulated_appearance(
            appearance_rank1, (pairs.which, pairs.to), t.target, pairs.candidate, pairs.right, rng
        )
    plain = _plain_features(t, pairs)
    scored = log_f - log_s if extra is None else log_f - log_s + extra
    at_once = cross_fitted(np.column_stack([scored, plain]), pairs.candidate, pairs.right, pairs.group, fold)
    first = _probabilities(at_once, pairs)
    ends = pairs.which, pairs.to
    one_to_one = window_probabilities(t, ends, at_once + log_s, grid, s.window_s)
    told(0.8)
    revised = _revised(t, pairs, one_to_one, plain, fold, s)
    told(0.95)
    names = {"at_once": first, "one_to_one": one_to_one, "revised": revised}
    tables = {name: _decisions(p, pairs) for name, p in names.items()}
    owner = t.target[pairs.entries]
    baselines = _baselines(t, pairs)
    summary: dict[str, Any] = {
        "entries": len(pairs.entries),
        "targets": len(fixes.names),
        "candidates_mean": float(pairs.candidate.sum() / len(pairs.entries)),
        "learn": learn,
        "appearance": None if extra is None else {"rank1_alone": appearance_rank1, "noise": noise},
        "rank1": {name: float(np.mean(tables[name][1])) for name in names} | baselines,
        "log_loss": {name: _log_loss(p, pairs) for name, p in names.items()},
        "calibration": {name: _calibration(p, pairs, *tables[name][1:]) for name, p in names.items()},
        "ci95": _bootstrap({name: row[1] for name, row in tables.items()}, owner, rng),
        "time_to_identity": _delays(tables["at_once"][1], tables["revised"][1], s.window_s),
        "alone": _alone(t, fixes, pairs, at_once, s.horizon_s),
    }
    told(1.0)
    rows = {
        "entry_t_s": t.entries.t_s[pairs.entries],
        "x_m": t.entries.p_world[pairs.entries, 0],
        "y_m": t.entries.p_world[pairs.entries, 1],
        "target": [fixes.names[k] for k in owner],
    }
    for name, (chosen, right, stated) in tables.items():
        rows |= {
            f"{name}_target": [fixes.names[k] for k in t.target[chosen]],
            f"{name}_right": right,
            f"{name}_stated": stated,
        }
    return IdentityResult(summary, rows)


def _pairs(t: Tracklets, s: IdentitySettings) -> _Pairs:
    """Pairs that can stand in a window, or within the horizon of a system that runs alone."""
    entries = t.resighted
    which, to = [], []
    for j in entries:
        now = t.entries.t_s[j]
        near = (t.open_until_s >= now - s.window_s) | (t.exits.t_s >= now - s.horizon_s)
        some = np.flatnonzero((t.exits.t_s < now) & (t.recorded_until_s >= now) & near)
        which.append(some)
        to.append(np.full(len(some), j))
    a, b = np.concatenate(which), np.concatenate(to)
    order = np.argsort(b, kind="stable")
    a, b = a[order], b[order]
    ascending = np.sort(entries)
    return _Pairs(
        a, b, np.searchsorted(ascending, b), t.before[b] == a, t.open_until_s[a] >= t.entries.t_s[b], ascending
    )  # fmt: skip


def _densities(
    t: Tracklets, pairs: _Pairs, lessons: Lessons, s: IdentitySettings, learn: Learn
) -> tuple[Array, Array]:
    order = np.argsort(pairs.which, kind="stable")
    some = pairs.which[order], pairs.to[order]
    d = pair_densities(t.exits, t.entries, some, lessons, s.density, learn == "earlier")
    log_f, log_s = np.empty(len(order)), np.empty(len(order))
    log_f[order], log_s[order] = d.log_f, d.log_s
    return log_f, log_s


def _survival_grid(t: Tracklets, lessons: Lessons, s: IdentitySettings, learn: Learn) -> Array:
    """Logarithm of every exit's survival at the times of the grid (n, g).

    With ``earlier`` it uses what is known at the exit.
    """
    n, g = len(t.exits.t_s), len(SURVIVAL_GRID_S)
    row = np.repeat(np.arange(n), g)
    times = t.exits.t_s[row] + np.tile(SURVIVAL_GRID_S, n)
    still = Ends(times, t.exits.p_world[row], np.zeros((n * g, 2)), np.zeros(n * g, bool), t.target[row])
    pairs = row, np.arange(n * g)
    return pair_densities(t.exits, still, pairs, lessons, s.density, learn == "earlier").log_s.reshape(n, g)


def _plain_features(t: Tracklets, pairs: _Pairs) -> Array:
    gap = np.hypot(*(t.entries.p_world[pairs.to] - t.exits.p_world[pairs.which]).T)
    dt = np.maximum(t.entries.t_s[pairs.to] - t.exits.t_s[pairs.which], 1e-3)
    return np.column_stack([np.log(gap + 3.0), gap / 50.0, np.log(dt)])


def _folds(t: Tracklets, entries: IntArray, people: int, folds: int, rng: np.random.Generator) -> IntArray:
    fold = rng.permutation(people) % folds
    return np.asarray(fold[t.target[entries]])


def _probabilities(score: Array, pairs: _Pairs) -> Array:
    masked = np.where(pairs.candidate, score, -np.inf)
    return np.exp(group_log_softmax(masked, pairs.group, len(pairs.entries)))


def _revised(
    t: Tracklets, pairs: _Pairs, one_to_one: Array, plain: Array, fold: IntArray, s: IdentitySettings
) -> Array:
    ends = pairs.which, pairs.to
    friends = companion_features(
        t.exits, t.entries, t.resighted, ends, one_to_one, s.companion_time_s, s.companion_place_m
    )
    features = np.column_stack([np.log(np.maximum(one_to_one, 1e-9)), friends, plain[:, :2]])
    return _probabilities(cross_fitted(features, pairs.candidate, pairs.right, pairs.group, fold), pairs)


def _decisions(probability: Array, pairs: _Pairs) -> tuple[IntArray, BoolArray, Array]:
    """Chosen exit, whether it is right, and its stated probability, for each entry."""
    order = np.lexsort((-probability, ~pairs.candidate, pairs.group))
    best = order[np.searchsorted(pairs.group[order], np.arange(len(pairs.entries)))]
    return pairs.which[best], pairs.right[best], probability[best]


def _baselines(t: Tracklets, pairs: _Pairs) -> dict[str, float]:
    gap = np.hypot(*(t.entries.p_world[pairs.to] - t.exits.p_world[pairs.which]).T)
    away = t.entries.t_s[pairs.to] - t.exits.t_s[pairs.which]
    count = np.bincount(pairs.group, pairs.candidate, len(pairs.entries))
    return {
        "last_seen_place": float(np.mean(_decisions(-gap, pairs)[1])),
        "nearest_in_time": float(np.mean(_decisions(-away, pairs)[1])),
        "chance": float(np.mean(1.0 / count)),
    }


def _log_loss(p: Array, pairs: _Pairs) -> float:
    return float(-np.mean(np.log(np.maximum(p[pairs.right], 1e-12))))


def _calibration(p: Array, pairs: _Pairs, right: BoolArray, stated: Array) -> dict[str, Any]:
    """Of the stated probability of the chosen one, and of every candidate's."""
    return {
        "ece_chosen": calibration_error(stated, right),
        "ece_all": calibration_error(p[pairs.candidate], pairs.right[pairs.candidate]),
        "reliability": reliability(stated, right),
    }


def _bootstrap(right: dict[str, BoolArray], owner: IntArray, rng: np.random.Generator) -> dict[str, Any]:
    people, index = np.unique(owner, return_inverse=True)
    drawn = rng.multinomial(len(people), np.full(len(people), 1.0 / len(people)), size=_DRAWS)
    weight = drawn[:, index].astype(np.float64)
    shares = {name: weight @ hit / weight.sum(axis=1) for name, hit in right.items()}

    def interval(values: Array) -> list[float]:
        return [float(v) for v in np.quantile(values, _LEVELS)]

    return {name: interval(v) for name, v in shares.items()} | {
        "one_to_one_above_at_once": interval(shares["one_to_one"] - shares["at_once"]),
        "revised_above_at_once": interval(shares["revised"] - shares["at_once"]),
    }


def _delays(at_once: BoolArray, revised: BoolArray, window_s: float) -> dict[str, float]:
    """How long until the right identity stands for good."""
    return {
        "right_at_once_and_kept": float(np.mean(at_once & revised)),
        "right_after_the_window": float(np.mean(~at_once & revised)),
        "wrongly_revised": float(np.mean(at_once & ~revised)),
        "never_right": float(np.mean(~at_once & ~revised)),
        "window_s": window_s,
    }


def _alone(t: Tracklets, fixes: Fixes, pairs: _Pairs, score: Array, horizon_s: float) -> dict[str, Any]:
    """Decide in the order of time, closing gaps by own decisions; starts of recordings are new identities."""
    n = len(t.exits.t_s)
    begin = np.searchsorted(pairs.to, np.arange(n + 1))
    away = t.entries.t_s[pairs.to] - t.exits.t_s[pairs.which]
    gap = np.hypot(*(t.entries.p_world[pairs.to] - t.exits.p_world[pairs.which]).T)
    keys = {"learned": score, "last_seen_place": -gap, "nearest_in_time": -away}
    out = {}
    for name, key in keys.items():
        label, taken, hits = np.arange(n), np.zeros(n, bool), 0
        for j in t.resighted:
            mine = np.arange(begin[j], begin[j + 1])
            mine = mine[(away[mine] <= horizon_s) & ~taken[pairs.which[mine]]]
            if len(mine):
                i = pairs.which[mine[np.argmax(key[mine])]]
                taken[i] = True
                label[j] = label[i]
                hits += int(t.before[j] == i)
        seen = t.of_fix >= 0
        scores = label_scores(t.visit[t.of_fix[seen]], label[t.of_fix[seen]], fixes.t_s[seen])
        out[name] = {"rank1": hits / len(t.resighted), **scores}
    return out
