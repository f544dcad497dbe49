r"""Theorem 3.1 of harris2020, and why no network with disjoint fields of view can meet it.

| symbol | name | unit | equation |
| --- | --- | --- | --- |
| alpha_max,n(t) = 2 v_max (t - t_off) | in ``ball_radius`` | m | (3-40) |
| beta_min,n+1 = v_max Dt_on + max norm(p_mi - p_m1) | ``beta_m`` | m | (3-41) |
| r_max,n = alpha + beta | ``ball_radius`` | m | below (3-42) |

The argument. Let g >= 0 be the distance of the predicted position at t_off from the next field of view. The projected
predictor moves at most at v_max, so that at tau = t - t_off it is at most v_max tau - g deep in that field of view. The
ball of (3-42) around it has radius 2 v_max tau + beta > v_max tau - g, for every tau >= 0, and therefore always reaches
outside, by at least g + beta. Only a position that is *already* deeper than beta in a field of view can satisfy
the theorem: an occlusion inside one field of view.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from camnet.errors import CertificateError

__all__ = ["Theorem31", "ball_beta", "ball_radius", "occlusion_verdict", "theorem_31"]


@dataclass(frozen=True, slots=True)
class Theorem31:
    """Verdict of Theorem 3.1 for one place where the target may be lost.

    Attributes
    ----------
    verdict : ``certified``, ``not certified`` or ``unsatisfiable``
    reason : one sentence with the numbers
    beta_m : radius of the ball at the moment of loss, m (inf when Lemma 3.4 has no dwell time)
    shortfall_m : least distance by which the ball reaches outside, over all times; <= 0 when certified
    horizon_s : longest occlusion for which the ball stays inside whatever the target does, s (0 when not certified)
    """

    verdict: str
    reason: str
    beta_m: float
    shortfall_m: float
    horizon_s: float

    def as_dict(self) -> dict[str, float | str | None]:
        """Return the record as plain data, for JSON; an infinite length becomes None."""
        return {
            "verdict": self.verdict,
            "reason": self.reason,
            "beta_m": _finite(self.beta_m),
            "shortfall_m": _finite(self.shortfall_m),
            "horizon_s": self.horizon_s,
        }


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def ball_beta(v_max_mps: float, on_min_s: float, extent_m: float) -> float:
    """Return beta of (3-41), m: travel during the time in view that is needed, and the target's extent."""
    return v_max_mps * on_min_s + extent_m  # (3-41)


def ball_radius(v_max_mps: float, tau_s: float, beta_m: float) -> float:
    """Return the radius of the ball of uncertainty ``tau_s`` after feedback was lost, m."""
    return 2.0 * v_max_mps * tau_s + beta_m  # (3-40), (3-42)


def theorem_31(gap_m: float, v_max_mps: float, on_min_s: float | None, extent_m: float) -> Theorem31:
    """Apply Theorem 3.1 to the crossing of a gap between two disjoint fields of view.

    Parameters
    ----------
    gap_m : distance from where the target is lost to the next field of view, m, >= 0
    v_max_mps : bound of the target's and of the predictor's speed, m/s
    on_min_s : dwell time of Lemma 3.4, s; None when no dwell time meets it
    extent_m : largest distance of a feature from the first, m

    Returns
    -------
    Theorem31
        always ``unsatisfiable``, with the numbers of this gap.

    Raises
    ------
    CertificateError
        if the gap is negative: the fields of view overlap and the theorem's premise fails.
    """
    if gap_m < 0.0:
        raise CertificateError(
            f"gap_m = {gap_m!r}: the theorem is about disjoint fields of view, a gap >= 0 is needed"
        )
    least = ball_beta(v_max_mps, on_min_s or 0.0, extent_m)
    reason = (
        f"the predicted position is {gap_m:.3g} m outside the next field of view and moves at most "
        f"{v_max_mps:.3g} m/s, while the ball that must fit inside grows at {2.0 * v_max_mps:.3g} m/s "
        f"from a radius of {'at least ' if on_min_s is None else ''}{least:.3g} m: "
        f"at every time it reaches at least {gap_m + least:.3g} m outside; disjoint views cannot meet the theorem"
    )
    beta = least if on_min_s is not None else math.inf
    shortfall = gap_m + beta  # min over tau of (2 v tau + beta) - (v tau - gap), at tau = 0
    return Theorem31("unsatisfiable", reason, beta, shortfall, 0.0)


def occlusion_verdict(depth_m: float, v_max_mps: float, on_min_s: float | None, extent_m: float) -> Theorem31:
    """Apply Theorem 3.1 to an occlusion inside one field of view, the one case in which it can hold.

    Parameters
    ----------
    depth_m : distance of the predicted position from the outside of the field of view at the moment of loss, m
    v_max_mps, on_min_s, extent_m : as in ``theorem_31``

    Notes
    -----
    The theorem asks for some time at which the ball fits; the earliest is best: depth >= beta at tau = 0. Whatever the
    prediction does, the ball still fits at tau while depth - v tau >= 2 v tau + beta: the horizon returned.
    """
    beta = ball_beta(v_max_mps, on_min_s if on_min_s is not None else float("inf"), extent_m)
    spare = depth_m - beta
    if spare < 0.0:
        reason = (
            f"the target is lost {depth_m:.3g} m inside the view, less than the ball's radius of {beta:.3g} m"
        )
        return Theorem31("not certified", reason, beta, -spare, 0.0)
    horizon = spare / (3.0 * v_max_mps)
    reason = (
        f"the target is occluded {depth_m:.3g} m inside the field of view, the ball of radius {beta:.3g} m fits; "
        f"it does so for {horizon:.3g} s whatever the target does"
    )
    return Theorem31("certified", reason, beta, -spare, horizon)
