"""Settings of the distance observers; defaults are the published ones where the paper states them (section 3.4).

| name | published | unit |
| --- | --- | --- |
| ``k1`` (= k2 = k3), ``k`` | 25, 25 k1 | 1/s |
| ``window_s`` | up to 5 | s |
| ``least_y``, ``least_u_m`` | 0.1, 0.1 | -, m |
| ``distance_m`` | 0.5 to 6 | m |
| ``start_m`` | 0.5 | m |
| ``k_inverse`` | 100 (estimator 3) | |
| ``filter_r``, ``filter_q``, ``filter_p`` | 1e-5; 100, 100, 1e5; 1, 1, 1.5e5 (EKF, times r) | |

``lambda_a``, ``stack_lambda`` and ``stack_size`` are not published: these make learning end about where it does in
print (31 % of a run). ``flow_s`` is the window over which the optical flow is formed; how the paper formed it is not
stated.
"""

from __future__ import annotations

from pydantic import Field

from camnet.settings import Positive, Settings

__all__ = ["ObserverSettings"]


class ObserverSettings(Settings):
    """See the module's table."""

    k1: Positive = 25.0
    k: Positive = 625.0
    k_inverse: Positive = 100.0
    window_s: Positive = 5.0
    least_y: Positive = 0.1
    least_u_m: Positive = 0.1
    distance_m: tuple[Positive, Positive] = (0.5, 6.0)
    start_m: Positive = 0.5
    lambda_a: Positive = 0.02
    stack_lambda: Positive = 1.5
    stack_size: int = Field(default=1000, ge=1)
    flow_s: Positive = 0.27
    filter_r: Positive = 1e-5
    filter_q: tuple[Positive, Positive, Positive] = (100.0, 100.0, 1e5)
    filter_p: tuple[Positive, Positive, Positive] = (1.0, 1.0, 1.5e5)
