"""How the loops' parts are compiled."""

from __future__ import annotations

from numba import njit

__all__ = ["inner"]

#: for parts that only compiled code calls: without a way in from Python, which for arguments as wide as a whole
#: network costs half of the compilation
inner = njit(cache=True, no_cpython_wrapper=True, no_cfunc_wrapper=True)
