"""Random streams of many environments, as rows of an array: the numbers that NumPy's own generator would draw.

Every environment has the generators that the one-environment simulation would have for its seed; what they draw is
the same, so one seed is one episode on either back end. A row holds the state of NumPy's default bit generator:
PCG64, the permuted congruential generator XSL-RR 128/64 of M. E. O'Neill, "PCG: a family of simple fast
space-efficient statistically good algorithms for random number generation", 2014. Normal numbers are drawn by the
ziggurat of G. Marsaglia, W. W. Tsang, "The ziggurat method for generating random variables", J. Stat. Softw. 5 (8),
2000, with 256 layers and 52 bits, as NumPy lays it out.

| column of a row (4,), uint64 | meaning |
| --- | --- |
| 0, 1 | high and low half of the state s |
| 2, 3 | high and low half of the increment c; ``s+ = a s + c`` modulo 2^128 |
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic as _intrinsic
from numpy.typing import NDArray

from camnet.batch.compiled import inlined, outer
from camnet.types import Array

__all__ = ["Streams", "normal", "normals", "stream_of", "uniform"]

Streams = NDArray[np.uint64]

_A_HIGH, _A_LOW = np.uint64(0x2360ED051FC65DA4), np.uint64(0x4385DF649FCCF645)
_63 = np.uint64(63)
_64, _58, _11, _9 = np.uint64(64), np.uint64(58), np.uint64(11), np.uint64(9)
_8, _1 = np.uint64(8), np.uint64(1)
_255, _MASK_52 = np.uint64(255), np.uint64((1 << 52) - 1)
_TO_UNIT = 1.0 / (1 << 53)
_LAYERS = 256
#: where the tail begins, for 256 layers of exp(-x^2/2)
_R = 3.6541528853610088


def _ziggurat() -> tuple[Streams, Array, Array]:
    """Tables k (256,), w (256,), f (256,): accept below k without more ado, scale to x, density at the layer's edge."""
    # the area follows from the tail's beginning: rectangle below it and the tail itself
    area = _R * math.exp(-0.5 * _R * _R) + math.sqrt(0.5 * math.pi) * math.erfc(_R / math.sqrt(2.0))
    edge = np.empty(_LAYERS + 1)
    edge[_LAYERS] = area / math.exp(-0.5 * _R * _R)  # the base layer is as wide as if it had no tail
    edge[_LAYERS - 1] = _R
    for i in range(_LAYERS - 2, 0, -1):
        x = edge[i + 1]
        edge[i] = math.sqrt(-2.0 * math.log(area / x + math.exp(-0.5 * x * x)))
    edge[0] = 0.0
    k, w, f = np.empty(_LAYERS, np.uint64), np.empty(_LAYERS), np.empty(_LAYERS)
    scale = float(1 << 52)
    for layer in range(1, _LAYERS):
        # layer 1 is the topmost, layer 255 the one above the base
        k[layer] = np.uint64(int(edge[layer - 1] / edge[layer] * scale))
        w[layer] = edge[layer] / scale
        f[layer] = math.exp(-0.5 * edge[layer] ** 2)
    k[0] = np.uint64(int(_R / edge[_LAYERS] * scale))
    w[0], f[0] = edge[_LAYERS] / scale, 1.0
    return k, w, f


_K, _W, _F = _ziggurat()


def stream_of(rng: np.random.Generator) -> Streams:
    """Row (4,) that goes on where ``rng`` stands.

    Raises
    ------
    TypeError
        If ``rng`` is of another kind than `numpy.random.default_rng` makes.
    """
    state = rng.bit_generator.state
    if state["bit_generator"] != "PCG64":
        raise TypeError(f"generator of kind {state['bit_generator']}: numpy.random.default_rng makes PCG64")
    low = (1 << 64) - 1
    s, c = state["state"]["state"], state["state"]["inc"]
    return np.array([s >> 64, s & low, c >> 64, c & low], dtype=np.uint64)


intrinsic: Any = _intrinsic


