"""Products with eight columns in vector registers: what a compiler does not make of the plain loops.

Every weight matrix has eight columns (`propagate.COLUMNS`), two vectors of four doubles. The three products here are
written in the compiler's own vector type; multiplication and addition stay apart (no fused operation), so that a
result does not depend on the machine. Each has its plain loop beside it, which is its oracle.

| symbol | name | shape |
| --- | --- | --- |
| M | ``matrix``: symmetric, flat, rows ``stride`` apart; only n by n of it is read | (stride n,) |
| R, out = M R | ``right``, ``out``; ``out`` has room for n rounded up to four rows | (n, 8) |
| s, W, out = s^T W | ``values``, ``rows``, ``out``; rows in ``index``, or one after the other | (k,), (n, 8), (8,) |

No argument is checked: they must be contiguous arrays of doubles that are long enough.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from camnet.types import Array, IntArray

__all__ = ["panel_product", "picked_rows", "plain_panel_product", "plain_picked_rows", "running_rows"]

#: a piece of the compiler's own code: a value, a type, a builder
_Part = Any
_WIDTH = 4
#: rows of the matrix done at a time: with two vectors each they fill half of the registers
_ROWS = 4
_DOUBLE = ir.DoubleType()
_VECTOR = ir.VectorType(_DOUBLE, _WIDTH)
_LANES = ir.VectorType(ir.IntType(32), _WIDTH)
_ZERO = ir.Constant(_VECTOR, [0.0] * _WIDTH)


def plain_panel_product(matrix: Array, stride: int, n: int, right: Array, out: Array) -> None:
    """Readable twin of ``panel_product``."""
    m = matrix[: stride * n].reshape(n, stride)[:, :n]
    out[:n] = m.T @ right[:n]


def plain_picked_rows(values: Array, index: IntArray, count: int, rows: Array, out: Array) -> None:
    """Readable twin of ``picked_rows``; ``running_rows`` is the same with the index first, first + 1, ..."""
    out[:] = values[:count] @ rows[index[:count]]


class _Code:
    """Helpers around one function's builder."""

    def __init__(self, context: _Part, builder: _Part, signature: _Part, args: _Part) -> None:
        self.context, self.b, self.types, self.args = context, builder, signature.args, args

    def data(self, i: int) -> _Part:
        return self.context.make_array(self.types[i])(self.context, self.b, self.args[i]).data

    def vector(self, base: _Part, index: _Part) -> _Part:
        return self.b.bitcast(self.b.gep(base, [index]), _VECTOR.as_pointer())

    def load(self, base: _Part, index: _Part) -> _Part:
        loaded = self.b.load(self.vector(base, index))
        loaded.align = 8
        return loaded

    def store(self, value: _Part, base: _Part, index: _Part) -> None:
        self.b.store(value, self.vector(base, index)).align = 8

    def spread(self, scalar: _Part) -> _Part:
        undefined = ir.Constant(_VECTOR, ir.Undefined)
        one = self.b.insert_element(undefined, scalar, ir.Constant(ir.IntType(32), 0))
        return self.b.shuffle_vector(one, undefined, ir.Constant(_LANES, [0] * _WIDTH))

    def add_product(self, place: _Part, a: _Part, v: _Part) -> None:
        self.b.store(self.b.fadd(self.b.load(place), self.b.fmul(a, v)), place)

    def places(self, count: int) -> list[_Part]:
        return [cgutils.alloca_once(self.b, _VECTOR) for _ in range(count)]  # type: ignore[no-untyped-call]

    def clear(self, places: list[_Part]) -> None:
        for place in places:
            self.b.store(_ZERO, place)


@intrinsic
def _panel_product(
    typing_context: _Part, matrix: _Part, stride: _Part, n: _Part, right: _Part, out: _Part
) -> tuple[_Part, _Part]:
    """Write M R to ``out``: ``panel_product(matrix, stride, n, right, out)``."""
    signature = types.void(matrix, types.intp, types.intp, right, out)

    def codegen(context: _Part, builder: _Part, signature: _Part, args: _Part) -> _Part:
        code, b = _Code(context, builder, signature, args), builder
        m, stride_, n_, r, o = code.data(0), args[1], args[2], code.data(3), code.data(4)
        whole = n_.type

        def number(k: int) -> _Part:
            return ir.Constant(whole, k)

        sums = code.places(2 * _ROWS)
        with cgutils.for_range_slice(b, number(0), n_, number(_ROWS), intp=whole) as (a, _):
            code.clear(sums)
            with cgutils.for_range(b, n_, intp=whole) as loop:
                first = b.mul(loop.index, number(2 * _WIDTH))
                halves = code.load(r, first), code.load(r, b.add(first, number(_WIDTH)))
                # M is symmetric: the entries of four rows in one column follow each other in one row
                entry = b.add(b.mul(loop.index, stride_), a)
                for i in range(_ROWS):
                    factor = code.spread(b.load(b.gep(m, [b.add(entry, number(i))])))
                    for j in range(2):
                        code.add_product(sums[2 * i + j], factor, halves[j])
            for i in range(2 * _ROWS):
                place = b.add(b.mul(a, number(2 * _WIDTH)), number(_WIDTH * i))
                code.store(b.load(sums[i]), o, place)
        return context.get_dummy_value()

    return signature, codegen


