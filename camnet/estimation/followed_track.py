"""What an estimator made of one target's observations."""

from __future__ import annotations

from dataclasses import dataclass

from camnet.types import Array, BoolArray

__all__ = ["Followed"]


@dataclass(frozen=True, eq=False)
class Followed:
    """What one estimator made of the observations.

    Attributes
    ----------
    causal, smoothed : (n,3) positions, m: at each time from what was seen until then, and from everything
    causal_covariance, smoothed_covariance : (n,3,3) m^2; the latter None where the estimator has none
    outlying, drifting : (k,) by observation; None where the estimator does not look for them
    """

    causal: Array
    smoothed: Array
    causal_covariance: Array
    smoothed_covariance: Array | None
    outlying: BoolArray | None = None
    drifting: BoolArray | None = None
