"""How the estimator's functions are compiled.

A function that only compiled code calls needs no entry for Python, and that entry, which would unpack all settings, is
most of what there is to compile. Division by zero gives inf or nan, as in NumPy.
"""

from __future__ import annotations

from numba import njit

__all__ = ["entry", "part"]

#: decorator of what Python may call
entry = njit(cache=True, nogil=True, error_model="numpy")
#: decorator of what only compiled code calls; the readable form is in its ``py_func``
part = njit(cache=True, nogil=True, error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True)
