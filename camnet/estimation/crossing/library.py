"""Growing columns of numbers: the lessons of a predictor, in the order in which they became known."""

from __future__ import annotations

import numpy as np

from camnet.errors import DataError
from camnet.types import Array, IntArray

__all__ = ["LessonLibrary"]

_FEATURES = 5
_FIRST_CAPACITY = 256


class LessonLibrary:
    """Append-only store; ``known_before`` tells how many of its rows were known at a time.

    Attributes
    ----------
    count : rows held
    """

    def __init__(self) -> None:
        self.count = 0
        self._floats = np.zeros((_FIRST_CAPACITY, _FEATURES + 7))
        self._integers = np.zeros((_FIRST_CAPACITY, 2), dtype=np.int64)

    def append(
        self,
        features: Array,
        penalty: float,
        t_s: float,
        known_s: float,
        start: Array,
        end: Array,
        camera: int,
        target: int,
    ) -> None:
        """Add a lesson: features (5,), penalty, exit time, time known, exit (2,), entry (2,), entry camera, target.

        Raises
        ------
        DataError
            The lesson was known before the one added last: lessons must come in the order of time.
        """
        if self.count and known_s < self._floats[self.count - 1, _FEATURES + 2]:
            raise DataError(
                f"a lesson known at {known_s} s follows one known at {self._floats[self.count - 1, _FEATURES + 2]} s; "
                "lessons must be learned in the order of time"
            )
        if self.count == len(self._floats):
            self._floats = np.concatenate([self._floats, np.zeros_like(self._floats)])
            self._integers = np.concatenate([self._integers, np.zeros_like(self._integers)])
        row = self._floats[self.count]
        row[:_FEATURES] = features
        row[_FEATURES : _FEATURES + 3] = penalty, t_s, known_s
        row[_FEATURES + 3 : _FEATURES + 5] = start
        row[_FEATURES + 5 :] = end
        self._integers[self.count] = camera, target
        self.count += 1

    def known_before(self, t_s: float) -> int:
        """Rows known strictly before ``t_s``: they are the first ones."""
        return int(np.searchsorted(self._floats[: self.count, _FEATURES + 2], t_s, side="left"))

    @property
    def features(self) -> Array:
        """Scaled features (capacity, 5) of every row."""
        return self._floats[:, :_FEATURES]

    @property
    def penalty(self) -> Array:
        """(capacity,) added to squared distances."""
        return self._floats[:, _FEATURES]

    @property
    def t_s(self) -> Array:
        """(capacity,) exit times, s."""
        return self._floats[:, _FEATURES + 1]

    @property
    def start(self) -> Array:
        """(capacity, 2) exits, m."""
        return self._floats[:, _FEATURES + 3 : _FEATURES + 5]

    @property
    def end(self) -> Array:
        """(capacity, 2) entries, m."""
        return self._floats[:, _FEATURES + 5 :]

    @property
    def camera(self) -> IntArray:
        """(capacity,) cameras at the entries."""
        return self._integers[:, 0]

    @property
    def target(self) -> IntArray:
        """(capacity,) who taught."""
        return self._integers[:, 1]
