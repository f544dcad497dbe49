"""Random draws of many environments, one set a decision, each from its environment's own generator.

``generator.random(n)`` after ``generator.random(n)`` gives the numbers of ``generator.random(2 n)``: draws are made for
some decisions ahead, and are those that an environment alone would draw.
"""

from __future__ import annotations

import numpy as np

from camnet.types import Array, IntArray

__all__ = ["Chance"]

#: decisions that are drawn at once
_AHEAD = 16


class Chance:
    """Uniform draws in [0, 1) of E environments.

    Parameters
    ----------
    environments : E
    size : draws a decision
    """

    def __init__(self, environments: int, size: int) -> None:
        self._rngs = [np.random.default_rng(0) for _ in range(environments)]
        self._drawn = np.zeros((environments, _AHEAD, size))
        self._used = np.full(environments, _AHEAD)

    def reset(self, e: int, rng: np.random.Generator) -> None:
        """Let ``rng`` draw for environment ``e`` from now on."""
        self._rngs[e], self._used[e] = rng, _AHEAD

    def draw(self, rows: IntArray) -> Array:
        """Return the next draws (K, size) of the environments ``rows`` (K,)."""
        for e in rows[self._used[rows] == _AHEAD].tolist():
            self._drawn[e] = self._rngs[e].random(self._drawn.shape[1:])
            self._used[e] = 0
        found = self._drawn[rows, self._used[rows]]
        self._used[rows] += 1
        return np.asarray(found)
