"""Observations field by field: what each number means, its bounds, and the way from names to the flat array and back.

| field | size | meaning |
| --- | --- | --- |
| `own.position` | 3 | own position from the region's centre, in half-sizes of the region |
| `own.velocity` | 3 | own velocity over the top reference speed |
| `own.gaze` | 2 | pan and tilt of the optical axis from straight down, over the largest |
| `own.region_center` | 3 | the region's centre from the network's centre, in half-sizes of the network |
| `own.region_size` | 3 | half-size of the region over that of the network |
| `target_m.known` | 1 | 1 once the target was seen |
| `target_m.position` | 3 | estimated position from the region's centre, in half-sizes of the region |
| `target_m.velocity` | 3 | estimated velocity over the target's top speed |
| `target_m.heading` | 2 | cosine and sine of the estimated heading |
| `target_m.radius` | 1 | error radius of the estimate over the region's smaller horizontal half-size |
| `target_m.unseen_time` | 1 | time since anybody saw it, over the look-ahead |
| `target_m.seen_by_me`, `.seen` | 1, 1 | seen by the own camera, by any camera |
| `target_m.inside` | 1 | whether the estimate lies in the own region |
| `target_m.coming` | 1 | 1 predicted to enter the own region, 0.5 its error ball touches it, 0 neither |
| `target_m.entry_position` | 3 | predicted entry point from the region's centre, in half-sizes |
| `target_m.entry_velocity` | 3 | predicted velocity there, over the target's top speed |
| `target_m.entry_time` | 1 | time until then over the look-ahead |
| `target_m.entry_radius` | 1 | error radius there over the region's smaller horizontal half-size |
| `target_m.entry_margin` | 1 | 1 - (error radius there) / (radius of the ball that fits the view) |
| `neighbour_k.present` | 1 | 1 if a k-th nearest agent is in range |
| `neighbour_k.position` | 3 | its position from the own one, in half-sizes of the region |

Everything is clipped to its bounds; unknown fields are 0.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from camnet.types import Array

__all__ = ["Field", "ObservationLayout"]

Observation = NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class Field:
    """One named part of an observation: ``size`` numbers in [``low``, ``high``]."""

    name: str
    size: int
    low: float
    high: float


_OWN = (
    Field("own.position", 3, -2.0, 2.0),
    Field("own.velocity", 3, -3.0, 3.0),
    Field("own.gaze", 2, -2.0, 2.0),
    Field("own.region_center", 3, -1.0, 1.0),
    Field("own.region_size", 3, 0.0, 1.0),
)
_TARGET = (
    Field("known", 1, 0.0, 1.0),
    Field("position", 3, -20.0, 20.0),
    Field("velocity", 3, -3.0, 3.0),
    Field("heading", 2, -1.0, 1.0),
    Field("radius", 1, 0.0, 20.0),
    Field("unseen_time", 1, 0.0, 1.0),
    Field("seen_by_me", 1, 0.0, 1.0),
    Field("seen", 1, 0.0, 1.0),
    Field("inside", 1, 0.0, 1.0),
    Field("coming", 1, 0.0, 1.0),
    Field("entry_position", 3, -2.0, 2.0),
    Field("entry_velocity", 3, -3.0, 3.0),
    Field("entry_time", 1, 0.0, 1.0),
    Field("entry_radius", 1, 0.0, 20.0),
    Field("entry_margin", 1, -20.0, 1.0),
)
_NEIGHBOUR = (Field("present", 1, 0.0, 1.0), Field("position", 3, -20.0, 20.0))


class ObservationLayout:
    """Order of the fields of one agent's observation.

    Parameters
    ----------
    n_targets, n_neighbours : how many of each are shown
    """

    def __init__(self, n_targets: int, n_neighbours: int) -> None:
        self.n_targets, self.n_neighbours = n_targets, n_neighbours
        fields = list(_OWN)
        fields += [
            Field(f"target_{m}.{f.name}", f.size, f.low, f.high) for m in range(n_targets) for f in _TARGET
        ]
        fields += [
            Field(f"neighbour_{k}.{f.name}", f.size, f.low, f.high)
            for k in range(n_neighbours)
            for f in _NEIGHBOUR
        ]
        self.fields = tuple(fields)
        self.low = np.concatenate([np.full(f.size, f.low, dtype=np.float32) for f in fields])
        self.high = np.concatenate([np.full(f.size, f.high, dtype=np.float32) for f in fields])
        ends = np.cumsum([f.size for f in fields])
        self.slices = {
            f.name: slice(int(end) - f.size, int(end)) for f, end in zip(fields, ends, strict=True)
        }

    @property
    def size(self) -> int:
        """Length of the flat array."""
        return len(self.low)

    def space(self) -> spaces.Box:
        """Space of the flat array."""
        return spaces.Box(self.low, self.high, dtype=np.float32)

    def dict_space(self) -> spaces.Dict:
        """Space of the same observation as a dictionary of named parts."""
        boxes: dict[str, spaces.Space[Any]] = {
            f.name: spaces.Box(f.low, f.high, (f.size,), dtype=np.float32) for f in self.fields
        }
        return spaces.Dict(boxes)

    def encode(self, values: Mapping[str, float | Array]) -> Observation:
        """Flatten named values (absent ones are 0) and clip them to their bounds."""
        flat = np.zeros(self.size)
        for name, value in values.items():
            flat[self.slices[name]] = value
        return np.clip(flat, self.low, self.high).astype(np.float32)

    def named(self, observation: Observation) -> dict[str, Observation]:
        """Return the parts of a flat observation by name: the same observation in the form of `dict_space`."""
        return {name: observation[where].copy() for name, where in self.slices.items()}

    def decode(self, observation: Observation | Mapping[str, Observation]) -> dict[str, Array]:
        """Named parts of an observation in either form, as float64."""
        if isinstance(observation, Mapping):
            return {name: np.asarray(part, dtype=float) for name, part in observation.items()}
        flat = np.asarray(observation, dtype=float)
        return {name: flat[where] for name, where in self.slices.items()}
