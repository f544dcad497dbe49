"""Concurrent-learning flow field of many targets, with integral windows from the paths across gaps.

| symbol | name | shape | unit | equation |
| --- | --- | --- | --- | --- |
| sigma(x, theta) | Gaussian kernels over position times kernels over heading | (K M,) | | (3-2) |
| Y_i | ``int sigma^T dtau`` along a window's path | (K M,) | s | (3-7) |
| Deta_i | change of position over the window | (2,) | m | (3-7) |
| S, Q | ``sum w Y^T Y``, ``sum w Y^T Deta`` | (K M, K M), (K M, 2) | | (3-10) |
| W | weights | (K M, 2) | m/s | |
| s(x) | data support in [0, 1] | | | |

harris2020 and parikh2018 drive W to the least-squares solution of the stack; with every window kept (the sums are all
that is kept of them) that solution is ``W = (S + d I)^-1 Q``, computed anew after ``refit_after`` crossings. A gap is
measured too, as the integral of the velocity along it: the path is a cubic through both ends, and its windows weigh
less the more acceleration the ends ask for.

Prediction: ``x' = s v_flow + (1 - s) v_prior`` with ``s = 1 - d sigma^T (S + d I)^-1 sigma / sigma^T sigma``;
the heading is that of the predicted velocity, begun with the exit's.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np
import scipy.linalg

from camnet.estimation.crossing.settings import FlowSettings
from camnet.estimation.crossing.sightings import (
    CrossingPrediction,
    ExitState,
    Lesson,
    Sighting,
    only_camera,
)
from camnet.types import Array

__all__ = ["FlowField"]

_SLOW_MPS = 0.2
_SUBSTEPS = 4
_LONGEST_GAP_S = 300.0
_PATH_STD_MPS = 0.5
_ACCEL_PSD_M2PS3 = 0.01
_MODELS_KEPT = 8
_BUFFER_ROWS = 512
_MAX_STEPS = 60


@dataclass(frozen=True, eq=False, slots=True)
class _Model:
    """Weights (K M, 2) and ``(S + d I)^-1`` from all windows known at ``known_s``."""

    known_s: float
    weights: Array
    inverse: Array


class FlowField:
    """Velocity as a function of position and heading, shared by all targets.

    Parameters
    ----------
    settings : kernels, windows, remedies
    cameras : number of cameras
    bounds : (2, 2) lower and upper corner of the ground that the kernels cover, m
    """

    def __init__(self, settings: FlowSettings, cameras: int, bounds: Array) -> None:
        self._settings = settings
        self._cameras = cameras
        axes = [np.arange(a, b + settings.spacing_m, settings.spacing_m) for a, b in bounds.T]
        self._centres = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
        self._headings = 2 * np.pi * np.arange(settings.headings) / settings.headings
        size = len(self._centres) * settings.headings
        self._s, self._q = np.zeros((size, size)), np.zeros((size, 2))
        self._rows: list[Array] = []
        self._increments: list[Array] = []
        self._models: deque[_Model] = deque(maxlen=_MODELS_KEPT)
        self._crossings = 0
        self._window_start: dict[int, tuple[Sighting, Array]] = {}

    def predict(self, exit: ExitState, t_s: float) -> CrossingPrediction:
        """Flow from the exit to ``t_s`` with the model known before the exit; the camera is left to the place."""
        place = self.position(exit, t_s)
        return CrossingPrediction(
            place,
            float("inf"),
            only_camera(self._cameras, exit.camera),
            float(self._known(exit.t_s) is not None),
        )

    def position(self, exit: ExitState, t_s: float, with_prior: bool | None = None) -> Array:
        """Position (2,) at ``t_s``; ``with_prior`` stands in for the setting."""
        s, model = self._settings, self._known(exit.t_s)
        use_prior = s.prior if with_prior is None else with_prior
        steps = min(max(int(np.ceil((t_s - exit.t_s) / s.step_s)), 1), _MAX_STEPS)
        dt = (t_s - exit.t_s) / steps
        p, v = exit.p_world.copy(), exit.v_world
        for k in range(steps):
            prior = exit.v_world * np.exp(-(k + 0.5) * dt / s.prior_memory_s) if use_prior else None
            first = self._velocity(model, p, v, prior)
            v = self._velocity(model, p + 0.5 * dt * first, first, prior)
            p = p + dt * v
        return np.asarray(p)

    def observe(self, before: Sighting, after: Sighting) -> None:
        """Add seen motion: sightings in a row are joined to windows of ``window_s``."""
        start, row = self._window_start.get(after.target, (before, np.zeros(len(self._q))))
        if start is not before and start.t_s + 2 * self._settings.window_s < before.t_s:
            start, row = before, np.zeros(len(self._q))
        row = row + self._integral(np.stack([before.p_world, after.p_world]), after.t_s - before.t_s)
        if after.t_s - start.t_s >= self._settings.window_s:
            self._add(row, after.p_world - start.p_world, 1.0)
            self._window_start.pop(after.target, None)
        else:
            self._window_start[after.target] = (start, row)

    def learn(self, lesson: Lesson) -> None:
        """Add the windows of a crossing; extended lessons repeat it and are left out."""
        if lesson.extended:
            return
        self._window_start.pop(lesson.exit.target, None)
        if self._settings.learn_across and lesson.entry.t_s - lesson.exit.t_s <= _LONGEST_GAP_S:
            self._add_gap(lesson)
        if not lesson.reversed:
            self._crossings += 1
            if self._crossings % self._settings.refit_after == 0:
                self._refit(lesson.known_s)

    def _add_gap(self, lesson: Lesson) -> None:
        exit_, entry, s = lesson.exit, lesson.entry, self._settings
        duration = entry.t_s - exit_.t_s
        mean = (entry.p_world - exit_.p_world) / duration
        count = max(round(duration / s.window_s), 1)
        u = np.linspace(0.0, 1.0, count * _SUBSTEPS + 1)[:, None]
        # cubic through both ends, leaving with the exit velocity, arriving with the mean velocity
        start, bend = exit_.p_world, duration * (exit_.v_world - mean)
        path = start + u * duration * mean + u * (1 - u) ** 2 * bend
        misfit = 0.5 * bend
        psd = max(_ACCEL_PSD_M2PS3, 12.0 * float(misfit @ misfit) / (2.0 * duration**3))
        for k in range(count):
            x = (k + 0.5) / count * (1 - (k + 0.5) / count)
            variance = psd * duration * x * (1 - 3 * x)
            piece = path[k * _SUBSTEPS : (k + 1) * _SUBSTEPS + 1]
            weight = _PATH_STD_MPS**2 / (_PATH_STD_MPS**2 + variance)
            self._add(self._integral(piece, duration / count), piece[-1] - piece[0], weight)

    def _integral(self, path: Array, duration: float) -> Array:
        """``int sigma dtau`` (K M,) along a path (n, 2) walked in n - 1 equal times."""
        steps = np.diff(path, axis=0)
        middle = path[:-1] + 0.5 * steps
        dt = duration / len(steps)
        rows = [self._sigma(p, step / dt) for p, step in zip(middle, steps, strict=True)]
        return np.asarray(dt * np.sum(rows, axis=0))

    def _sigma(self, p: Array, v: Array) -> Array:
        """Kernels (K M,) at a position and velocity; a slow target has every heading."""
        gap = self._centres - p
        near = np.exp(-0.5 * (gap[:, 0] ** 2 + gap[:, 1] ** 2) / self._settings.width_m**2)
        if v[0] ** 2 + v[1] ** 2 < _SLOW_MPS**2:
            ahead = np.full(len(self._headings), 1.0 / len(self._headings))
        else:
            ahead = np.exp(2.0 * (np.cos(self._headings - np.arctan2(v[1], v[0])) - 1.0))
            ahead /= ahead.sum()
        return np.outer(near, ahead).ravel()

    def _velocity(self, model: _Model | None, p: Array, v: Array, prior: Array | None) -> Array:
        if model is None:
            return np.zeros(2) if prior is None else prior
        sigma = self._sigma(p, v)
        flow = sigma @ model.weights
        if prior is None:
            return np.asarray(flow)
        used = np.flatnonzero(sigma > 1e-3 * sigma.max()) if sigma.max() > 0 else np.arange(0)
        energy = float(sigma @ sigma)
        if energy < 1e-6:
            return prior
        part = sigma[used]
        missing = (
            self._settings.regularisation * float(part @ model.inverse[np.ix_(used, used)] @ part) / energy
        )
        support = min(max(1.0 - missing, 0.0), 1.0)
        return np.asarray(support * flow + (1.0 - support) * prior)

    def _known(self, t_s: float) -> _Model | None:
        for model in reversed(self._models):
            if model.known_s < t_s:
                return model
        return None

    def _add(self, row: Array, increment: Array, weight: float) -> None:
        self._rows.append(np.sqrt(weight) * row)
        self._increments.append(np.sqrt(weight) * increment)
        if len(self._rows) >= _BUFFER_ROWS:
            self._flush()

    def _flush(self) -> None:
        if self._rows:
            y = np.array(self._rows)
            self._s += y.T @ y
            self._q += y.T @ np.array(self._increments)
            self._rows, self._increments = [], []

    def _refit(self, known_s: float) -> None:
        self._flush()
        regular = self._s + self._settings.regularisation * np.eye(len(self._s))
        inverse = scipy.linalg.inv(regular, overwrite_a=True, check_finite=False)
        self._models.append(_Model(known_s, inverse @ self._q, inverse))
