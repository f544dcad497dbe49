"""People who walk together leave and come back together: evidence from others for who came back.

Exit i' is a *companion* of exit i if the two are within ``time_s`` and ``place_m``; so for entries. Entry j speaks
for exit i if a companion of j is likely to be of a companion of i: ``g_ij = sum_j' sum_i' p(j' is of i')``, at most
``_MOST``, the mean-field form of a factor between two pairs (Bishop 2006, sec. 10.1). Beside it stand the cases of
how many companions (none, one, more) the exit and the entry have.
"""

from __future__ import annotations

import numpy as np

from camnet.association.crossing_density import Ends
from camnet.types import Array, IntArray

__all__ = ["companion_features"]

_MOST = 1.5


def companion_features(
    exits: Ends, entries: Ends, resighted: IntArray, pairs: tuple[IntArray, IntArray], probability: Array,
    time_s: float, place_m: float,
) -> Array:  # fmt: skip
    """Features (m, 7) of pairs: g, then six cases of companions.

    Parameters
    ----------
    exits, entries : of all tracklets
    resighted : (k,) tracklets that end a gap; entries of companions are among them
    pairs : exits (m,) and entries (m,), entries ascending
    probability : (m,) of each pair so far
    time_s, place_m : how near companions are
    """
    which, to = pairs
    n = len(exits.t_s)
    of_exit = _near(exits, np.arange(n), np.arange(n), time_s, place_m)
    of_entry = _near(entries, resighted, np.arange(n), time_s, place_m)
    begin = np.searchsorted(to, np.arange(n + 1))
    support = np.zeros(len(which))
    chance = np.zeros(n)
    for j in np.unique(to):
        for other in of_entry[j]:
            theirs = slice(begin[other], begin[other + 1])
            chance[which[theirs]] = probability[theirs]
            for m in range(begin[j], begin[j + 1]):
                if len(of_exit[which[m]]):
                    support[m] += chance[of_exit[which[m]]].sum()
            chance[which[theirs]] = 0.0
    left = np.minimum([len(x) for x in of_exit], 2)[which]
    came = np.minimum([len(x) for x in of_entry], 2)[to]
    cases = [(left == a) & (came == b) for a in (1, 2) for b in (0, 1, 2)]
    return np.column_stack([np.minimum(support, _MOST), *cases]).astype(np.float64)


def _near(ends: Ends, among: IntArray, of: IntArray, time_s: float, place_m: float) -> list[IntArray]:
    """For each of ``of``, those of ``among`` that are near it, itself left out."""
    among = among[np.argsort(ends.t_s[among], kind="stable")]
    times = ends.t_s[among]
    out = []
    for k in of:
        a, b = np.searchsorted(times, [ends.t_s[k] - time_s, ends.t_s[k] + time_s + 1e-9])
        some = among[a:b]
        gap = np.hypot(*(ends.p_world[some] - ends.p_world[k]).T)
        out.append(some[(gap <= place_m) & (some != k)])
    return out
