"""How near the numbers of two programs must be that compute the same.

Bit equality is asked only of the same code run again: one seed twice, on other processes, a run that was taken up
again. Two programs (a compiled kernel and NumPy, single steps and many at a time) round in different orders, and which
of their results agree bit for bit depends on the processor and its libraries.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

#: units in the last place that one result may be off by
ULPS = 4


def assert_rounded_alike(found: ArrayLike, wanted: ArrayLike, scale: float = 0.0, steps: int = 1) -> None:
    """Two arrays of one shape are equal up to rounding; NaN equals NaN, and an infinity only itself.

    Parameters
    ----------
    found, wanted : results of two programs
    scale : size of the numbers that were added up, where the results may be smaller
    steps : how many results were made one from another, each of them rounded
    """
    found, wanted = np.asarray(found, dtype=float), np.asarray(wanted, dtype=float)
    assert found.shape == wanted.shape
    finite = np.isfinite(wanted)
    np.testing.assert_array_equal(np.where(finite, 0.0, wanted), np.where(finite, 0.0, found))
    size = np.maximum(np.abs(wanted[finite]), scale)
    ulps = np.abs(found[finite] - wanted[finite]) / np.spacing(np.maximum(size, np.finfo(float).tiny))
    assert ulps.max(initial=0.0) <= ULPS * steps, f"off by {ulps.max():.3g} units in the last place"


def assert_records_alike(found: Any, wanted: Any, scale: float = 0.0, steps: int = 1) -> None:
    """Nested mappings and sequences are the same but for the rounding of their floating-point numbers."""
    if isinstance(wanted, Mapping):
        assert list(found) == list(wanted)
        for name in wanted:
            assert_records_alike(found[name], wanted[name], scale, steps)
    elif isinstance(wanted, Sequence) and not isinstance(wanted, str):
        assert len(found) == len(wanted)
        for one, other in zip(found, wanted, strict=True):
            assert_records_alike(one, other, scale, steps)
    elif isinstance(wanted, float) and isinstance(found, float):
        assert_rounded_alike(found, wanted, scale, steps)
    else:
        assert found == wanted
