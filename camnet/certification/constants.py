r"""Constants of the Lyapunov analysis, as published and repaired (harris2020, sections 3.2 and 4.3.2).

| symbol | name | unit | equation |
| --- | --- | --- | --- |
| k | ``k`` | 1/s | gain of the pose estimator, k1 in (3-8), k2 in (4-16) |
| k_CL | ``kcl`` | - | (3-10), (4-18) |
| lambda(Gamma^-1) | ``gamma_inv_min``, ``gamma_inv_max`` | - | below (3-20) |
| alpha, Dt, N | ``alpha``, ``window_s``, ``stack_size`` | -, s, - | (3-10) |
| eps_bar, etadot_max | ``eps_bar``, ``etadot_max`` | 1/s | (3-2), below (3-20) |
| sup norm(sigma), W_bar | ``sigma_bar``, ``weight_bound`` | -, 1/s | used by ``sound`` only |
| lambda_min(Psi) | ``lambda_min_psi`` | s^2 or - | (3-19) |
| c1, c2, c3, beta_1, lambda_D, lambda_DT, lambda_G, c_UB | ``Constants`` | | (3-22) to (3-30) |

The repaired constants rest on these assumptions, which are also listed in ``SOUND_ASSUMPTIONS``: the ideal and the
estimated weights stay in the Frobenius ball of radius W_bar (the outer radius of the smooth projection), and
Gamma is a multiple of the identity where the projection is Euclidean.

The continuous law with exact measurements is the textbook case. With ``sampling`` the constants are those of the
estimator as it runs (``sampled``): noise, leakage, sensing period, unit quaternions.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass

from camnet.certification.sampled import Sampling, one_step
from camnet.errors import CertificateError

__all__ = [
    "SOUND_ASSUMPTIONS",
    "Constants",
    "EstimatorBounds",
    "lattice_sigma_bar",
    "lattice_slope",
    "published",
    "sound",
    "switching_residue",
]

#: max over x of x (1 - tanh x): what the tanh form of the switching term leaves of each component
_TANH_RESIDUE = 0.2784645427610738
_RESIDUE = {"sign": 0.0, "sat": 0.25, "tanh": _TANH_RESIDUE}

SOUND_ASSUMPTIONS: tuple[str, ...] = (
    "the target's motion is a function of its place: etadot = W^T sigma + eps, |eps| <= eps_bar, and |W|_F is within "
    "the projection's inner radius (estimator.weight_bound); it turns about one axis",
    "the projection keeps the estimated weights in |W_hat|_F <= W_bar, its outer radius, and does not lengthen the "
    "error (Gamma a multiple of the identity)",
    "|sigma| <= sigma_bar everywhere; every window of the history stack is at most Dt long and was measured in view",
    "errors of measured poses stay within the stated bounds; while seen, a pose is measured every sensing period; "
    "camera poses are known",
    "excited cases: lambda_min of the whole stack is at least the threshold for as long as they are used",
    "one estimator for each target; nothing but the law moves the weights",
)


@dataclass(frozen=True, slots=True)
class EstimatorBounds:
    """Gains of the estimator and the bounds that its proof assumes.

    Parameters
    ----------
    k : linear gain of the pose estimator, 1/s
    kcl : gain of concurrent learning
    gamma_inv_min, gamma_inv_max : extreme eigenvalues of the inverse adaptation gain
    alpha : share of integral windows in the history stack, in [0, 1]
    window_s : integration window Dt, s
    stack_size : number of entries N
    eps_bar : bound of the motion model's residual
    etadot_max : bound of the norm of the target's pose rate (``published`` takes it for the weights' bound too)
    sigma_bar : supremum of the norm of the basis
    weight_bound : radius of the ball that holds the ideal and the estimated weights (Frobenius norm)
    lambda_min_psi : smallest eigenvalue of the history stack once excitation holds
    switching_floor : what the switching term leaves undone, see ``switching_residue``
    sampling : how the estimator is sampled and disturbed (``sound``); None: continuous, with exact measurements
    """

    k: float
    kcl: float
    gamma_inv_min: float
    gamma_inv_max: float
    alpha: float
    window_s: float
    stack_size: int
    eps_bar: float
    etadot_max: float
    sigma_bar: float
    weight_bound: float
    lambda_min_psi: float
    switching_floor: float = 0.0
    sampling: Sampling | None = None

    def __post_init__(self) -> None:
        _check_positive(
            self,
            "k kcl gamma_inv_min gamma_inv_max window_s stack_size etadot_max sigma_bar weight_bound lambda_min_psi",
        )
        for name in ("eps_bar", "switching_floor"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0.0):
                raise CertificateError(f"{name} = {value!r}: a finite number >= 0 is needed")
        if not 0.0 <= self.alpha <= 1.0:
            raise CertificateError(f"alpha = {self.alpha!r}: a number in [0, 1] is needed")
        if self.gamma_inv_min > self.gamma_inv_max:
            raise CertificateError(
                f"gamma_inv_min = {self.gamma_inv_min!r} exceeds gamma_inv_max = {self.gamma_inv_max!r}: "
                "give the smallest eigenvalue first"
            )
        if self.sampling is not None and self.gamma_inv_min != self.gamma_inv_max:
            raise CertificateError(
                f"gamma_inv_min = {self.gamma_inv_min!r}, gamma_inv_max = {self.gamma_inv_max!r}: the sampled law is "
                "analysed for Gamma = gamma I, both must be equal"
            )


def _check_positive(bounds: EstimatorBounds, names: str) -> None:
    for name in names.split():
        value = getattr(bounds, name)
        if not (math.isfinite(value) and value > 0.0):
            raise CertificateError(f"{name} = {value!r}: a finite number > 0 is needed")


@dataclass(frozen=True, slots=True)
class Constants:
    """Constants of one certificate.

    Between switches the Lyapunov value obeys V' <= -lambda_d V + lambda_d beta1 (seen, not yet excited),
    V' <= -lambda_dt V + lambda_dt c_ub (seen, excited) and V' <= lambda_g V + c3 (unseen).
    ``growth_offset`` is c3 / lambda_g where the certificate keeps c3 while unseen, and 0 where it drops it.

    Of a sampled estimator these hold at the times of measurements; ``lag_s`` is how much later than the last one the
    loss of view is noticed, ``reset_rise`` what restarting the pose at a measurement adds to V. While unseen then also
    V' <= norm(eta_til) ``off_speed`` + ``off_source``. ``refusal`` says why there are no constants.
    """

    certificate: str
    mobile: bool
    gamma1: float
    gamma2: float
    c1: float
    c2: float
    c3: float
    beta1: float
    c_ub: float
    lambda_d: float
    lambda_cl: float
    lambda_dt: float
    lambda_g: float
    growth_offset: float
    lag_s: float = 0.0
    reset_rise: float = 0.0
    off_speed: float | None = None
    off_source: float = 0.0
    refusal: str = ""

    def as_dict(self) -> dict[str, float | str | bool | None]:
        """Return the constants as plain data, for JSON; what is not finite becomes None."""
        return {
            name: None if isinstance(value, float) and not math.isfinite(value) else value
            for name, value in asdict(self).items()
        }


def published(bounds: EstimatorBounds, *, mobile: bool = False) -> Constants:
    """Return the constants of harris2020 to the letter, (3-22)-(3-30) or, ``mobile``, (4-28)-(4-30)."""
    b = bounds
    c1 = (
        2.0 * b.kcl * b.stack_size * b.etadot_max * b.eps_bar * (b.alpha * b.window_s + 1.0 - b.alpha)
    )  # (3-22)
    c2 = 2.0 * b.gamma_inv_max * b.etadot_max**2  # below (3-20)
    factor = 6.0 if mobile else 4.0
    c3 = 0.5 * (factor * b.etadot_max + b.eps_bar) ** 2 + c1  # (3-28), (4-28)
    return _assemble("published", b, mobile, c1, c2, c3, keep_c3=False)


def sound(bounds: EstimatorBounds, *, mobile: bool = False) -> Constants:
    """Return the repaired constants; with ``bounds.sampling`` those of the estimator as it runs.

    The bounds of the stack use sup |sigma| and the projection radius: |Y_i| <= Dt sigma_bar, |E_i| <= Dt eps_bar
    and |W_til| <= 2 W_bar. The mobile case needs no larger c3: the known part f of the relative kinematics is
    affine in the state with a skew linear part, so that eta_til^T f_til = 0.
    """
    b = bounds
    if b.sampling is not None:
        return _sampled(b, b.sampling, mobile)
    stack = b.alpha * b.window_s**2 + 1.0 - b.alpha
    c1 = 2.0 * b.kcl * b.stack_size * b.weight_bound * b.sigma_bar * b.eps_bar * stack  # (3-22) repaired
    c2 = 2.0 * b.gamma_inv_max * b.weight_bound**2  # below (3-20), |W_til| <= 2 W_bar
    c3 = 0.5 * (4.0 * b.weight_bound * b.sigma_bar + b.eps_bar) ** 2 + c1  # (3-28) repaired
    return _assemble("sound", b, mobile, c1 + b.switching_floor, c2, c3, keep_c3=True)


def _assemble(
    certificate: str, b: EstimatorBounds, mobile: bool, c1: float, c2: float, c3: float, *, keep_c3: bool
) -> Constants:
    """Join the shared definitions; ``c1`` holds what the switching term leaves."""
    gamma1 = min(1.0, b.gamma_inv_min)  # below (3-20)
    gamma2 = max(1.0, b.gamma_inv_max)
    lambda_cl = b.kcl * b.lambda_min_psi  # below (3-25)
    slowest = min(b.k, lambda_cl)
    lambda_g = 1.0 / gamma1  # (3-30)
    return Constants(
        certificate=certificate,
        mobile=mobile,
        gamma1=gamma1,
        gamma2=gamma2,
        c1=c1,
        c2=c2,
        c3=c3,
        beta1=c1 / (2.0 * b.k) + c2,  # (3-24)
        c_ub=c1 * gamma2 / (2.0 * slowest),  # (3-27)
        lambda_d=2.0 * b.k,  # (3-24)
        lambda_cl=lambda_cl,
        lambda_dt=2.0 * slowest / gamma2,  # (3-26)
        lambda_g=lambda_g,
        growth_offset=c3 / lambda_g if keep_c3 else 0.0,
    )


def _sampled(b: EstimatorBounds, sampling: Sampling, mobile: bool) -> Constants:
    """Write the sampled law's contraction per step as rates and floors; ``c1`` is the rest per second."""
    step = one_step(
        sampling,
        k=b.k,
        kcl=b.kcl,
        gamma=1.0 / b.gamma_inv_max,
        alpha=b.alpha,
        window_s=b.window_s,
        stack_size=b.stack_size,
        eps_bar=b.eps_bar,
        sigma_bar=b.sigma_bar,
        weight_bound=b.weight_bound,
        excitation=b.lambda_min_psi,
    )
    t, c2 = sampling.period_s, 2.0 * b.gamma_inv_max * b.weight_bound**2
    gamma1 = min(1.0, b.gamma_inv_min)
    c3 = 0.5 * step.speed**2 + step.off  # (3-28): 2 W_bar sigma_bar + eps_bar is enough
    return Constants(
        certificate="sound",
        mobile=mobile,
        gamma1=gamma1,
        gamma2=max(1.0, b.gamma_inv_max),
        c1=step.rest / t,
        c2=c2,
        c3=c3,
        beta1=c2 + _floor(step.rest, step.a),
        c_ub=_floor(step.rest_excited, step.a_excited),
        lambda_d=math.log1p(step.a) / t,
        lambda_cl=b.kcl * b.lambda_min_psi,
        lambda_dt=math.log1p(step.a_excited) / t,
        lambda_g=1.0 / gamma1,
        growth_offset=c3 * gamma1,
        lag_s=t,
        reset_rise=step.reset_rise,
        off_speed=step.speed,
        off_source=step.off,
        refusal=step.refusal,
    )