def _sum_of_rows(code: _Code, values: _Part, count: _Part, rows: _Part, out: _Part, row_of: _Part) -> None:
    """Sum rows over ``count`` values, two by two: even and odd ones in registers of their own."""
    b, whole = code.b, count.type

    def number(k: int) -> _Part:
        return ir.Constant(whole, k)

    sums = code.places(4)
    code.clear(sums)
    even = b.and_(count, number(-2))

    def term(k: _Part, which: int) -> None:
        factor = code.spread(b.load(b.gep(values, [k])))
        first = b.mul(row_of(k), number(2 * _WIDTH))
        for j in range(2):
            code.add_product(sums[2 * which + j], factor, code.load(rows, b.add(first, number(_WIDTH * j))))

    with cgutils.for_range_slice(b, number(0), even, number(2), intp=whole) as (k, _):
        term(k, 0)
        term(b.add(k, number(1)), 1)
    with b.if_then(b.icmp_signed("<", even, count)):
        term(even, 0)
    for j in range(2):
        total = b.fadd(b.load(sums[j]), b.load(sums[2 + j]))
        code.store(total, out, number(_WIDTH * j))


@intrinsic
def _picked_rows(
    typing_context: _Part, values: _Part, index: _Part, count: _Part, rows: _Part, out: _Part
) -> tuple[_Part, _Part]:
    """Write s^T W over the rows in ``index``: ``picked_rows(values, index, count, rows, out)``."""
    signature = types.void(values, index, types.intp, rows, out)

    def codegen(context: _Part, builder: _Part, signature: _Part, args: _Part) -> _Part:
        code = _Code(context, builder, signature, args)
        picks = code.data(1)

        def row_of(k: _Part) -> _Part:
            return builder.load(builder.gep(picks, [k]))

        _sum_of_rows(code, code.data(0), args[2], code.data(3), code.data(4), row_of)
        return context.get_dummy_value()

    return signature, codegen


@intrinsic
def _running_rows(
    typing_context: _Part,
    values: _Part,
    first_value: _Part,
    count: _Part,
    rows: _Part,
    first_row: _Part,
    scale: _Part,
    out: _Part,
) -> tuple[_Part, _Part]:
    """Add ``scale`` s^T W over rows that follow each other to ``out``.

    ``running_rows(values, first_value, count, rows, first_row, scale, out)``.
    """
    signature = types.void(values, types.intp, types.intp, rows, types.intp, types.float64, out)

    def codegen(context: _Part, builder: _Part, signature: _Part, args: _Part) -> _Part:
        code, b = _Code(context, builder, signature, args), builder
        whole = args[2].type
        values_ = b.gep(code.data(0), [args[1]])
        sums = cgutils.alloca_once(b, ir.ArrayType(_DOUBLE, 2 * _WIDTH))  # type: ignore[no-untyped-call]
        part = b.bitcast(sums, _DOUBLE.as_pointer())

        def row_of(k: _Part) -> _Part:
            return b.add(k, args[4])

        _sum_of_rows(code, values_, args[2], code.data(3), part, row_of)
        factor, out_ = code.spread(args[5]), code.data(6)
        for j in range(2):
            place = ir.Constant(whole, _WIDTH * j)
            code.store(b.fadd(code.load(out_, place), b.fmul(factor, code.load(part, place))), out_, place)
        return context.get_dummy_value()

    return signature, codegen


#: for compiled code alone: panel_product(matrix, stride, n, right, out)
panel_product: Any = _panel_product
#: for compiled code alone: picked_rows(values, index, count, rows, out)
picked_rows: Any = _picked_rows
#: for compiled code alone: running_rows(values, first_value, count, rows, first_row, scale, out)
running_rows: Any = _running_rows
