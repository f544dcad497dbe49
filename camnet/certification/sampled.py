r"""The repaired inequalities of the estimator as it runs: sampled, with noisy poses, leakage and unit quaternions.

| symbol | name | unit | meaning |
| --- | --- | --- | --- |
| T | ``period_s`` | s | sensing period; V is looked at when poses are measured |
| n_p, n_q | ``position_noise_m``, ``quaternion_noise`` | m, - | bounds of norm(p_meas - p), norm(q_meas - q) |
| n | ``noise`` | | sqrt(n_p^2 + n_q^2) |
| L | ``slope`` | 1/m | sup of the Lipschitz constant of sigma |
| delta | ``leakage`` | s^2 | draws the weights to zero |
| k_s | ``switching_gain`` | 1/s | gain of the switching term |
| v | ``speed`` | 1/s | W_bar sigma_bar + eps_bar |
| s | ``share`` | - | 1 - exp(-k T) |

One step changes V by at most -A |e|^2 + B |e| + C, e the error before the feedback, and by the share that the stack
takes of the weights' error (docs/theory.md, section 3, "As it runs"). No term needs the switching to dominate anything.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from camnet.errors import CertificateError

__all__ = ["Sampling", "Step", "one_step", "orientation_share", "window_error"]

#: shares of A and of the square that are tried for what the square is completed with
_SHARES = tuple(0.02 * 1.25**j for j in range(17))
#: share of the excited stack that pays for its own residual
_STACK_SHARE = 0.5


@dataclass(frozen=True, slots=True)
class Sampling:
    """How the estimator is sampled and what disturbs it.

    Parameters
    ----------
    period_s : sensing period T
    slope : Lipschitz constant of the basis, 1/m
    position_noise_m : bound of a measured position's error
    orientation_noise_rad : bound of a measured orientation's error, as an angle
    leakage : of the weight law, s^2
    switching_gain : k_s
    average : poses averaged at each end of a window
    rate_error : bound of a regressed rate's error, 1/s; needed for alpha < 1 only
    """

    period_s: float
    slope: float
    position_noise_m: float = 0.0
    orientation_noise_rad: float = 0.0
    leakage: float = 0.0
    switching_gain: float = 0.0
    average: int = 1
    rate_error: float = 0.0

    def __post_init__(self) -> None:
        for name in ("period_s", "slope", "average"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise CertificateError(f"{name} = {value!r}: a finite number > 0 is needed")
        for name in (
            "position_noise_m", "orientation_noise_rad", "leakage", "switching_gain", "rate_error",
        ):  # fmt: skip
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0.0):
                raise CertificateError(f"{name} = {value!r}: a finite number >= 0 is needed")

    @property
    def quaternion_noise(self) -> float:
        """n_q: chord between unit quaternions that are this angle apart."""
        return 2.0 * math.sin(0.25 * min(self.orientation_noise_rad, 2.0 * math.pi))

    @property
    def noise(self) -> float:
        """Bound of the whole pose's error."""
        return math.hypot(self.position_noise_m, self.quaternion_noise)


@dataclass(frozen=True, slots=True)
class Step:
    """What one sensing period does to V.

    Seen:   V+ (1 + a) <= V + a c2 + rest, and with excitation V+ (1 + a_excited) <= V + rest_excited.
    Unseen: V' <= norm(eta_til) speed + off.  ``refusal`` says why there is no such inequality (else empty).
    """

    a: float
    rest: float
    a_excited: float
    rest_excited: float
    off: float
    speed: float
    reset_rise: float
    refusal: str = ""


def window_error(s: Sampling, *, window_s: float, weight_bound: float, eps_bar: float, speed: float) -> float:
    """Bound norm(Deta_i - Y_i W): residual, noise of the ends, and the trapezoid rule on noisy places."""
    inside = eps_bar + weight_bound * s.slope * (s.position_noise_m + 0.5 * speed * s.period_s)
    spread = min(speed * s.period_s * (s.average - 1), 1.5)
    turn = min(speed * window_s + 2.0 * s.orientation_noise_rad, 3.0)
    stretch = 0.5 * turn / math.sin(0.5 * turn) if turn > 1e-9 else 1.0  # of log about a rotation
    angle = 2.0 * stretch * s.orientation_noise_rad / math.cos(0.5 * spread) + 0.1 * spread**3
    return window_s * inside + math.hypot(2.0 * s.position_noise_m, angle)


def orientation_share(share: float, cosine: float) -> float:
    """Return what a step of feedback leaves of norm(q_til)^2 where q^T q_hat >= ``cosine`` >= 0.

    The estimate moves along the chord and is normalised: 1 - c+ <= (1 - s)(1 - c)(1 - s (s + (1 - s) c)). For small
    steps that is the rate 2 k cos^2(theta / 4) in place of 2 k.
    """
    return (1.0 - share) * (1.0 - share * (share + (1.0 - share) * cosine))


