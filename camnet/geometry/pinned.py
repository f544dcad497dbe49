"""Named tuples of arrays kept at one address, for compiled functions that Python calls again and again.

Every array that is handed to a compiled function costs more than the arithmetic of a small kernel does. What stays the
same from call to call is pinned once, and its address handed over instead:

    COCKPIT = Pins(Cockpit)                # once, beside the kernels
    pinned = COCKPIT.pin(Cockpit(...))     # once an episode; holds the arrays
    kernel(pinned.at, ...)                 # ``cockpit = COCKPIT.of(at)`` inside, then ``cockpit.bodies`` as usual

The arrays' elements are read and written in place. Whoever replaces an array has to pin again. A header guards against
compiled code that was made for another layout: an address does not tell what it points at, so code on disk cannot be
told apart by it (`camnet.compiled.source`). ``call_compiled`` compiles such code anew.
"""

from __future__ import annotations

import hashlib
from threading import Lock
from typing import Any, Generic, TypeVar

import numpy as np
from numba import typeof as _typeof
from numba import types as _types
from numba.core import cgutils as _cgutils
from numba.extending import intrinsic as _intrinsic

from camnet.compiled import cached_njit
from camnet.compiled.source import layout_text
from camnet.geometry.borrow import Lent

__all__ = ["Pinned", "Pins", "StaleCodeError", "call_compiled"]

#: the inside of Numba has types in part only
types: Any = _types
cgutils: Any = _cgutils
intrinsic: Any = _intrinsic
typeof: Any = _typeof
_T = TypeVar("_T")
#: bytes before the tuple: the digest of its layout, and room so that it begins at a multiple of 16
_HEADER = 16


_RENEWAL = Lock()


class StaleCodeError(RuntimeError):
    """Compiled code was made for another layout of what is pinned."""


def call_compiled(kernel: Any, *arguments: Any) -> Any:  # noqa: ANN401 - any compiled function
    """Call a compiled function; if what the disk had of it is for another layout, compile it anew first."""
    try:
        return kernel(*arguments)
    except StaleCodeError:
        with _RENEWAL:
            try:  # another thread may have been here
                return kernel(*arguments)
            except StaleCodeError:
                kernel.recompile()
                return kernel(*arguments)


class Pinned(Generic[_T]):
    """A named tuple at a fixed address; it has to be kept for as long as the address is used.

    A copy is a copy of the tuple, at an address of its own.
    """

    def __init__(self, value: _T, room: Any, at: int) -> None:  # noqa: ANN401 - an array of bytes
        self.value, self._room, self.at = value, room, at

    def __reduce__(self) -> tuple[Any, ...]:
        return _pin_again, (self.value,)


def _digest(of: Any) -> int:  # noqa: ANN401 - a type of named tuples
    text = f"{of.instance_class.__module__} {of.instance_class.__name__} {of.fields} {of}"
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:7], "little")


@intrinsic
def _size_of(typing_context: Any, value: Any) -> Any:  # noqa: ANN401
    """Bytes that a tuple takes."""

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:  # noqa: ANN401
        size = context.get_abi_sizeof(context.get_value_type(signature.args[0]))
        return context.get_constant(types.intp, size)

    return types.intp(value), codegen


@intrinsic
def _store(typing_context: Any, value: Any, address: Any) -> Any:  # noqa: ANN401
    """Write the layout's digest and a tuple to an address."""

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:  # noqa: ANN401
        tuple_, place = arguments
        digest = context.get_constant(types.int64, _digest(signature.args[0]))
        builder.store(digest, builder.inttoptr(place, digest.type.as_pointer()))
        start = builder.add(place, context.get_constant(types.intp, _HEADER))
        builder.store(tuple_, builder.inttoptr(start, tuple_.type.as_pointer()))
        return context.get_dummy_value()

    return types.void(value, types.intp), codegen


@cached_njit(_nrt=False)
def _room_for(value: Any) -> Any:  # noqa: ANN401
    return _size_of(value)


@cached_njit(_nrt=False)
def _write(value: Any, address: int) -> None:  # noqa: ANN401
    _store(value, address)


#: the pins of every class of named tuples
_PINS_OF: dict[type, Pins[Any]] = {}


def _pins_of(of: type[_T]) -> Pins[_T]:
    return _PINS_OF[of]


def _pin_again(value: _T) -> Pinned[_T]:
    return _PINS_OF[type(value)].pin(value)


class Pins(Generic[_T]):
    """Pins named tuples of one class, and reads them in compiled code.

    Parameters
    ----------
    of : the class; all its instances that are pinned must have fields of the same types

    Attributes
    ----------
    of : in compiled code: the named tuple at an address, with fields that are read as usual
    """

    def __init__(self, of: type[_T]) -> None:
        self._class = of
        self._type: Any = None
        self.of: Any = self._reader()
        _PINS_OF[of] = self

    def __reduce__(self) -> tuple[Any, ...]:
        return _pins_of, (self._class,)

    def compiled_source(self) -> str:
        """Describe the layout that compiled code reads, for `camnet.compiled.source`."""
        return layout_text(self._class)

    def pin(self, value: _T) -> Pinned[_T]:
        """Copy a named tuple's references to an address of its own; the arrays themselves are not copied.

        Raises
        ------
        TypeError
            A field has another type, number of axes or layout in memory than in the first tuple that was pinned.
        """
        of = typeof(value)
        if self._type is None:
            self._type = of
        elif of != self._type:
            raise TypeError(f"{self._class.__name__}: pinned as {of}, before as {self._type}")
        room = np.zeros(_HEADER + _room_for(value), dtype=np.uint8)
        at = int(room.ctypes.data)
        _write(value, at)
        return Pinned(value, room, at)

    def _reader(self) -> Any:  # noqa: ANN401 - an intrinsic
        pins = self

        def read(typing_context: Any, address: Any) -> Any:  # noqa: ANN401
            of = pins._type
            if of is None:
                raise TypeError(f"{pins._class.__name__}: nothing is pinned yet")

            def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:  # noqa: ANN401
                (place,) = arguments
                digest = context.get_constant(types.int64, _digest(of))
                found = builder.load(builder.inttoptr(place, digest.type.as_pointer()))
                with cgutils.if_unlikely(builder, builder.icmp_unsigned("!=", found, digest)):
                    text = "compiled code is older than what it is called with: clear the cache of kernels"
                    context.call_conv.return_user_exc(builder, StaleCodeError, (text,))
                start = builder.add(place, context.get_constant(types.intp, _HEADER))
                return builder.inttoptr(start, context.get_value_type(of).as_pointer())

            return Lent(of)(types.intp), codegen

        return intrinsic(read)
