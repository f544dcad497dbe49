"""Named tuples at fixed addresses: what compiled code reads and writes is the arrays themselves."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest

from camnet.geometry.pinned import Pins, StaleCodeError, call_compiled
from camnet.geometry.triples import borrowing
from camnet.types import Array


class _Inside(NamedTuple):
    numbers: Array
    scale: float


class _Outside(NamedTuple):
    table: Array
    inside: _Inside
    out: Array


_PINS = Pins(_Outside)
_outside = _PINS.of


@borrowing
def _sum_up(at: int, k: int, more: Array) -> float:
    x = _outside(at)
    total = 0.0
    for i in range(x.table.shape[0]):
        total += x.table[i, 1]
    x.out[k] = total * x.inside.scale + more[0]
    return float(x.inside.numbers[2])


def _tuple(scale: float = 2.0) -> _Outside:
    return _Outside(np.arange(8.0).reshape(4, 2), _Inside(np.arange(3.0), scale), np.zeros(3))


def test_compiled_code_reads_and_writes_the_arrays_that_were_pinned() -> None:
    first, second = _tuple(), _tuple(-1.0)
    pins = [_PINS.pin(first), _PINS.pin(second)]
    assert _sum_up(pins[0].at, 1, np.array([0.5])) == 2.0
    first.table[0, 1] = 11.0  # seen without pinning again
    _sum_up(pins[0].at, 2, np.zeros(1))
    _sum_up(pins[1].at, 0, np.zeros(1))
    np.testing.assert_array_equal(first.out, [0.0, 32.5, 52.0])
    np.testing.assert_array_equal(second.out, [-16.0, 0.0, 0.0])


def test_another_layout_is_refused_before_and_at_the_call() -> None:
    pinned = _PINS.pin(_tuple())
    with pytest.raises(TypeError, match="_Outside: pinned as"):
        _PINS.pin(_tuple()._replace(table=np.asfortranarray(np.zeros((4, 2)))))
    pinned._room[:8] = 7  # as of a layout that the code was not compiled for
    with pytest.raises(StaleCodeError, match="clear the cache of kernels"):
        _sum_up(pinned.at, 0, np.zeros(1))


class _Kernel:
    """Stands for compiled code that the disk had for another layout."""

    renewed = 0

    def __call__(self, number: int) -> int:
        if not self.renewed:
            raise StaleCodeError
        return number + 1

    def recompile(self) -> None:
        self.renewed += 1


def test_stale_code_is_compiled_anew_once() -> None:
    kernel = _Kernel()
    assert [call_compiled(kernel, k) for k in range(3)] == [1, 2, 3]
    assert kernel.renewed == 1
