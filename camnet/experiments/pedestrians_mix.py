"""Own velocity and learned flow put together, by weights that are themselves learned from earlier people.

| symbol | name | shape |
| --- | --- | --- |
| F_0 | ``base``: the prediction the others are compared with | (n, 12, 2) |
| d_j = F_j - F_0 | other predictions, less the base | (n, 12, 2) |
| c | weights, one for each j, the same at all horizons; 0 without evidence | (J,) |

The mix is ``F_0 + sum_j c_j d_j`` with c from ridge regression on windows whose future has been seen by now, of other
people. A window counts at horizon h with ``1 / (h (e + e_0))``, e the base's error there: errors as such, not their
squares, are what is to become small (one step of iteratively reweighted least squares), and far horizons are not to
outweigh near ones. As a last safeguard the fallback takes over when, on the windows so far, it was clearly better.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from camnet.experiments.pedestrians_data import FUTURE, Windows
from camnet.types import Array, BoolArray

__all__ = ["better_so_far", "mix"]

_RIDGE = 1.0
_SMALL_M = 0.1
_HORIZON = np.arange(1.0, FUTURE + 1.0)


def mix(windows: Windows, base: Array, others: Sequence[Array]) -> Array:
    """Mixed prediction (n, 12, 2), m; windows in the order of time."""
    d = np.stack([other - base for other in others], axis=-1)
    miss = windows.future - base
    weight = 1.0 / (_HORIZON * (np.linalg.norm(miss, axis=2) + _SMALL_M))
    gram = np.einsum("nhcj,nhck,nh->njk", d, d, weight)
    moment = np.einsum("nhcj,nhc,nh->nj", d, miss, weight)
    size = len(others)
    out = base.copy()
    rows = np.concatenate((gram.reshape(len(d), -1), moment), axis=1)
    for a, past in _sums_of_others(windows, rows):
        c = np.linalg.solve(
            past[: size * size].reshape(size, size) + _RIDGE * np.eye(size), past[size * size :]
        )
        out[a] += d[a] @ c
    return out


def better_so_far(windows: Windows, prediction: Array, fallback: Array) -> BoolArray:
    """Whether (n,) the prediction is not clearly worse than the fallback on others' windows known by then.

    Clearly worse: the sum of the differences of the two errors is below minus two standard deviations of that sum.
    """
    gain = _error(windows, fallback) - _error(windows, prediction)
    rows = np.column_stack((gain, gain**2))
    return np.array(
        [past[0] >= -2.0 * np.sqrt(max(past[1], 0.0)) for _, past in _sums_of_others(windows, rows)],
        dtype=bool,
    )


def _error(windows: Windows, prediction: Array) -> Array:
    return np.asarray(np.linalg.norm(prediction - windows.future, axis=2).mean(axis=1))


def _sums_of_others(windows: Windows, rows: Array) -> Iterator[tuple[int, Array]]:
    """For each window the sum of ``rows`` (n, k) over windows that ended by then and are of other people."""
    total = np.zeros(rows.shape[1])
    own: dict[int, Array] = {}
    finished = 0
    for a in range(len(rows)):
        while windows.now[finished] + FUTURE <= windows.now[a]:
            person = int(windows.person[finished])
            total = total + rows[finished]
            own[person] = own.get(person, np.zeros_like(total)) + rows[finished]
            finished += 1
        yield a, total - own.get(int(windows.person[a]), 0.0)
