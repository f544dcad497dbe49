r"""How long a moving target may be out of view of a camera that moves by measured velocities (bell2019, ch. 5): sound.

The paper's theorems cannot be used (`bell_dwell`): their constants hold a rate c1 >= 2 and a floor c4/c3 far above any
level. Here every inequality is that of the predictor itself, in scene axes. With z the target's position, v its
velocity, p = R^T (z - c) what the camera sees of it, and the same with hats for what is predicted,

| error | grows by | why |
| --- | --- | --- |
| ``e_z = |z - z^|`` | ``e_z' <= e_v`` | |
| ``e_v = |v - v^|`` | ``e_v' <= L e_z + mu e_v + delta`` | acceleration model, |W~| s + eps <= delta |
| or | ``e_z' <= mu e_z + delta_v`` | velocity field, ``v = f(z)`` within delta_v |
| | ``e_z <= e_z(0) + (v_max + v^_max) t`` | whatever the model does |
| ``e_r`` | ``e_r' <= dv + dw d + v_max dw t`` | the camera's own motion |
| ``e_p = |p - p^|`` | ``e_p <= e_z + e_r`` | |

The scene's axes are those in which the camera believes to be when the target leaves: what its belief is off by then is
part of the model's error. The last term of e_r': what moves in the scene is rotated into the camera's axes by a
heading that is off by up to ``dw t``. For e_r take ``g = R^^T (z - c^)``, the true target seen from where the camera
believes to be:
``(p - g)' = -w^ x (p - g) - (w - w^) x p - (v_c - v^_c) + (R - R^)^T v``, and |p - g| is at most e_r while |p| <= d.

The target is not lost while ``e_p + extent`` fits the ball ``R = d sin(psi) / (1 + sin(psi))`` that touches the far end
of the view and its sides; the printed ``d sin(psi)`` about the far end leaves the view.

| symbol | name | unit |
| --- | --- | --- |
| e_z(0), e_v(0) | ``position_m``, ``velocity_mps`` | m, m/s |
| L, mu, delta | ``slope``, ``damping``, ``drive`` | 1/s^2, 1/s, m/s^2; of a field the last two: 1/s, m/s |
| dv, dw | ``speed_error_mps``, ``rate_error_radps`` | m/s, rad/s |
| d, psi | ``range_m``, ``half_angle_rad`` | m, rad |
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm

from camnet.certification.dwell import DwellTime
from camnet.errors import CertificateError

__all__ = ["TargetErrors", "inscribed_radius", "target_off_max_learned", "target_off_max_sound"]

#: times are found to so many seconds, and none is stated beyond the longest
_STEP_S, _LONGEST_S = 1e-3, 3600.0


def inscribed_radius(range_m: float, half_angle_rad: float) -> float:
    """Return the radius of the largest ball in a view's cone that reaches ``range_m`` deep, m.

    Raises
    ------
    CertificateError
        If the range is not above zero or the half-angle not within (0, pi/2).
    """
    if not (math.isfinite(range_m) and range_m > 0.0):
        raise CertificateError(f"range_m = {range_m!r}: a finite number > 0 is needed")
    if not 0.0 < half_angle_rad < 0.5 * math.pi:
        raise CertificateError(f"half_angle_rad = {half_angle_rad!r}: an angle in (0, pi/2) is needed")
    s = math.sin(half_angle_rad)
    return range_m * s / (1.0 + s)


@dataclass(frozen=True, slots=True)
class TargetErrors:
    """Bounds of what is wrong when the target leaves the view, and of what grows; see the module's table.

    ``slope`` None: the model is a velocity field. ``speed_bound_mps``: v_max of the target and of its prediction.
    """

    position_m: float
    velocity_mps: float
    slope: float | None
    damping: float
    drive: float
    speed_bound_mps: float
    speed_error_mps: float
    rate_error_radps: float
    range_m: float

    def __post_init__(self) -> None:
        """Refuse what is not finite, or negative."""
        for name in self.__slots__:
            value = getattr(self, name)
            if name == "slope" and value is None:
                continue
            if not (math.isfinite(value) and value >= 0.0):
                raise CertificateError(f"{name} = {value!r}: a finite number >= 0 is needed")

    def scene_error(self, t_s: float) -> float:
        """Return the bound of e_z after ``t_s`` out of view, m."""
        if self.slope is None:
            a = np.array([[self.damping, self.drive], [0.0, 0.0]])
            start = np.array([self.position_m, 1.0])
        else:
            a = np.array([[0.0, 1.0, 0.0], [self.slope, self.damping, self.drive], [0.0, 0.0, 0.0]])
            start = np.array([self.position_m, self.velocity_mps, 1.0])
        farthest = self.position_m + 2.0 * self.speed_bound_mps * t_s
        if np.linalg.norm(a, ord=1) * t_s > 500.0:  # the exponential would overflow
            return farthest
        return min(farthest, float((expm(t_s * a) @ start)[0]))

    def camera_error(self, t_s: float) -> float:
        """Return the bound of e_r after ``t_s`` out of view, m."""
        steady = self.speed_error_mps + self.rate_error_radps * self.range_m
        swept = 0.5 * self.rate_error_radps * t_s**2
        return steady * t_s + self.speed_bound_mps * min(2.0 * t_s, swept)

    def after(self, t_s: float) -> float:
        """Return the bound of e_p after ``t_s`` out of view, m."""
        return self.scene_error(t_s) + self.camera_error(t_s)


def target_off_max_sound(errors: TargetErrors, margin_m: float) -> DwellTime:
    """Return how long the target may stay unseen, so that ``e_p`` stays within ``margin_m``; sound.

    Parameters
    ----------
    errors : bounds when it leaves the view
    margin_m : radius of the view's ball less the target's extent, m

    Raises
    ------
    CertificateError
        If the margin is not finite.
    """
    equation = "bell2019 ch. 5, out of view, by the predictor's own inequalities"
    if not math.isfinite(margin_m):
        raise CertificateError(f"margin_m = {margin_m!r}: a finite number is needed")
    if errors.after(0.0) >= margin_m:
        reason = f"the error when the target leaves, {errors.after(0.0):.4g} m, is not below {margin_m:.4g} m"
        return DwellTime(None, equation, reason)
    if errors.after(_LONGEST_S) < margin_m:
        return DwellTime(_LONGEST_S, equation)
    low, high = 0.0, _LONGEST_S
    while high - low > _STEP_S:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if errors.after(middle) < margin_m else (low, middle)
    return DwellTime(low, equation)


def target_off_max_learned(
    kept_s: Sequence[float], share: float = 0.95, confidence: float = 0.95
) -> DwellTime:
    """Return how long the target may stay unseen, by independent stretches; holds for a share of cases.

    The shortest of n times bounds a ``share`` of all cases with confidence ``1 - share^n`` (Wilks 1941).

    Parameters
    ----------
    kept_s : for how long the target stayed within the margin, s
    share, confidence : in (0, 1)

    Raises
    ------
    CertificateError
        If a number is out of its range.
    """
    equation = "measured time within the view's ball"
    for name, value in (("share", share), ("confidence", confidence)):
        if not 0.0 < value < 1.0:
            raise CertificateError(f"{name} = {value!r}: a number in (0, 1) is needed")
    for value in kept_s:
        if not (math.isfinite(value) and value >= 0.0):
            raise CertificateError(f"kept_s holds {value!r}: finite numbers >= 0 are needed")
    needed = math.ceil(math.log(1.0 - confidence) / math.log(share))
    if len(kept_s) < needed:
        return DwellTime(None, equation, f"{len(kept_s)} stretches are too few; {needed} are needed")
    return DwellTime(min(kept_s), equation)
