"""Laws of motion that a user states: formulas, a grid of velocities, or a function of a Python module.

| law | of | gives |
| --- | --- | --- |
| ``velocity_mps`` | place (and time) | velocity |
| ``acceleration_mps2`` | place, velocity (and time) | acceleration |
| ``grid`` | place | velocity, linear between the points of a regular grid |
| ``entry`` | place and time; with ``start_velocity_mps`` place, velocity and time | velocity; acceleration |

Places (n, d) and velocities (n, d) have d = 2 on the ground, 3 in space.
"""

from __future__ import annotations

import csv
import importlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import RegularGridInterpolator

from camnet.errors import ConfigError, DataError
from camnet.motion.expression import parse_expression
from camnet.motion.settings import FieldTarget
from camnet.types import Array

__all__ = ["FieldLaw", "build_law"]

_AXES = "xyz"
#: most points of a grid
_MOST_POINTS = 2_000_000


@dataclass(frozen=True, eq=False, slots=True)
class FieldLaw:
    """A law of motion in ``dimensions`` dimensions.

    Attributes
    ----------
    of : from places (n, d), velocities (n, d) and a time, s, to velocities, m/s, or accelerations, m/s^2, (n, d)
    accelerates : whether it gives accelerations
    of_time : whether the time may matter
    """

    dimensions: int
    of: Callable[[Array, Array, float], Array]
    accelerates: bool = False
    of_time: bool = False

    @property
    def by_place(self) -> bool:
        """Whether the place alone decides the velocity."""
        return not (self.accelerates or self.of_time)

    def velocity(self, places: Array) -> Array:
        """Return velocities (n, d) at places (n, d) of a law that they alone decide."""
        return self.of(places, np.zeros_like(places), 0.0)


def build_law(motion: FieldTarget) -> FieldLaw:
    """Return the law that a target's settings state.

    Raises
    ------
    ConfigError, DataError
        A formula, a module or a file is not what it should be.
    """
    if motion.velocity_mps is not None:
        return _formulas(motion.velocity_mps, motion, accelerates=False)
    if motion.acceleration_mps2 is not None:
        return _formulas(motion.acceleration_mps2, motion, accelerates=True)
    if motion.grid is not None:
        return _grid(motion.grid)
    assert motion.entry is not None
    return _entry(motion.entry, motion)


def _formulas(texts: Sequence[str | float], motion: FieldTarget, accelerates: bool) -> FieldLaw:
    d = len(texts)
    variables = [*_AXES[:d], "t", *([f"v{a}" for a in _AXES[:d]] if accelerates else [])]
    twice = sorted(set(variables) & set(motion.parameters))
    if twice:
        raise ConfigError(f"parameters: {twice[0]!r} is a variable of the formulas already: rename it")
    formulas = [parse_expression(text, {*variables, *motion.parameters}) for text in texts]

    def of(p: Array, v: Array, t_s: float) -> Array:
        known: dict[str, Any] = {**motion.parameters, "t": t_s}
        known |= {a: p[:, k] for k, a in enumerate(_AXES[:d])} | {
            f"v{a}": v[:, k] for k, a in enumerate(_AXES[:d])
        }
        return np.stack([np.broadcast_to(f(known), len(p)) for f in formulas], axis=1)

    return FieldLaw(d, of, accelerates, any("t" in f.names for f in formulas))


def _entry(name: str, motion: FieldTarget) -> FieldLaw:
    module, colon, attribute = name.partition(":")
    try:
        if not (colon and module and attribute):
            raise AttributeError("module:attribute was expected, such as my_targets:whirl")
        function = getattr(importlib.import_module(module), attribute)
    except (ImportError, AttributeError) as error:
        raise ConfigError(f"entry: {name!r}: {error}; is its folder on PYTHONPATH?") from None
    if not callable(function):
        raise ConfigError(f"entry: {name!r} is {type(function).__name__}: a function was expected")
    accelerates = motion.start_velocity_mps is not None
    words = "place, velocity, time" if accelerates else "place, time"

    def of(p: Array, v: Array, t_s: float) -> Array:
        arguments = (p.copy(), v.copy(), t_s) if accelerates else (p.copy(), t_s)
        try:
            value = np.asarray(function(*arguments), dtype=np.float64)
        except Exception as error:  # whatever a user's function raises
            raise ConfigError(
                f"entry: {name!r} of ({words}) failed: {type(error).__name__}: {error}"
            ) from error
        if value.shape != p.shape:
            raise ConfigError(
                f"entry: {name!r} returned shape {value.shape} for places {p.shape}: a row for each place was expected"
            )
        return value

    return FieldLaw(
        motion.dimensions, of, accelerates, of_time=True if motion.of_time is None else motion.of_time
    )


def _grid(path: Path) -> FieldLaw:
    """Read a CSV with columns x, y[, z], vx, vy[, vz]: one row for each point of a regular grid, in any order."""
    names, table = _table(path)
    d = 3 if "z" in names else 2
    wanted = [*_AXES[:d], *(f"v{a}" for a in _AXES[:d])]
    missing = [n for n in wanted if n not in names]
    if missing:
        raise DataError(f"{path}: has no column {missing[0]!r}; {', '.join(wanted)} were expected")
    columns = table[:, [names.index(n) for n in wanted]]
    axes = [np.unique(columns[:, k]) for k in range(d)]
    shape = tuple(len(a) for a in axes)
    if min(shape) < 2 or len(columns) != np.prod(shape):
        raise DataError(
            f"{path}: {len(columns)} rows, and {' x '.join(map(str, shape))} different coordinates: a regular grid of "
            "at least 2 points along each axis was expected, each point once"
        )
    place = tuple(np.searchsorted(axes[k], columns[:, k]) for k in range(d))
    values = np.full((*shape, d), np.nan)
    values[place] = columns[:, d:]
    if np.isnan(values).any():
        raise DataError(f"{path}: some points of the grid are there twice, others not at all")
    inside = RegularGridInterpolator(axes, values, bounds_error=False, fill_value=np.nan)
    return FieldLaw(d, lambda p, v, t_s: np.asarray(inside(p)))


def _table(path: Path) -> tuple[list[str], Array]:
    try:
        with path.open(encoding="utf-8-sig", newline="") as stream:
            rows = [row for row in csv.reader(stream) if row and not row[0].startswith("#")]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise DataError(f"{path}: cannot be read: {error}") from None
    if not 1 < len(rows) <= _MOST_POINTS:
        raise DataError(f"{path}: {len(rows)} lines: a head and up to {_MOST_POINTS:,} points were expected")
    names = [n.strip() for n in rows[0]]
    out = np.empty((len(rows) - 1, len(names)))
    for k, row in enumerate(rows[1:]):
        try:
            out[k] = [float(x) for x in row]
        except ValueError:
            raise DataError(
                f"{path}: line {k + 2}: {','.join(row)!r}: {len(names)} numbers were expected"
            ) from None
    if not np.isfinite(out).all():
        raise DataError(f"{path}: line {int(np.argmin(np.isfinite(out).all(axis=1))) + 2}: is not finite")
    return names, out
