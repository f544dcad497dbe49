"""Cameras that stand and may be turned or moved: their candidates, what bounds the choice, and the world after.

| change | where | price | at most |
| --- | --- | --- | --- |
| none | as it stands | 0 | |
| turn | its own place, any direction | ``turn`` | one direction for each camera, or as it stands |
| move | any mount, any direction | ``move``, and what the mount costs | as many of a model as stand, less those used |
| add | any mount | the camera's, and what the mount costs | |

A camera that stands and is in none of the chosen places stays as it is: it does no harm, and touching it costs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from camnet.config.models import FixedCamera
from camnet.experiments.design_mounts import ADD, MOVE, TURN, Candidates, candidates_at
from camnet.geometry.settings import CameraModel, FixedPose
from camnet.importers.mounts import Mount
from camnet.types import Array, IntArray

__all__ = ["FREE", "Changes", "Prices", "change_prices", "changed_cameras", "changes_of", "words_of_change"]

#: stands for nothing where a solver needs a cost above 0
FREE = 1e-9


@dataclass(frozen=True, slots=True)
class Prices:
    """What a change of a camera that stands costs."""

    turn: float = 25.0
    move: float = 75.0


@dataclass(frozen=True, eq=False)
class Changes:
    """What may be done with the cameras that stand.

    Attributes
    ----------
    candidates : turned and moved cameras
    models : their models, numbered after those of the catalogue
    mounts : where they stand now, numbered after the mounts
    model_of : (J,) the number among ``models`` of each camera that stands
    """

    candidates: Candidates
    models: tuple[CameraModel, ...]
    mounts: tuple[Mount, ...]
    model_of: IntArray

    def at_most(self, candidates: Candidates, rows: IntArray) -> list[tuple[IntArray, int]]:
        """Return what bounds a choice among candidates ``rows`` and, numbered after them, the cameras as they stand."""
        kind, of, n = candidates.kind[rows], candidates.of[rows], len(rows)
        cameras = np.arange(len(self.model_of))
        turned = [np.flatnonzero((kind == TURN) & (of == j)) for j in cameras]
        out = [(np.append(turned[j], n + j), 1) for j in cameras]
        for m in range(len(self.models)):
            own = cameras[self.model_of == m]
            moved = np.flatnonzero((kind == MOVE) & (of == m))
            parts = [moved, n + own, *(turned[j] for j in own)]
            out.append((np.concatenate(parts).astype(np.int64), len(own)))
        return out


def changes_of(
    standing: Sequence[FixedCamera],
    kinds: Sequence[CameraModel],
    mounts: Sequence[Mount],
    step_deg: float,
    first_model: int,
) -> Changes:
    """Return every camera that stands in every direction where it is, and every model of them at every mount."""
    used = list(dict.fromkeys(camera.camera for camera in standing))
    models = tuple(next(k for k in kinds if k.name == name) for name in used)
    model_of = np.array([used.index(camera.camera) for camera in standing], dtype=np.int64)
    own = tuple(Mount(c.name, *c.pose.position_m) for c in standing)
    parts = [
        candidates_at([own[j]], [models[m]], step_deg, TURN, j, (first_model + m, len(mounts) + j))
        for j, m in enumerate(model_of.tolist())
    ]
    parts += [
        candidates_at(mounts, [model], step_deg, MOVE, m, (first_model + m, 0))
        for m, model in enumerate(models)
    ]
    return Changes(Candidates.joined(parts), models, own, model_of)


def change_prices(candidates: Candidates, mounts: Sequence[Mount], prices: Prices) -> Array:
    """Return what each candidate costs beyond the camera itself."""
    mounting = np.array([m.cost for m in mounts])[candidates.mount]
    labour = np.array([0.0, prices.turn, prices.move])[candidates.kind]
    return np.asarray(np.where(candidates.kind == TURN, 0.0, mounting) + labour)


def changed_cameras(
    standing: Sequence[FixedCamera],
    changes: Changes,
    candidates: Candidates,
    chosen: IntArray,
    stays: IntArray,
) -> tuple[list[FixedCamera], dict[int, str], list[int]]:
    """Return the cameras that stand after the change, the names of changed ones by candidate, and who stays.

    ``chosen`` are candidates, ``stays`` numbers of cameras that are needed as they stand. A camera is moved from the
    nearest place of its model from which none is needed.
    """
    after = list(standing)
    names: dict[int, str] = {}
    free = set(range(len(standing))) - set(stays.tolist())
    for k in chosen[candidates.kind[chosen] == TURN].tolist():
        j = int(candidates.of[k])
        after[j], names[k] = _posed(standing[j], candidates, k), standing[j].name
        free.discard(j)
    for k in chosen[candidates.kind[chosen] == MOVE].tolist():
        place = candidates.position_m[k]
        able = [j for j in sorted(free) if changes.model_of[j] == candidates.of[k]]
        j = min(able, key=lambda i: float(np.linalg.norm(np.array(standing[i].pose.position_m) - place)))
        after[j], names[k] = _posed(standing[j], candidates, k), standing[j].name
        free.discard(j)
    changed = set(names.values())
    return after, names, [j for j, camera in enumerate(standing) if camera.name not in changed]


def _posed(camera: FixedCamera, candidates: Candidates, k: int) -> FixedCamera:
    place: Any = tuple(candidates.position_m[k].tolist())
    look: Any = tuple(candidates.look_at_m[k].tolist())
    return camera.model_copy(update={"pose": FixedPose(position_m=place, look_at_m=look)})


def words_of_change(kind: int) -> str:
    """Return what a candidate does, in a word."""
    return {ADD: "add", TURN: "turn", MOVE: "move"}[kind]