def _floor(rest: float, a: float) -> float:
    return rest / a if a > 0.0 else math.inf


def switching_residue(
    kind: str, switching_gain: float, boundary_layer: float, eps_bar: float, states: int = 7
) -> float:
    """Return the part of eta_til^T eps that a softened switching term does not dominate.

    With |eps_i| <= e_i and a gain K >= eps_bar, each component leaves at most e_i x (1 - s(x / delta)), whose maximum
    is 0 (sign), delta e_i / 4 (saturation) or 0.2785 delta e_i (tanh); the sum of e_i is at most sqrt(states) eps_bar.

    Parameters
    ----------
    kind : ``sign``, ``sat`` or ``tanh``
    switching_gain : K, k2 in (3-8) or k3 in (4-16)
    boundary_layer : delta
    eps_bar : bound of the residual
    states : number of components of the pose error

    Raises
    ------
    CertificateError
        if the gain does not exceed ``eps_bar`` or ``kind`` is unknown.
    """
    if kind not in _RESIDUE:
        raise CertificateError(f"switching = {kind!r}: one of {sorted(_RESIDUE)} is needed")
    if switching_gain < eps_bar:
        raise CertificateError(
            f"switching gain = {switching_gain!r} does not exceed eps_bar = {eps_bar!r}, as (3-22) requires"
        )
    return _RESIDUE[kind] * boundary_layer * math.sqrt(states) * eps_bar


