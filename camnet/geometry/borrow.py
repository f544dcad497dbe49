"""Named tuples of arrays handed over by their address, for compiled code.

A named tuple is passed by value: a network with its dozens of arrays is some 700 numbers at every call, and code that
takes it is slow to run and slow to compile. ``lend`` gives its address instead. What takes it reads ``x.name`` as
before: a number or an array is loaded, a named tuple inside is lent in turn. Nothing can be written through it (the
arrays' elements can), and it may not outlive the function that lent it.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from typing import Any, TypeVar

from numba.core import cgutils as _cgutils
from numba.core import types as _types
from numba.core.datamodel import models as _models
from numba.core.imputils import impl_ret_borrowed as _impl_ret_borrowed
from numba.core.imputils import lower_getattr_generic as _lower_getattr_generic
from numba.core.typing import templates as _templates
from numba.extending import intrinsic as _intrinsic
from numba.extending import register_model

from camnet.compiled.source import type_text

__all__ = ["lend"]

_T = TypeVar("_T")
#: the inside of Numba has types in part only
cgutils: Any = _cgutils
types: Any = _types
models: Any = _models
templates: Any = _templates
impl_ret_borrowed: Any = _impl_ret_borrowed
intrinsic: Any = _intrinsic
lower_getattr_generic: Any = _lower_getattr_generic


class Lent(_types.Type):
    """Address of a named tuple of the type ``of``."""

    def __init__(self, of: Any) -> None:  # noqa: ANN401 - a type of named tuples
        self.of = of
        # the full name of such a tuple is long, and part of the name of every function that takes it
        digest = hashlib.sha256(type_text(of).encode()).hexdigest()[:16]
        super().__init__(name=f"Lent({of.instance_class.__name__} {digest})")

    @property
    def key(self) -> Any:  # noqa: ANN401 - as in the base
        """What makes two of them the same type."""
        return self.of


@register_model(Lent)
class _LentModel(models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, dmm: Any, fe_type: Lent) -> None:  # noqa: ANN401
        super().__init__(dmm, fe_type, dmm.lookup(fe_type.of).get_value_type().as_pointer())


def _shown(field: Any) -> Any:  # noqa: ANN401
    return Lent(field) if isinstance(field, types.BaseNamedTuple) else field


@templates.infer_getattr
class _LentAttributes(templates.AttributeTemplate):  # type: ignore[misc]
    key = Lent

    def generic_resolve(self, lent: Lent, attr: str) -> Any:  # noqa: ANN401
        """Type of a field."""
        if attr not in lent.of.fields:
            return None
        return _shown(lent.of.types[lent.of.fields.index(attr)])


@lower_getattr_generic(Lent)
def _load_field(context: Any, builder: Any, lent: Lent, address: Any, attr: str) -> Any:  # noqa: ANN401
    k = lent.of.fields.index(attr)
    place = cgutils.gep_inbounds(builder, address, 0, k)
    field = lent.of.types[k]
    if isinstance(field, types.BaseNamedTuple):
        return place
    return impl_ret_borrowed(context, builder, field, builder.load(place))


@intrinsic
def _lend(typing_context: Any, value: Any) -> Any:  # noqa: ANN401
    """Put the tuple in the caller's frame and give its address."""
    if not isinstance(value, types.BaseNamedTuple):
        return None

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:  # noqa: ANN401
        return cgutils.alloca_once_value(builder, arguments[0])

    return Lent(value)(value), codegen


#: gives the address of a named tuple, in compiled code alone; its fields are read as those of the tuple
lend: Callable[[_T], _T] = _lend