@intrinsic
def _high_product(typing_context: Any, a: Any, b: Any) -> Any:  # noqa: ANN401 - Numba's types
    """Upper 64 bits of the product of two 64-bit numbers: one instruction, which Python has no name for."""
    if a != types.uint64 or b != types.uint64:
        return None

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:  # noqa: ANN401
        wide = ir.IntType(128)
        product = builder.mul(*(builder.zext(x, wide) for x in arguments))
        return builder.trunc(builder.lshr(product, ir.Constant(wide, 64)), ir.IntType(64))

    return types.uint64(a, b), codegen


@inlined
def _after(
    high: np.uint64, low: np.uint64, c_high: np.uint64, c_low: np.uint64
) -> tuple[np.uint64, np.uint64]:
    """Both halves of the next state, given the increment."""
    product_high = _high_product(low, _A_LOW) + high * _A_LOW + low * _A_HIGH
    product_low = low * _A_LOW
    new_low = product_low + c_low
    carry = _1 if new_low < product_low else np.uint64(0)
    return product_high + c_high + carry, new_low


@inlined
def _bits(high: np.uint64, low: np.uint64) -> np.uint64:
    """64 random bits of a state."""
    mixed, turn = high ^ low, high >> _58
    return (mixed >> turn) | (mixed << ((_64 - turn) & _63))


@inlined
def _next(streams: Streams, row: int) -> np.uint64:
    """64 random bits of one stream (rows, 4), which moves on."""
    high, low = _after(streams[row, 0], streams[row, 1], streams[row, 2], streams[row, 3])
    streams[row, 0], streams[row, 1] = high, low
    return _bits(high, low)


@inlined
def uniform(streams: Streams, row: int) -> float:
    """Draw from [0, 1)."""
    return float(_next(streams, row) >> _11) * _TO_UNIT


@outer
def _tail(streams: Streams, row: int) -> float:
    """Distance beyond the beginning of the tail."""
    while True:
        x = -math.log1p(-uniform(streams, row)) / _R
        y = -math.log1p(-uniform(streams, row))
        if 2.0 * y > x * x:
            return x


@inlined
def _cut(bits: np.uint64) -> tuple[int, np.uint64, float]:
    """Layer, 52 bits for the place in it, and the place itself."""
    layer, size = int(bits & _255), (bits >> _9) & _MASK_52
    x = float(size) * _W[layer]
    # times the sign: a branch would be guessed wrong every other time
    return layer, size, x * (1.0 - 2.0 * float((bits >> _8) & _1))


@outer
def _settled(streams: Streams, row: int, bits: np.uint64) -> float:
    """Return the number that begins with these bits."""
    while True:
        layer, size, x = _cut(bits)
        if size < _K[layer]:
            return x
        if layer == 0:
            beyond = _R + _tail(streams, row)
            return -beyond if (size >> _8) & _1 else beyond
        edge = (_F[layer - 1] - _F[layer]) * uniform(streams, row) + _F[layer]
        if edge < math.exp(-0.5 * x * x):
            return x
        bits = _next(streams, row)


@outer
def normal(streams: Streams, row: int) -> float:
    """Draw from the standard normal distribution."""
    return _settled(streams, row, _next(streams, row))


@outer
def normals(streams: Streams, row: int, out: Array) -> None:
    """Fill ``out`` (a, b, c) with draws from the standard normal distribution; the state waits in registers."""
    high, low, c_high, c_low = streams[row, 0], streams[row, 1], streams[row, 2], streams[row, 3]
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            for k in range(out.shape[2]):
                high, low = _after(high, low, c_high, c_low)
                bits = _bits(high, low)
                layer, size, x = _cut(bits)
                if size >= _K[layer]:  # one in eighty: needs more than these bits
                    streams[row, 0], streams[row, 1] = high, low
                    x = _settled(streams, row, bits)
                    high, low = streams[row, 0], streams[row, 1]
                out[i, j, k] = x
    streams[row, 0], streams[row, 1] = high, low