def lattice_sigma_bar(spacing_m: float, width_m: float, dimensions: int = 2) -> float:
    """Return the supremum of |sigma| for Gaussian kernels of one width on an infinite square lattice.

    |sigma(x)|^2 is a product of one-dimensional sums of exp(-(x - n s)^2 / w^2). By Poisson's formula their Fourier
    coefficients are positive, so the largest value is at a lattice point. A finite part of a lattice stays below.
    """
    if not (spacing_m > 0.0 and width_m > 0.0):
        raise CertificateError(f"spacing_m = {spacing_m!r}, width_m = {width_m!r}: both must be > 0")
    terms = math.ceil(7.0 * width_m / spacing_m) + 1  # exp(-49) is below rounding
    line = 1.0 + 2.0 * math.fsum(math.exp(-((n * spacing_m / width_m) ** 2)) for n in range(1, terms + 1))
    return math.pow(line, dimensions / 2.0)


def lattice_slope(spacing_m: float, width_m: float) -> float:
    """Bound the Lipschitz constant of sigma on an infinite square lattice in the plane, 1/m.

    |D sigma v|^2 <= sum (|u_k|/w)^2 exp(-|u_k|^2/w^2) / w^2 with (a^2) exp(-a^2) <= (2/e) exp(-a^2/2): a lattice sum
    of kernels that are sqrt(2) as wide.
    """
    return math.sqrt(2.0 / math.e) * lattice_sigma_bar(spacing_m, math.sqrt(2.0) * width_m) / width_m
