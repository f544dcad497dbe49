"""Unknowns and data of the bundle adjustment.

| symbol | name | shape | unit | equation |
| --- | --- | --- | --- | --- |
| ``p_i``, ``R_i = R(q_i)`` | ``p``, ``q`` | (P, 3), (P, 4) | m, - | camera to the frame of pose 0, which is held |
| ``m_j = (a, b, 1)``, ``rho_j`` | ``points`` | (M, 3) | -, -, 1/m | ray in the anchor's frame, inverse depth |
| ``a(j)`` | ``anchor`` | (M,) | - | the pose in whose frame point j is held |
| ``s``, ``b`` | ``common`` | (4,) | -, rad/s | odometry scale: ``v_meas = (1 + s) v``; gyro bias |
| ``x = R_i^T (R_a m + rho (p_a - p_i))`` | | (3,) | - | point in camera i, times rho: no singularity at infinity |
| ``e = w (x_xy / x_z - z)`` | | (2,) | - | an observation z of normalised coordinates, ``w = 1 / SD`` |
| ``dp``, ``dR`` | ``shift``, ``turn`` | (P-1, 3), (P-1, 4) | m, - | odometry from pose i to i + 1, frame i |
| ``e_p = L ((1 + s) R_i^T (p_j - p_i) - dp - J_p b)`` | | (3,) | - | ``L`` root of the information |
| ``e_R = w_R Log(Exp(-J_R b) dR^T R_i^T R_j)`` | | (3,) | - | |
| ``e_0`` | | | - | priors on s, on b, and, where given, on each rho |

The cost is ``1/2 sum |e|^2``; observations may be weighed down by Huber's rule. Inverse depth keeps the projection all
but linear in what is unknown however far a point is, so that a start five times too near converges.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from camnet.errors import ConfigError
from camnet.estimation.structure.bundle.preintegrate import Step
from camnet.types import Array, IntArray

__all__ = ["BundleProblem", "BundleState", "Observations", "build_problem"]


class BundleState(NamedTuple):
    """What is estimated; see the module's table."""

    p: Array
    q: Array
    points: Array
    common: Array


class BundleProblem(NamedTuple):
    """What is known; observations are sorted by point, those of point j in ``[start[j], start[j + 1])``."""

    pose: IntArray
    start: IntArray
    xy: Array
    weight: Array
    anchor: IntArray
    inverse_prior: Array
    shift: Array
    turn: Array
    shift_by_bias: Array
    turn_by_bias: Array
    shift_root: Array
    turn_weight: Array
    common_prior: Array
    huber: float


@dataclass(frozen=True, eq=False, slots=True)
class Observations:
    """K observations of points in poses.

    Attributes
    ----------
    pose, point : (K,), (K,) which point was seen from which pose
    xy : (K, 2) normalised coordinates, lens distortion taken out
    sd : (K,) standard deviation of each coordinate
    """

    pose: IntArray
    point: IntArray
    xy: Array
    sd: Array


def build_problem(
    seen: Observations,
    anchor: IntArray,
    steps: list[Step | None],
    scale_sd: float,
    bias_sd_radps: float,
    inverse_prior: Array | None = None,
    huber: float = np.inf,
) -> BundleProblem:
    """Put a problem together.

    Parameters
    ----------
    seen : observations, in any order
    anchor : (M,) pose in whose frame each point is held
    steps : P - 1 odometry steps from each pose to the next; None where there is no odometry
    scale_sd, bias_sd_radps : standard deviations of the odometry's scale and of each component of the gyro's bias
    inverse_prior : (M, 2) mean and standard deviation of the inverse depths, 1/m; None for no prior
    huber : weighted residual from which on an observation counts linearly

    Raises
    ------
    ConfigError
        If a standard deviation is not positive, or an observation names a pose or point that does not exist.
    """
    poses, points = len(steps) + 1, len(anchor)
    for name, value in (("scale_sd", scale_sd), ("bias_sd_radps", bias_sd_radps), ("huber", huber)):
        if not value > 0.0:
            raise ConfigError(f"{name} {value!r}: give a number > 0")
    if len(seen.pose) and not (
        0 <= seen.pose.min() <= seen.pose.max() < poses and 0 <= seen.point.min() <= seen.point.max() < points
    ):
        raise ConfigError(
            f"an observation names a pose outside 0..{poses - 1} or a point outside 0..{points - 1}"
        )
    order = np.argsort(seen.point, kind="stable")
    count = np.bincount(seen.point, minlength=points)
    prior = np.zeros((points, 2))
    if inverse_prior is not None:
        prior[:, 0], prior[:, 1] = inverse_prior[:, 0], 1.0 / inverse_prior[:, 1]
    n = poses - 1
    shift, turn = np.zeros((n, 3)), np.tile([1.0, 0.0, 0.0, 0.0], (n, 1))
    shift_b, turn_b, root, weight = (
        np.zeros((n, 3, 3)),
        np.zeros((n, 3, 3)),
        np.zeros((n, 3, 3)),
        np.zeros(n),
    )
    for i, step in enumerate(steps):
        if step is not None:
            shift[i], turn[i], shift_b[i], turn_b[i] = (
                step.shift,
                step.turn,
                step.shift_by_bias,
                step.turn_by_bias,
            )
            root[i] = np.linalg.cholesky(np.linalg.inv(step.shift_covariance)).T
            weight[i] = 1.0 / step.turn_sd
    return BundleProblem(
        pose=seen.pose[order].astype(np.int64),
        start=np.concatenate([[0], np.cumsum(count)]).astype(np.int64),
        xy=np.ascontiguousarray(seen.xy[order]),
        weight=1.0 / seen.sd[order],
        anchor=np.asarray(anchor, dtype=np.int64),
        inverse_prior=prior,
        shift=shift,
        turn=turn,
        shift_by_bias=shift_b,
        turn_by_bias=turn_b,
        shift_root=root,
        turn_weight=weight,
        common_prior=np.array([1.0 / scale_sd, *([1.0 / bias_sd_radps] * 3)]),
        huber=float(huber),
    )
