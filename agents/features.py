"""What a trained policy is shown: the agent's own state and the one target that matters most to it.

An observation's length depends on how many targets and neighbours a world has; these features do not, so that one set
of weights serves every agent of every world. The target in focus is the one that the agent sees, else the one that is
in its region by the estimate, else the one that comes next, else the one that was seen last; ties go to the first.
All numbers keep the scales of `camnet.env.layout`; distances are also shown in metres, since a camera's reach does not
grow with its region.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from camnet.env.layout import ObservationLayout
from camnet.types import Array

__all__ = ["FEATURES", "FeatureMap"]

_OWN = (("own.position", 3), ("own.velocity", 3), ("own.gaze", 2))
_TARGET = (
    ("known", 1),
    ("position", 3),
    ("velocity", 3),
    ("radius", 1),
    ("unseen_time", 1),
    ("seen_by_me", 1),
    ("seen", 1),
    ("inside", 1),
    ("coming", 1),
    ("entry_position", 3),
    ("entry_velocity", 3),
    ("entry_time", 1),
    ("entry_radius", 1),
)
_NEAR = 3.0


def _names() -> Iterator[str]:
    for name, size in (*_OWN, *((f"target.{name}", size) for name, size in _TARGET)):
        yield from ([name] if size == 1 else [f"{name}.{k}" for k in range(size)])
    yield "region.half_width_m"
    yield "region.half_height_m"


#: names of the features, in order
FEATURES = tuple(_names())


class FeatureMap:
    """From observations of one layout to features.

    Parameters
    ----------
    layout : order of the observations' fields
    """

    def __init__(self, layout: ObservationLayout) -> None:
        self._own = np.concatenate([_indices(layout.slices[name]) for name, _ in _OWN])
        self._targets = np.array(
            [
                np.concatenate([_indices(layout.slices[f"target_{m}.{name}"]) for name, _ in _TARGET])
                for m in range(layout.n_targets)
            ]
        )
        names = ("seen_by_me", "inside", "coming", "entry_time", "unseen_time", "known")
        self._keys = {
            name: np.array([layout.slices[f"target_{m}.{name}"].start for m in range(layout.n_targets)])
            for name in names
        }

    def __call__(self, observations: NDArray[np.floating[Any]], half_sizes: Array) -> NDArray[np.float32]:
        """Return features (B, F) of observations (B, D) of agents whose regions have ``half_sizes`` (B, 3), m."""
        shown = np.asarray(observations)
        focus = self._focus(shown)
        target = np.take_along_axis(shown, self._targets[focus], axis=1)
        # far estimates say only that the target is far
        target = np.clip(target, -_NEAR, _NEAR)
        width = half_sizes[:, :2].min(axis=1, keepdims=True)
        parts = [shown[:, self._own], target, width, half_sizes[:, 2:3]]
        return np.concatenate(parts, axis=1).astype(np.float32)

    def _focus(self, shown: NDArray[np.floating[Any]]) -> NDArray[np.intp]:
        """Index (B,) of the target in focus."""
        value = {name: shown[:, columns] for name, columns in self._keys.items()}
        rank = np.where(value["known"] > 0, 3.0 + value["unseen_time"], 9.0)
        rank = np.where(value["coming"] > 0, 2.0 + 0.5 * value["entry_time"] - 0.25 * value["coming"], rank)
        rank = np.where(value["inside"] > 0, 1.0 + 0.5 * value["unseen_time"], rank)
        rank = np.where(value["seen_by_me"] > 0, 0.0, rank)
        return np.asarray(rank.argmin(axis=1))


def _indices(where: slice) -> NDArray[np.intp]:
    return np.arange(where.start, where.stop)
