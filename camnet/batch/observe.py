"""Predicted entries and the agents' observations, from estimates; the fields are those of ``camnet.env.layout``.

`camnet.simulation.entries` and ``camnet.env.observe`` are the oracles.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from camnet.batch.compiled import inner
from camnet.batch.network import Model
from camnet.batch.sense import contains, distance_to
from camnet.batch.state import State
from camnet.geometry.triples import Quaternion, rotate
from camnet.types import Array

__all__ = ["OWN_FIELDS", "TARGET_FIELDS", "due", "find_entries", "forget_entries", "observe"]

#: numbers about an agent itself, about one target, about one neighbour
OWN_FIELDS, TARGET_FIELDS, NEIGHBOUR_FIELDS = 14, 24, 4


@inner
def due(model: Model, state: State, e: int, t_s: float) -> bool:
    """Whether the entries are to be predicted anew now; the next time is set then."""
    if t_s < state.clock[e, 2]:
        return False
    state.clock[e, 2] = t_s + model.replan_s - 1e-9
    return True


@inner
def forget_entries(state: State, e: int, m: int) -> None:
    """Note that no entries of a target are known."""
    for c in range(state.entries.shape[2]):
        state.entries[e, m, c, 0] = 0.0


@inner
def _set_entry(model: Model, state: State, e: int, m: int, c: int, path: Array, k: int, t_s: float) -> None:
    """Entry at the ``k``-th instant of a path (K, 4) of points and error radii."""
    entry = state.entries
    entry[e, m, c, 1] = t_s + model.rollout_dt_s * (k + 1)
    before = max(k - 1, 0)
    for i in range(3):
        entry[e, m, c, 2 + i] = path[k, i]
        entry[e, m, c, 5 + i] = (path[k, i] - path[before, i]) / model.rollout_dt_s
    entry[e, m, c, 8] = path[k, 3]


@inner
def find_entries(model: Model, state: State, e: int, m: int, path: Array, t_s: float) -> None:
    """Find when a predicted path (K, 4), whose first instant is one step after ``t_s``, enters each region."""
    steps, box = path.shape[0], model.boxes
    for c in range(state.entries.shape[2]):
        low_x, low_y, high_x, high_y = box[c, 0, 0], box[c, 0, 1], box[c, 1, 0], box[c, 1, 1]
        state.entries[e, m, c, 0] = 0.0
        nearest, touching = math.inf, -1
        for k in range(steps):
            x, y, z, radius = path[k, 0], path[k, 1], path[k, 2], path[k, 3]
            if max(low_x - x, x - high_x, low_y - y, y - high_y) > radius:
                continue  # farther away than the error radius
            rise = min(max(z, model.heights[c, 0]), model.heights[c, 1]) - z
            z += min(max(rise, -radius), radius)  # heights are noise about the ground, where regions end
            distance = distance_to(model, c, (x, y, z))
            if distance <= 0.0:
                if k > 0:
                    state.entries[e, m, c, 0] = 1.0
                    _set_entry(model, state, e, m, c, path, k, t_s)
                touching = -1
                break
            if distance <= radius and distance < nearest:
                nearest, touching = distance, k
        if touching >= 0:
            state.entries[e, m, c, 0] = 0.5
            _set_entry(model, state, e, m, c, path, touching, t_s)


@inner
def _put(out: NDArray[np.float32], e: int, j: int, k: int, value: float, low: float, high: float) -> None:
    """Write a field, clipped; a value that is no number counts as the low end, as NumPy's clip would not."""
    out[e, j, k] = np.float32(min(max(value, low), high))


@inner
def _own(model: Model, state: State, e: int, j: int, out: NDArray[np.float32]) -> None:
    cam = state.cameras
    q: Quaternion = (cam[e, j, 3], cam[e, j, 4], cam[e, j, 5], cam[e, j, 6])
    x, y, z = rotate(q, (0.0, 0.0, 1.0))
    for i in range(3):
        place = (cam[e, j, i] - model.centers[j, i]) / model.halves[j, i]
        _put(out, e, j, i, place, -2.0, 2.0)
        _put(out, e, j, 3 + i, cam[e, j, 7 + i] / model.v_max, -3.0, 3.0)
        _put(out, e, j, 8 + i, model.own[j, i], -1.0, 1.0)
        _put(out, e, j, 11 + i, model.own[j, 3 + i], 0.0, 1.0)
    _put(out, e, j, 6, math.atan2(x, max(-z, 0.0)) / model.gaze_scale, -2.0, 2.0)
    _put(out, e, j, 7, math.atan2(y, max(-z, 0.0)) / model.gaze_scale, -2.0, 2.0)


