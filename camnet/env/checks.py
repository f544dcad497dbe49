"""What every form of the environment refuses, in the same words: calls out of order, wrong seeds, options, actions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from camnet.errors import ConfigError
from camnet.types import Array, IntArray

__all__ = [
    "Stage",
    "checked_box",
    "checked_count",
    "checked_number",
    "checked_numbers",
    "checked_rows",
    "checked_seed",
    "named_actions",
    "no_options",
]

#: how far beyond its bounds an action may be and counts as on them: what single precision rounds
_ROUNDING = 1e-6


class Stage:
    """Where an environment is in its life: made, reset, closed.

    Parameters
    ----------
    what : how messages call it
    """

    def __init__(self, what: str = "this environment") -> None:
        self._what = what
        self._closed = self._begun = False

    def begin(self) -> None:
        """Take note of a reset."""
        self._begun = True

    def close(self) -> None:
        """Take note that it is closed."""
        self._closed = True

    def open(self, call: str) -> None:
        """Raise unless ``call`` can be made before a reset.

        Raises
        ------
        ConfigError
            The environment is closed.
        """
        if self._closed:
            raise ConfigError(f"{call}: {self._what} is closed; make a new one")

    def begun(self, call: str) -> None:
        """Raise unless ``call`` can be made in an episode.

        Raises
        ------
        ConfigError
            The environment is closed or was never reset.
        """
        self.open(call)
        if not self._begun:
            raise ConfigError(f"{call}: {self._what} was not reset; call reset() first")


def checked_seed(seed: Any) -> int:  # noqa: ANN401 - whatever a user gives
    """Return a seed as Python's integer.

    Raises
    ------
    ConfigError
        It is no whole number from 0 on.
    """
    if isinstance(seed, np.ndarray) and seed.ndim == 0:
        seed = seed[()]
    if not isinstance(seed, int | np.integer) or isinstance(seed, bool) or seed < 0:
        raise ConfigError(f"seed = {seed!r}: a whole number from 0 on was expected")
    return int(seed)


def checked_count(what: str, value: Any) -> int:  # noqa: ANN401 - whatever a user gives
    """Return a count as Python's integer.

    Raises
    ------
    ConfigError
        It is no whole number from 1 on.
    """
    if not isinstance(value, int | np.integer) or isinstance(value, bool) or value < 1:
        raise ConfigError(f"{what} = {value!r}: a whole number from 1 on was expected")
    return int(value)


def checked_rows(what: str, rows: Any, count: int) -> IntArray:  # noqa: ANN401 - whatever a user gives
    """Return numbers of rows 0..``count`` - 1, each once; None: all.

    Raises
    ------
    ConfigError
        They are others.
    """
    if rows is None:
        return np.arange(count)
    chosen = _array(rows)
    if chosen is not None and chosen.size == 0:
        return np.zeros(0, dtype=np.int64)
    whole = chosen is not None and chosen.ndim == 1 and chosen.dtype.kind in "iu"
    if chosen is None or not whole or chosen.min() < 0 or chosen.max() >= count:
        raise ConfigError(f"{what} = {rows!r}: whole numbers in 0..{count - 1} were expected")
    if len(np.unique(chosen)) < len(chosen):
        raise ConfigError(f"{what} = {rows!r}: each can be named once")
    return chosen.astype(np.int64)


def no_options(form: str, options: Any) -> None:  # noqa: ANN401 - whatever a user gives
    """Refuse options of a reset, where a form has none.

    Raises
    ------
    ConfigError
        There are some; the message names them.
    """
    if options:
        names = ", ".join(map(repr, options)) if isinstance(options, Mapping | Sequence) else repr(options)
        raise ConfigError(f"reset options {names}: {form} has none; set them where it is made")


def named_actions(actions: Any, live: Sequence[str], possible: Sequence[str]) -> dict[str, Any]:  # noqa: ANN401
    """Return the actions of all live agents; those of agents whose episode has ended are left out.

    Raises
    ------
    ConfigError
        The actions are no mapping, one is missing, or one is for somebody who is no agent.
    """
    if not isinstance(actions, Mapping):
        raise ConfigError(f"actions = {actions!r}: a dictionary from agents' names to actions was expected")
    unknown = [name for name in actions if name not in possible]
    if unknown:
        raise ConfigError(f"actions: {unknown[0]!r} is no agent; the agents are {', '.join(possible)}")
    missing = [name for name in live if name not in actions]
    if missing:
        raise ConfigError(f"actions: none given for {missing}; every live agent needs one")
    return {name: actions[name] for name in live}


def checked_box(what: str, action: Any, shape: tuple[int, ...]) -> Array:  # noqa: ANN401 - whatever a user gives
    """Return actions in [-1, 1] as an array of ``shape``.

    Raises
    ------
    ConfigError
        They have another shape or type, are not finite or beyond their bounds.
    """
    values = _array(action)
    if values is None or values.dtype.kind != "f":
        fault = f"type {'mixed' if values is None else values.dtype}"
    elif values.shape != shape:
        fault = f"shape {values.shape}"
    elif not np.isfinite(values).all():
        fault = "not all finite"
    elif np.abs(values).max(initial=0.0) > 1.0 + _ROUNDING:
        fault = f"as large as {np.abs(values).max():g}"
    else:
        return np.clip(np.asarray(values, dtype=np.float64), -1.0, 1.0)
    size = str(shape[0]) if len(shape) == 1 else f"shape {shape},"
    raise ConfigError(
        f"{what} = {action!r}: {size} finite numbers in [-1, 1] of a floating type were expected; given: {fault}"
    )


def checked_number(what: str, action: Any, last: int) -> int:  # noqa: ANN401 - whatever a user gives
    """Return an action 0..``last`` as Python's integer.

    Raises
    ------
    ConfigError
        It is none.
    """
    number = _array(action)
    if number is None or number.ndim or number.dtype.kind not in "iu" or not 0 <= number.item() <= last:
        raise ConfigError(f"{what} = {action!r}: a whole number in 0..{last} was expected")
    return int(number.item())


def checked_numbers(what: str, actions: Any, last: int, shape: tuple[int, ...]) -> IntArray:  # noqa: ANN401
    """Return actions 0..``last`` as an array of ``shape``.

    Raises
    ------
    ConfigError
        They have another shape or type, or are out of range.
    """
    numbers = _array(actions)
    if numbers is None or numbers.dtype.kind not in "iu":
        fault = f"type {'mixed' if numbers is None else numbers.dtype}"
    elif numbers.shape != shape:
        fault = f"shape {numbers.shape}"
    elif ((numbers < 0) | (numbers > last)).any():
        fault = f"{numbers.min()} to {numbers.max()}"
    else:
        return numbers.astype(np.int64)
    raise ConfigError(
        f"{what} = {actions!r}: whole numbers in 0..{last} of shape {shape} were expected; given: {fault}"
    )


def _array(values: Any) -> NDArray[Any] | None:  # noqa: ANN401 - whatever a user gives
    """Return values as an array; None where they are none."""
    try:
        return np.asarray(values)
    except (ValueError, TypeError):  # ragged, or an object that does not convert
        return None
