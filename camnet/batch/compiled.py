"""How the loops' parts are compiled."""

from __future__ import annotations

from typing import Any

from numba import njit

__all__ = ["inner", "outer"]

#: options that Numba knows and its type stubs do not
_ALONE: dict[str, Any] = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
#: a division by zero gives what IEEE 754 says, without a test at every division
outer = njit(cache=True, nogil=True, error_model="numpy")
#: for parts that only compiled code calls: without a way in from Python, which for arguments as wide as a whole
#: network costs half of the compilation
inner = njit(cache=True, nogil=True, error_model="numpy", **_ALONE)
