"""Arrays of the part of the trajectory that is still updated: room for the window, moved to the front when full."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from camnet.types import Array, BoolArray

__all__ = ["Window"]

_STATE = {
    "s": (10,),
    "tau": (),
    "rest": (),
    "nxt": (10,),
    "jac": (6, 7),
    "q": (10, 10),
    "q_power": (10, 10),
    "q_steer": (10, 10),
    "q_iso": (10, 10),
    "z": (3,),
    "rbar": (3, 3),
    "pred_d": (10,),
    "pred_p": (10, 10),
    "filt_d": (10,),
    "filt_p": (10, 10),
    "gain": (10, 3),
    "s_inv": (3, 3),
    "y": (3,),
    "d": (10,),
    "lam": (10,),
    "change": (),
}


class Window:
    """Rows ``first`` to ``first + n`` of every array belong to the window; attributes return views of those rows.

    Parameters
    ----------
    limit : largest number of states kept
    observers : number of observer slots to begin with
    """

    if TYPE_CHECKING:
        seen: BoolArray
        has: BoolArray
        sound: BoolArray

    def __init__(self, limit: int, observers: int = 4) -> None:
        self._rows = 2 * limit + 2
        self._first = 0
        self.n = 0
        self._data: dict[str, np.ndarray] = {k: np.zeros((self._rows, *v)) for k, v in _STATE.items()}
        self._data["seen"] = np.zeros(self._rows, dtype=np.bool_)
        self._slots(observers)

    def _slots(self, m: int) -> None:
        self.slots = m
        self._data["obs"] = np.zeros((self._rows, m, 3))
        self._data["given"] = np.zeros((self._rows, m, 3, 3))
        self._data["r"] = np.zeros((self._rows, m, 3, 3))
        self._data["has"] = np.zeros((self._rows, m), dtype=np.bool_)
        self._data["sound"] = np.zeros((self._rows, m), dtype=np.bool_)

    def widen(self, m: int) -> None:
        """Make room for ``m`` observers, keeping what is there."""
        old = {k: self._data[k] for k in ("obs", "given", "r", "has", "sound")}
        kept = self.slots
        self._slots(m)
        for k, v in old.items():
            self._data[k][:, :kept] = v

    def __getattr__(self, name: str) -> Array:
        try:
            data = self.__dict__["_data"][name]
        except KeyError:
            raise AttributeError(name) from None
        return data[self._first : self._first + self.n]  # type: ignore[no-any-return]

    def append(self) -> None:
        """Open a row at the end; its contents are stale until written."""
        if self._first + self.n == self._rows:
            for data in self._data.values():
                data[: self.n] = data[self._first : self._first + self.n].copy()
            self._first = 0
        self.n += 1
        self.has[-1] = False
        self.change[-1] = np.inf

    def drop(self, count: int) -> None:
        """Take ``count`` rows away at the front."""
        self._first += count
        self.n -= count

    def rows(self) -> dict[str, Array]:
        """Return a copy of the window's rows of every array, by name."""
        return {name: data[self._first : self._first + self.n].copy() for name, data in self._data.items()}

    def restore(self, slots: int, count: int, rows: dict[str, Array]) -> None:
        """Take over what `rows` returned, for ``count`` states and ``slots`` observers.

        Raises
        ------
        ValueError : an array is missing, or its shape is another
        """
        self._slots(slots)
        self._first, self.n = 0, count
        for name, data in self._data.items():
            if name not in rows or rows[name].shape != (count, *data.shape[1:]):
                raise ValueError(f"window array {name!r}")
            data[:count] = rows[name]
