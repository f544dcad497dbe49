"""Columns of the learning estimators' rows; `camnet.batch.estimator_layout` tells what array each belongs to."""

from __future__ import annotations

from camnet.estimation.radius import REMEMBERED_GAPS

# --- columns of ``pose`` ---------------------------------------------------------------------------------------------
#: present instant and last measured one, s; weight steps owed, s
T, LAST_SEEN, OWED = 0, 1, 2
#: pose, prior mean (v world, w body), twist
P, Q, PRIOR, TWIST = 3, 6, 10, 16
#: how the target left (t, p, q, v, w: 14 columns), the same of the gap that waits to be learned, and when that ended
EXIT, GAP, GAP_ENTRY = 22, 36, 50
#: how far left of its way on the road it was when it left, m
OFFSET = 51
POSE_COLUMNS = 52
# --- columns of ``flags`` --------------------------------------------------------------------------------------------
#: region last seen in (-1: never seen), whether seen now, model in force
REGION, SEEN, MODEL = 0, 1, 2
#: samples of the window, poses of the history, whether a fit of the prior is due, whether the exit is known
FILLED, HELD, FIT_DUE, HAS_EXIT = 3, 4, 5, 6
#: model that the waiting gap is for (-1: none waits), gaps learned
GAP_MODEL, GAPS_LEARNED = 7, 8
#: windows a stack has room for, whether it can fill up, numbers in a model's block: fixed by ``allocate``
CAPACITY, FILLS, BLOCK = 9, 10, 11
FLAG_COLUMNS = 12
# --- columns of ``model`` --------------------------------------------------------------------------------------------
#: mean square residual while seen, m^2; error rates of the last gaps, m/s
MEAN_SQUARE, RATES = 0, 1
#: outlier gate: mean squares (position, turn), when the run of suspect windows and when the change began, s
GATE, RUN_BEGAN, CHANGED = RATES + REMEMBERED_GAPS, RATES + REMEMBERED_GAPS + 2, RATES + REMEMBERED_GAPS + 3
#: up to when the weights have been advanced, s; square of the weights' norm
ADVANCED, NORM2 = CHANGED + 1, CHANGED + 2
MODEL_COLUMNS = NORM2 + 1
# --- columns of ``counts`` -------------------------------------------------------------------------------------------
#: active kernels, distance of two rows of ``inverse``, windows held, rank-one changes since the inverse was exact
ACTIVE, STRIDE, WINDOWS, CHANGES = 0, 1, 2, 3
#: gaps crossed, runs of far, suspect and agreeing windows
CROSSED, FAR_RUN, SUSPECT_RUN, AGREED = 4, 5, 6, 7
#: for the records: windows refused by the gate, changes noted, windows forgotten, windows refused by the stack
OUTLIERS, TURNS, FORGOTTEN, REFUSED = 8, 9, 10, 11
#: whether the books of the selection hold, and changes since they were exact
SELECTING, SELECTED = 12, 13
#: windows for which the arrays had no room: the row ran longer than ``allocate`` was told
OVERFLOWED = 14
#: whether the inverse waits to be computed afresh
STALE = 15
COUNT_COLUMNS = 16

#: rows of the inverse grow by this many at a time; a multiple of a panel's rows
GROWTH = 8