@dataclass(frozen=True, slots=True)
class _Feedback:
    """Of one step: ``kept`` of norm(e)^2, ``push`` p by noise and switching, ``extra`` of the position's switching."""

    kept: float
    push: float
    extra: float


def _feedback(s: Sampling, share: float, cosine: float) -> _Feedback:
    radius = math.sqrt(1.0 - 2.0 * share * (1.0 - share) * (1.0 - cosine))
    moved = share * s.quaternion_noise + 2.0 * s.period_s * s.switching_gain
    turned = moved / (radius - moved) if moved < radius else math.inf
    extra = s.period_s * s.switching_gain * math.sqrt(3.0) * s.position_noise_m
    extra += 1.5 * (s.period_s * s.switching_gain) ** 2
    push = math.hypot(share * s.position_noise_m, turned)
    return _Feedback(orientation_share(share, cosine), push, extra)


def _largest_angle(s: Sampling, share: float, driven: float) -> float:
    """Cosine of half the largest orientation error in view, or -1 where it may pass 180 degrees.

    The chord obeys X+ <= sqrt(kept) (X + driven) + push, and starts at the noise of the pose that restarts it.
    """
    cosine = 0.0
    for _ in range(3):
        f = _feedback(s, share, cosine)
        chord = (math.sqrt(f.kept) * driven + f.push) / (1.0 - math.sqrt(f.kept)) + driven
        found = 1.0 - 0.5 * chord**2
        if not found > s.quaternion_noise:
            return -1.0
        cosine = found
    return cosine


def one_step(
    s: Sampling,
    *,
    k: float,
    kcl: float,
    gamma: float,
    alpha: float,
    window_s: float,
    stack_size: int,
    eps_bar: float,
    sigma_bar: float,
    weight_bound: float,
    excitation: float,
) -> Step:
    """Return the constants of one step; symbols as in ``EstimatorBounds``, Gamma = gamma I."""
    t, n = s.period_s, s.noise
    share = -math.expm1(-k * t)
    reach = weight_bound * sigma_bar
    speed = reach + eps_bar
    # residual of the model at the measured place, and what Euler's rule and the unit quaternion leave
    d = eps_bar + weight_bound * s.slope * (s.position_noise_m + speed * t)
    d += t * (0.25 * speed**2 + 0.625 * reach**2)
    cosine = _largest_angle(s, share, t * (reach + d))
    if cosine < 0.0:
        return _none(
            f"estimator.k1_per_s = {k:g} at {1.0 / t:g} Hz: the orientation error may pass 180 degrees while seen"
        )
    f = _feedback(s, share, cosine)
    big_a = 0.5 * (1.0 - f.kept) - 0.25 * (t * speed) ** 2 - t * t * gamma * sigma_bar**2
    if not big_a > 0.0:
        return _none(
            f"sensing.rate_hz = {1.0 / t:g} is too slow for estimator.gamma = {gamma:g} and "
            f"estimator.k1_per_s = {k:g}: one step may lengthen the error"
        )
    big_b = f.push + t * d
    window = window_error(s, window_s=window_s, weight_bound=weight_bound, eps_bar=eps_bar, speed=speed)
    stack = stack_size * (alpha * window**2 + (1.0 - alpha) * (eps_bar + s.rate_error) ** 2)
    leak = 0.25 * kcl * s.leakage * weight_bound**2
    big_c = 0.25 * t**4 * speed**2 * (2.0 * reach + d) ** 2 + t * t * gamma * sigma_bar**2 * n * n
    big_c += 2.0 * t * reach * n + 0.5 * f.push**2 + f.extra + t * leak
    rise = 0.5 * n * n
    off = 0.25 * kcl * stack + leak
    a, rest = min(
        (_completed(big_a, big_b, big_c + 0.25 * t * kcl * stack, f, x, y) for x in _SHARES for y in _SHARES),
        key=lambda pair: pair[1] / pair[0],
    )
    learning = 2.0 * t * gamma * kcl * (1.0 - _STACK_SHARE) * excitation
    noisy = big_c + 0.25 * t * kcl * stack / _STACK_SHARE
    a_s, rest_s = min(
        (_completed(big_a, big_b, noisy, f, x, y) for x in _SHARES for y in _SHARES),
        key=lambda pair: pair[1] / min(pair[0], learning),
    )
    return Step(a, rest, min(a_s, learning), rest_s, off, 2.0 * reach + eps_bar, rise)


def _completed(
    big_a: float, big_b: float, big_c: float, f: _Feedback, theta: float, phi: float
) -> tuple[float, float]:
    """Complete both squares: B |e| <= theta A |e|^2 + B^2 / (4 theta A), and |e|^2 against |eta_til+|^2."""
    left = (1.0 - theta) * big_a
    rest = big_c + big_b**2 / (4.0 * theta * big_a) + left * (2.0 * f.extra / (1.0 + phi) + f.push**2 / phi)
    return 2.0 * left / (1.0 + phi), rest


def _none(refusal: str) -> Step:
    return Step(0.0, math.inf, 0.0, math.inf, math.inf, math.inf, math.inf, refusal)
