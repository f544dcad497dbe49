"""Copies that go on like the original, for objects that hold arrays at fixed addresses, views and outside resources.

What the standard ways of copying lose is kept here: an array that is a view of another one stays a view of that one's
copy, its layout in memory and its write flag stay as they are. Compiled code reads and writes such arrays in place, and
is made for their layout. Functions made at run time (closures, lambdas) are copied by value, as `cloudpickle` does.

>>> class Simulation(ExactCopies): ...
>>> copy.deepcopy(simulation), pickle.loads(pickle.dumps(simulation))
"""

from __future__ import annotations

import io
import pickle
import sys
from typing import Any, Literal

import cloudpickle
import numpy as np
from numba.core.dispatcher import Dispatcher
from numpy.typing import NDArray

from camnet.types import IntArray

__all__ = ["ExactCopies"]

#: compiled functions; the inside of Numba has no types
_Compiled: Any = Dispatcher
#: arrays of so many bytes are copied page by page; bytes of a page
_LARGE, _PAGE = 1 << 20, 4096


class ExactCopies:
    """Base of classes whose copies (`copy.deepcopy`, `pickle`, `cloudpickle`) share nothing and go on alike.

    A subclass that holds something outside of Python's memory gives it up in ``__getstate__`` and makes it anew in
    ``__setstate__``; all its parts are complete by then. `copy.copy` makes a whole copy, too: half of one would share
    the arrays that the original writes.
    """

    def __reduce_ex__(self, protocol: Any) -> tuple[Any, ...]:  # noqa: ANN401 - an index, says the data model
        return _restored, (_packed(self),)

    def __deepcopy__(self, memo: dict[int, Any]) -> Any:  # noqa: ANN401 - the same type
        return _restored(_packed(self))


class _Packer(cloudpickle.Pickler):  # type: ignore[misc] # the package has no types
    """Keeps views, layouts and write flags of arrays."""

    def reducer_override(self, obj: Any) -> Any:  # noqa: ANN401 - any object
        if type(obj) is np.ndarray and not obj.dtype.hasobject:
            return _array_parts(obj)
        if isinstance(obj, ExactCopies):
            return object.__reduce_ex__(obj, pickle.HIGHEST_PROTOCOL)
        if isinstance(obj, _Compiled) and _is_global(obj):
            return obj.__name__
        return super().reducer_override(obj)


def _packed(whole: ExactCopies) -> bytes:
    file = io.BytesIO()
    _Packer(file, protocol=pickle.HIGHEST_PROTOCOL).dump(whole)
    return file.getvalue()


def _restored(packed: bytes) -> Any:  # noqa: ANN401 - whatever was packed
    return pickle.loads(packed)


def _is_global(kernel: Any) -> bool:  # noqa: ANN401 - a compiled function
    return getattr(sys.modules.get(kernel.__module__), kernel.__name__, None) is kernel


def _array_parts(array: NDArray[Any]) -> Any:  # noqa: ANN401 - as `reducer_override`
    """Return how to make an array again: as a view of its owner, read-only, or (NotImplemented) in the usual way."""
    owner = array
    while isinstance(owner.base, np.ndarray):
        owner = owner.base
    if owner is not array and type(owner) is np.ndarray and owner.flags.forc and array.size:
        offset = array.__array_interface__["data"][0] - owner.__array_interface__["data"][0]
        layout = (offset, array.shape, array.strides, array.dtype)
        return _view, (owner, *layout, array.flags.writeable)
    if not array.flags.writeable:
        return _read_only, (array.copy(order="K"),)
    if array.nbytes >= _LARGE and array.flags.forc:
        return _large_parts(array)
    return NotImplemented


def _large_parts(array: NDArray[Any]) -> tuple[Any, ...]:
    """Return how to make a large array from its pages that are not zero: rooms are made larger than what is in them."""
    order = "C" if array.flags.c_contiguous else "F"
    flat = array.ravel(order="K").view(np.uint8)
    pages, rest = _pages(flat)
    used = np.flatnonzero(pages.view(np.uint64).any(axis=1))
    return _from_pages, (array.shape, array.dtype, order, used, pages[used].tobytes(), rest.tobytes())


def _pages(flat: NDArray[np.uint8]) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Split bytes in whole pages (K, _PAGE) and what is left."""
    whole = len(flat) // _PAGE * _PAGE
    return flat[:whole].reshape(-1, _PAGE), flat[whole:]


def _from_pages(
    shape: tuple[int, ...],
    dtype: np.dtype[Any],
    order: Literal["C", "F"],
    used: IntArray,
    content: bytes,
    rest: bytes,
) -> NDArray[Any]:
    array = np.zeros(shape, dtype, order=order)
    pages, tail = _pages(array.ravel(order="K").view(np.uint8))
    pages[used] = np.frombuffer(content, dtype=np.uint8).reshape(-1, _PAGE)
    tail[:] = np.frombuffer(rest, dtype=np.uint8)
    return array


def _view(
    owner: NDArray[Any],
    offset: int,
    shape: tuple[int, ...],
    strides: tuple[int, ...],
    dtype: np.dtype[Any],
    writeable: bool,
) -> NDArray[Any]:
    view: NDArray[Any] = np.ndarray(shape, dtype, owner.ravel(order="K"), offset, strides)
    if not writeable:
        view.setflags(write=False)
    return view


def _read_only(array: NDArray[Any]) -> NDArray[Any]:
    array.setflags(write=False)
    return array
