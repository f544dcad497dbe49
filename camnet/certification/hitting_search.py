r"""Local search for a hitting set within a budget: rows that stay open grow heavier until they are hit.

Weights of rows, tabu and configuration checking of C. Gao, X. Yao, T. Weise, J. Li, "An efficient local search
heuristic with row weighting for the unicost set covering problem", European Journal of Operational Research 246 (2015),
extended by costs and by rows that need several.

Effort is counted in visits of a matrix entry, never in time, so that the answer does not depend on the machine.
"""

from __future__ import annotations

import numpy as np

from camnet.compiled import cached_njit
from camnet.types import Array, BoolArray, IntArray

__all__ = ["search_hitting_set"]


@cached_njit
def search_hitting_set(
    row_ptr: IntArray,
    row_column: IntArray,
    column_ptr: IntArray,
    column_row: IntArray,
    need: IntArray,
    cost: Array,
    chosen: BoolArray,
    weight: Array,
    stamp: IntArray,
    free: BoolArray,
    budget: float,
    visits: int,
    draws: Array,
) -> tuple[bool, int]:
    """Change ``chosen`` until it hits every row for ``budget`` at most, or ``visits`` entries have been looked at.

    Parameters
    ----------
    row_ptr, row_column, column_ptr, column_row : the matrix by rows and by columns
    need, cost : how many of each row must be chosen, and what each column costs
    chosen, weight, stamp, free : state of the search, changed in place: the set, weights of rows, when each column was
        moved last, and whether it may come in again (something near it has changed since it left)
    budget, visits : see above
    draws : (D,) numbers in [0, 1), taken in turn: which open row is served next

    Returns
    -------
    tuple
        Whether such a set was found, and the visits made.
    """
    n, m = len(cost), len(need)
    hits = np.zeros(m, np.int64)
    opened, place = np.empty(m, np.int64), np.full(m, -1, np.int64)
    n_open = 0
    for r in range(m):
        for k in range(row_ptr[r], row_ptr[r + 1]):
            if chosen[row_column[k]]:
                hits[r] += 1
        if hits[r] < need[r]:
            opened[n_open], place[r] = r, n_open
            n_open += 1
    score = np.zeros(n)
    inside = np.empty(n, np.int64)
    n_in, total = 0, 0.0
    for c in range(n):
        for k in range(column_ptr[c], column_ptr[c + 1]):
            r = column_row[k]
            if chosen[c] and hits[r] <= need[r]:
                score[c] -= weight[r]
            elif not chosen[c] and hits[r] < need[r]:
                score[c] += weight[r]
        if chosen[c]:
            inside[n_in] = c
            n_in += 1
            total += cost[c]
    cheapest = cost.min()
    done = 2 * len(row_column)
    tick = stamp.max() + 1
    tabu, drawn = -1, 0
    limit = budget + 1e-9
    while done < visits:
        if n_open == 0 and total <= limit:
            return True, done
        removed = False
        while n_in > 0 and (not removed or total + cheapest > limit):
            best = -1
            for i in range(n_in):
                c = inside[i]
                if c == tabu and n_in > 1:
                    continue
                if best < 0:
                    best = i
                    continue
                b = inside[best]
                if score[c] * cost[b] > score[b] * cost[c] or (
                    score[c] * cost[b] == score[b] * cost[c] and stamp[c] < stamp[b]
                ):
                    best = i
            done += n_in
            b = inside[best]
            n_in -= 1
            inside[best] = inside[n_in]
            chosen[b], score[b] = False, 0.0
            total -= cost[b]
            for k in range(column_ptr[b], column_ptr[b + 1]):
                r = column_row[k]
                hits[r] -= 1
                short, edge = hits[r] == need[r] - 1, hits[r] == need[r]
                if hits[r] < need[r]:
                    score[b] += weight[r]
                if short:
                    opened[n_open], place[r] = r, n_open
                    n_open += 1
                done += row_ptr[r + 1] - row_ptr[r]
                for j in range(row_ptr[r], row_ptr[r + 1]):
                    c = row_column[j]
                    free[c] = True
                    if c != b:
                        if short and not chosen[c]:
                            score[c] += weight[r]
                        elif edge and chosen[c]:
                            score[c] -= weight[r]
            free[b], stamp[b], removed = False, tick, True
            if n_open == 0 and total <= limit:
                return True, done
        while n_open > 0:
            row = opened[int(draws[drawn % len(draws)] * n_open)]
            drawn += 1
            b = -1
            for j in range(row_ptr[row], row_ptr[row + 1]):
                c = row_column[j]
                if chosen[c] or not free[c] or total + cost[c] > limit:
                    continue
                if (
                    b < 0
                    or score[c] * cost[b] > score[b] * cost[c]
                    or (score[c] * cost[b] == score[b] * cost[c] and stamp[c] < stamp[b])
                ):
                    b = c
            done += row_ptr[row + 1] - row_ptr[row]
            if b < 0:
                break
            inside[n_in] = b
            n_in += 1
            chosen[b], score[b] = True, 0.0
            total += cost[b]
            for k in range(column_ptr[b], column_ptr[b + 1]):
                r = column_row[k]
                hits[r] += 1
                filled, spare = hits[r] == need[r], hits[r] == need[r] + 1
                if hits[r] <= need[r]:
                    score[b] -= weight[r]
                if filled:
                    n_open -= 1
                    last = opened[n_open]
                    opened[place[r]], place[last] = last, place[r]
                    place[r] = -1
                done += row_ptr[r + 1] - row_ptr[r]
                for j in range(row_ptr[r], row_ptr[r + 1]):
                    c = row_column[j]
                    free[c] = True
                    if c != b:
                        if filled and not chosen[c]:
                            score[c] -= weight[r]
                        elif spare and chosen[c]:
                            score[c] += weight[r]
            stamp[b], tabu = tick, b
            if total + cheapest > limit:
                break
        for k in range(n_open):
            r = opened[k]
            weight[r] += 1.0
            done += row_ptr[r + 1] - row_ptr[r]
            for j in range(row_ptr[r], row_ptr[r + 1]):
                if not chosen[row_column[j]]:
                    score[row_column[j]] += 1.0
        tick += 1
        if n_in == 0 and n_open > 0 and total + cheapest > limit:
            return False, done
    return n_open == 0 and total <= limit, done