@inner
def _target(model: Model, state: State, e: int, j: int, m: int, t_s: float, out: NDArray[np.float32]) -> None:
    s, first = state.estimate, OWN_FIELDS + TARGET_FIELDS * m
    for k in range(TARGET_FIELDS):
        out[e, j, first + k] = 0.0
    if not math.isfinite(s[e, m, 14]):
        return
    out[e, j, first] = 1.0
    for i in range(3):
        place = (s[e, m, i] - model.centers[j, i]) / model.halves[j, i]
        _put(out, e, j, first + 1 + i, place, -20.0, 20.0)
        _put(out, e, j, first + 4 + i, s[e, m, 7 + i] / model.speeds[m], -3.0, 3.0)
    cx = 1.0 - 2.0 * (s[e, m, 5] ** 2 + s[e, m, 6] ** 2)
    cy = 2.0 * (s[e, m, 4] * s[e, m, 5] + s[e, m, 3] * s[e, m, 6])
    length = math.sqrt(cx * cx + cy * cy)
    _put(out, e, j, first + 7, cx / length if length > 0.0 else 1.0, -1.0, 1.0)
    _put(out, e, j, first + 8, cy / length if length > 0.0 else 0.0, -1.0, 1.0)
    _put(out, e, j, first + 9, s[e, m, 16] / model.widths[j], 0.0, 20.0)
    _put(out, e, j, first + 10, (t_s - s[e, m, 14]) / model.lookahead_s, 0.0, 1.0)
    anyone = 0.0
    for c in range(state.cameras.shape[1]):
        if state.visible[e, c, m] == 1:
            anyone = 1.0
    out[e, j, first + 11] = np.float32(state.visible[e, j, m])
    out[e, j, first + 12] = np.float32(anyone)
    out[e, j, first + 13] = 1.0 if contains(model, j, (s[e, m, 0], s[e, m, 1], s[e, m, 2])) else 0.0
    if state.entries[e, m, j, 0] > 0.0:
        _entry(model, state, e, j, m, t_s, first + 14, out)


@inner
def _entry(
    model: Model, state: State, e: int, j: int, m: int, t_s: float, first: int, out: NDArray[np.float32]
) -> None:
    entry = state.entries
    out[e, j, first] = np.float32(entry[e, m, j, 0])
    for i in range(3):
        place = (entry[e, m, j, 2 + i] - model.centers[j, i]) / model.halves[j, i]
        _put(out, e, j, first + 1 + i, place, -2.0, 2.0)
        _put(out, e, j, first + 4 + i, entry[e, m, j, 5 + i] / model.speeds[m], -3.0, 3.0)
    _put(out, e, j, first + 7, (entry[e, m, j, 1] - t_s) / model.lookahead_s, 0.0, 1.0)
    _put(out, e, j, first + 8, entry[e, m, j, 8] / model.widths[j], 0.0, 20.0)
    _put(out, e, j, first + 9, 1.0 - entry[e, m, j, 8] / model.views[j], -20.0, 1.0)


@inner
def _near(model: Model, state: State, e: int, j: int, first: int, out: NDArray[np.float32]) -> None:
    """Nearest agents, nearest first; of equally near ones the first."""
    cam, agents = state.cameras, state.bodies.shape[1]
    last, last_index = -1.0, -1
    for k in range(model.neighbours):
        best, found = math.inf, -1
        for n in range(agents):
            if n == j:
                continue
            d = math.sqrt(
                (cam[e, n, 0] - cam[e, j, 0]) ** 2
                + (cam[e, n, 1] - cam[e, j, 1]) ** 2
                + (cam[e, n, 2] - cam[e, j, 2]) ** 2
            )
            if (d > last or (d == last and n > last_index)) and d < best:
                best, found = d, n
        for i in range(NEIGHBOUR_FIELDS):
            out[e, j, first + NEIGHBOUR_FIELDS * k + i] = 0.0
        if found >= 0 and best <= model.range_m:
            at = first + NEIGHBOUR_FIELDS * k
            out[e, j, at] = 1.0
            for i in range(3):
                away = (cam[e, found, i] - cam[e, j, i]) / model.halves[j, i]
                _put(out, e, j, at + 1 + i, away, -20.0, 20.0)
        last, last_index = best, found


@inner
def observe(model: Model, state: State, e: int, t_s: float, out: NDArray[np.float32]) -> None:
    """Write the observations (N, D) of all agents of environment ``e`` to its rows of ``out``."""
    targets = state.target.shape[1]
    for j in range(state.bodies.shape[1]):
        _own(model, state, e, j, out)
        for m in range(targets):
            _target(model, state, e, j, m, t_s, out)
        _near(model, state, e, j, OWN_FIELDS + TARGET_FIELDS * targets, out)
