"""What the learning estimator and its batch form refuse."""

from __future__ import annotations

import numpy as np
import pytest

from camnet.errors import ConfigError
from camnet.estimation.settings import checked_bounds
from camnet.types import Array

BOX = np.array([[0.0, 0.0, 0.0], [2.0, 3.0, 1.0]])


def test_a_box_is_copied() -> None:
    checked = checked_bounds(BOX, 4, 30.0)
    np.testing.assert_array_equal(checked, BOX)
    assert not np.shares_memory(checked, BOX)


@pytest.mark.parametrize(
    ("bounds", "regions", "rate_hz", "quoted"),
    [
        (BOX[::-1], 4, 30.0, r"tracking_bounds: \[\[2.0, 3.0, 1.0\]"),
        (BOX[:, :2], 4, 30.0, r"expected \(2, 3\)"),
        (BOX * np.nan, 4, 30.0, "lower row below the upper"),
        (BOX, 0, 30.0, "n_regions 0"),
        (BOX, 4, 0.0, "rate_hz 0.0"),
    ],
)
def test_what_makes_no_sense_is_refused(bounds: Array, regions: int, rate_hz: float, quoted: str) -> None:
    with pytest.raises(ConfigError, match=quoted):
        checked_bounds(bounds, regions, rate_hz)
