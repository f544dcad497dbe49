"""The one decorator of compiled functions whose machine code is kept on disk.

Numba keeps code beside the source or in a home, and refuses to compile where neither can be written. Its index of files
is not safe for several processes, and it notices changes in the function's own file alone. ``cached_njit`` compiles as
``numba.njit`` does and keeps the code in `camnet.compiled.store`. Nothing is read, written or compiled on import.

The name of the file is a digest of

| part | so that |
| --- | --- |
| source of the function and of all that it calls (`camnet.compiled.source`) | a change anywhere is compiled |
| types of the arguments, with names of named tuples' fields | each kind of call has its code |
| options of the compiler | ``error_model`` and the like count |
| processor and its features, as Numba sees them (``NUMBA_CPU_NAME``) | a folder may serve several machines |
| versions of Python, Numba, llvmlite, NumPy; Numba's switches | an update is compiled |
"""

from __future__ import annotations

import hashlib
import logging
import sys
from collections.abc import Callable, Iterator
from functools import cache
from typing import Any, TypeVar, overload
from weakref import WeakSet

import llvmlite
import numba
import numpy as np
from numba.core import config as _config
from numba.core.caching import _Cache as _NumbaCache
from numba.core.compiler import CompileResult as _CompileResult
from numba.core.dispatcher import Dispatcher as _Dispatcher

from camnet.compiled import store
from camnet.compiled.source import source_digest, type_text

__all__ = ["KernelCache", "announce", "cached_njit", "kernels"]

_LOG = logging.getLogger(__name__)
#: the inside of Numba has no types
config: Any = _config
_Base: Any = _NumbaCache
_Result: Any = _CompileResult
#: Numba's switches that change the code
_SWITCHES = (
    *("OPT", "LOOP_VECTORIZE", "SLP_VECTORIZE", "ENABLE_AVX", "DISABLE_INTEL_SVML", "USING_SVML"),
    *(
        "BOUNDSCHECK",
        "DEBUGINFO_DEFAULT",
        "LLVM_REFPRUNE_PASS",
        "LLVM_REFPRUNE_FLAGS",
        "EXTEND_VARIABLE_LIFETIMES",
    ),
)
_Function = TypeVar("_Function", bound=Callable[..., Any])
_kernels: WeakSet[Any] = WeakSet()


@cache
def _program() -> str:
    versions = (numba.__version__, llvmlite.__version__, np.__version__)
    switches = tuple((name, str(getattr(config, name, None))) for name in _SWITCHES)
    return repr((sys.implementation.cache_tag, getattr(sys, "abiflags", ""), versions, switches))


class KernelCache(_Base):  # type: ignore[misc]
    """Machine code of one function, as Numba's dispatcher asks for it."""

    def __init__(self, function: Any, options: dict[str, object]) -> None:  # noqa: ANN401
        self._function, self._options, self._enabled = function, options, True
        self.name = f"{function.__module__}.{function.__qualname__}"

    @property
    def cache_path(self) -> None:
        """Numba shows it in its statistics."""
        return None

    @property
    def source(self) -> str:
        """Digest of the function's source; not asked for on import, names may be bound further down in the file."""
        return source_digest(self._function)

    def _key(self, signature: Any, codegen: Any) -> str | None:  # noqa: ANN401
        """Digest of all besides the source; None for arguments that another process cannot have."""
        arguments = getattr(signature, "args", signature)
        result = getattr(signature, "return_type", None)
        types = [type_text(of) for of in (*arguments, result)]
        if any(
            " at 0x" in text for text in types
        ):  # a function that is handed over has an address for a name
            return None
        options = sorted((name, repr(value)) for name, value in self._options.items())
        what = repr((types, options, codegen.magic_tuple(), _program()))
        return hashlib.sha256(what.encode()).hexdigest()

    def load_overload(self, sig: Any, target_context: Any) -> Any:  # noqa: ANN401
        """Return compiled code for a signature, or None."""
        target_context.refresh()
        key = self._key(sig, target_context.codegen()) if self._enabled else None
        data = None if key is None else store.load(self.name, self.source, key)
        if data is None:
            return None
        try:
            return _Result._rebuild(target_context, *data)
        except Exception:  # of a module that is not there
            _LOG.debug("kept code of %s cannot be used", self.name, exc_info=True)
            return None

    def save_overload(self, sig: Any, data: Any) -> None:  # noqa: ANN401
        """Keep compiled code."""
        if not self._enabled or data.library.has_dynamic_globals or any(not x.can_cache for x in data.lifted):
            return
        key = self._key(sig, data.codegen)
        if key is not None:
            store.save(self.name, self.source, key, data._reduce())

    def enable(self) -> None:
        """Look on the disk."""
        self._enabled = True

    def disable(self) -> None:
        """Do not look on the disk."""
        self._enabled = False

    def flush(self) -> None:
        """Forget what is kept."""
        store.remove(self.name, self.source)


@overload
def cached_njit(function: _Function) -> _Dispatcher[_Function]: ...
@overload
def cached_njit(
    function: None = None, **options: object
) -> Callable[[_Function], _Dispatcher[_Function]]: ...
def cached_njit(function: Callable[..., Any] | None = None, **options: object) -> Any:
    """Compile a function as ``numba.njit`` does and keep its machine code (`camnet.cache_folder`).

    Parameters
    ----------
    function : what is decorated; without it a decorator is returned
    **options : of ``numba.njit``, without ``cache``

    Returns
    -------
    object
        Numba's dispatcher; the function itself where Numba is switched off (``NUMBA_DISABLE_JIT``).
    """
    if function is None:
        return lambda decorated: _compiled(decorated, options)
    return _compiled(function, options)


def _compiled(function: Callable[..., Any], options: dict[str, Any]) -> Any:  # noqa: ANN401 - a dispatcher
    dispatcher: Any = numba.njit(**options)(function)
    if hasattr(dispatcher, "enable_caching"):
        dispatcher._cache = KernelCache(function, options)
        _kernels.add(dispatcher)
    return dispatcher


def kernels() -> Iterator[Any]:
    """Return all kernels that have been imported, by name."""
    return iter(sorted(_kernels, key=lambda kernel: kernel._cache.name))


def announce(kernel: Any, what: str) -> None:  # noqa: ANN401 - a compiled function
    """Warn that ``what`` has to be compiled first, if the disk has no code of ``kernel`` as it is; call before it."""
    kept = getattr(kernel, "_cache", None)
    if not isinstance(kept, KernelCache) or kernel.signatures:
        return
    if not store.is_known(kept.name, kept.source):
        _LOG.warning("compiling %s; this takes a minute or two, once on this machine", what)
