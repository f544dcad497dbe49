"""A recorded track: where one thing was, at the times it was recorded."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from camnet.errors import DataError
from camnet.types import Array

__all__ = ["Track"]


@dataclass(frozen=True, eq=False, slots=True)
class Track:
    """Time-stamped positions of one identity, oldest first.

    Attributes
    ----------
    id : identity, as the file names it
    t_s : (n,) times, strictly increasing, s (of the file's own clock: Unix time, simulation time, ...)
    p_world : (n, 3) positions, m
    heading_rad : (n,) anticlockwise from x, or None where the file has none
    speed_mps : (n,) or None where the file has none

    Raises
    ------
    DataError
        The arrays disagree in length, hold NaN or infinity, or time does not increase.
    """

    id: str
    t_s: Array
    p_world: Array
    heading_rad: Array | None = None
    speed_mps: Array | None = None

    def __post_init__(self) -> None:
        t_s = _frozen(self.t_s)
        shapes = {"t_s": (t_s.size,), "p_world": (t_s.size, 3)}
        shapes |= {"heading_rad": (t_s.size,), "speed_mps": (t_s.size,)}
        if t_s.size == 0:
            raise DataError(f"track {self.id!r}: holds no fix; at least one was expected")
        for name, shape in shapes.items():
            value = getattr(self, name)
            if value is None:
                continue
            array = _frozen(value)
            if array.shape != shape:
                raise DataError(f"track {self.id!r}: {name} has shape {array.shape}; {shape} was expected")
            if not np.all(np.isfinite(array)):
                bad = int(np.argmin(np.isfinite(array).reshape(t_s.size, -1).all(axis=1)))
                raise DataError(
                    f"track {self.id!r}: {name}[{bad}] is {array[bad]}; finite values were expected"
                )
            object.__setattr__(self, name, array)
        if np.any(np.diff(t_s) <= 0):
            bad = int(np.argmax(np.diff(t_s) <= 0))
            raise DataError(
                f"track {self.id!r}: t_s[{bad + 1}] = {t_s[bad + 1]} does not follow {t_s[bad]}; "
                "strictly increasing times were expected"
            )

    @property
    def duration_s(self) -> float:
        """Time from the first fix to the last, s."""
        return float(self.t_s[-1] - self.t_s[0])

    def select(self, first: int, last: int) -> Track:
        """Return fixes ``first`` up to but not including ``last``."""
        cut = slice(first, last)
        heading = None if self.heading_rad is None else self.heading_rad[cut]
        speed = None if self.speed_mps is None else self.speed_mps[cut]
        return Track(self.id, self.t_s[cut], self.p_world[cut], heading, speed)


def _frozen(value: Array) -> Array:
    array = np.array(value, dtype=np.float64)
    array.setflags(write=False)
    return array
