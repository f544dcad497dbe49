"""How the loops' parts are compiled.

| decorator | called from | arrays |
| --- | --- | --- |
| ``inlined`` | Python too | none; part of whatever calls it, so that loops over it become vector instructions |
| ``outer`` | Python too | borrowed: none is made or returned inside, so none is counted |
| ``inner`` | compiled code only | the same |
| ``owner`` | Python too | may be made and returned: every array handed over is counted |
| ``inner_owner`` | compiled code only | the same |

Counting references of the dozens of arrays of a network at every call costs six times what the arithmetic does, so
whatever takes a whole network borrows.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from camnet.compiled import cached_njit

__all__ = ["inlined", "inner", "inner_owner", "outer", "owner"]

_F = TypeVar("_F", bound=Callable[..., Any])
#: what is decorated keeps its type: the options promise what Numba's types cannot say
_cached: Any = cached_njit
#: a division by zero gives what IEEE 754 says, without a test at every division
_COMMON: dict[str, Any] = {"nogil": True, "error_model": "numpy"}
#: for parts that only compiled code calls: without a way in from Python, which for arguments as wide as a whole
#: network costs half of the compilation
_ALONE: dict[str, Any] = {**_COMMON, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}

inlined: Callable[[_F], _F] = _cached(**_COMMON, _nrt=False, forceinline=True)
outer: Callable[[_F], _F] = _cached(**_COMMON, _nrt=False)
inner: Callable[[_F], _F] = _cached(**_ALONE, _nrt=False)
owner: Callable[[_F], _F] = _cached(**_COMMON, _nrt=True)
inner_owner: Callable[[_F], _F] = _cached(**_ALONE, _nrt=True)
