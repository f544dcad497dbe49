r"""How far an agent that dead-reckons can be from where it believes to be: its outage budget.

With ``A = (1 + d) R(th~) - I`` the error of a dead-reckoned position obeys ``e' = A p' + n``; d is what calibration
leaves of the scale, ``th~ = h + b t + w`` the heading's error from its start h, the gyro's bias b and white noise w.
Part of A that does not come from noise is smooth, so that integration by parts bounds its share by how far the agent
gets from where the outage began (D), and its size by how far it travels (V T):

    e(T) <= e_0 + min( (d + q h + 2 q b T) D,  (d + q h) V T + q b V T^2 / 2 ) + sigmas sqrt(s_p^2 T + (q s_th D)^2 T)

with ``q = 1 + d``. The first is ``|A(T) (p(T) - p(0)) - int A' (p - p(0)) dt|`` with ``|A(T)| <= d + q (h + b T)`` and
``|A'| <= q b``. The last term is the accumulated white noise, position and heading (through the lever D, by parts too);
that it stays within so many standard deviations is stated, not proven.

The 95 % version adds variances: every stated bound is ``sigmas`` standard deviations. ``P(sup_t |e| > r) <= 2 P(|e(T)|
> r)`` for symmetric sums (Levy), so that the Rayleigh quantile of 97.5 % bounds the whole outage with 95 %.

| symbol | name | unit |
| --- | --- | --- |
| D, V | ``reach_m``, ``speed_mps`` | m, m/s |
| R | ``radius_m`` of the view | m |
| V_hi = (R - e)^2 / 2 | ``upper_level`` | m^2 |
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from camnet.errors import CertificateError
from camnet.sensing.own_pose_settings import ErrorBounds, PoseSource

__all__ = ["OutageBounds", "bounds_of", "upper_level"]

#: radius, in standard deviations of a coordinate, that a plane Gaussian error exceeds with a probability of 2.5 %
_RAYLEIGH_975 = math.sqrt(-2.0 * math.log(0.025))
#: a run's scale and bias lie within so many standard deviations (`camnet.estimation.own_pose`)
_DRAWN_WITHIN = 2.0


@dataclass(frozen=True, slots=True)
class OutageBounds:
    """Bounds of an agent's own position after an outage.

    Attributes
    ----------
    bounds : of the errors that an outage begins with
    walk_p_m, walk_th_rad : white noise after one second, standard deviations
    reach_m : farthest that the agent gets from where an outage began, m
    speed_mps : highest speed, m/s
    """

    bounds: ErrorBounds
    walk_p_m: float
    walk_th_rad: float
    reach_m: float
    speed_mps: float

    def error_m(self, outage_s: float) -> float:
        """Return e(T), m."""
        b, t, q = self.bounds, _checked(outage_s), 1.0 + self.bounds.scale
        near = (b.scale + q * b.heading_rad + 2.0 * q * b.gyro_bias_radps * t) * self.reach_m
        far = (b.scale + q * b.heading_rad + 0.5 * q * b.gyro_bias_radps * t) * self.speed_mps * t
        return b.position_m + min(near, far) + b.sigmas * self._noise(t)

    def likely_error_m(self, outage_s: float) -> float:
        """Return what the error stays below throughout an outage with 95 %, m."""
        b, t, q = self.bounds, _checked(outage_s), 1.0 + self.bounds.scale
        reach = min(self.reach_m, self.speed_mps * t)
        parts = (
            b.position_m,
            b.scale * reach,
            q * b.heading_rad * reach,
            q * b.gyro_bias_radps * t * min(2.0 * self.reach_m, 0.5 * self.speed_mps * t),
        )
        return _RAYLEIGH_975 * math.hypot(*(x / b.sigmas for x in parts), self._noise(t))

    def _noise(self, t: float) -> float:
        """Return the standard deviation of a coordinate by accumulated white noise, m."""
        lever = (1.0 + self.bounds.scale) * self.walk_th_rad * min(self.reach_m, self.speed_mps * t)
        return math.sqrt(t) * math.hypot(self.walk_p_m, lever)


def bounds_of(source: PoseSource, reach_m: float, speed_mps: float) -> OutageBounds:
    """Return the bounds of a source; ``key_frames`` are bounded as dead reckoning is, since images may fail."""
    v = source.velocity
    stated = source.bounds or ErrorBounds(
        scale=min(_DRAWN_WITHIN * v.scale, 0.99),
        gyro_bias_radps=_DRAWN_WITHIN * v.gyro_bias_radps,
        position_m=5.0 * source.fixes.position_noise_m,
        heading_rad=5.0 * source.fixes.heading_noise_rad,
    )
    return OutageBounds(stated, v.position_walk_m, v.heading_walk_rad, reach_m, speed_mps)


def upper_level(radius_m: float, error_m: float) -> float:
    """Return ``V_hi = (R - e)^2 / 2``, m^2, which the estimate's error must not pass; 0 if e leaves nothing."""
    return 0.5 * max(radius_m - error_m, 0.0) ** 2


def _checked(outage_s: float) -> float:
    if not (outage_s >= 0.0 and math.isfinite(outage_s)):
        raise CertificateError(f"outage_s = {outage_s}: a finite length of at least 0 s was expected")
    return outage_s
