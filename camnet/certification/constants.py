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
| s | ``unexcited_norm`` | - | sup norm((I - P) sigma) at the places visited; 0: the whole stack is excited |
| c1, c2, c3, beta_1, lambda_D, lambda_DT, lambda_G, c_UB | ``Constants`` | | (3-22) to (3-30) |

The repaired constants rest on these assumptions, which are also listed in ``SOUND_ASSUMPTIONS``: the ideal and the
estimated weights stay in the Frobenius ball of radius W_bar (the outer radius of the smooth projection), and
Gamma is a multiple of the identity where the projection is Euclidean.

A target that keeps to roads excites a part P of the weights only. The excited rates then hold for V_P, which counts
P W_til in place of W_til, with 2 W_bar s added to the residual's speed (docs/theory.md, section 3).
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass

from camnet.errors import CertificateError

__all__ = [
    "SOUND_ASSUMPTIONS",
    "Constants",
    "EstimatorBounds",
    "lattice_sigma_bar",
    "published",
    "residue_per_speed",
    "sound",
    "switching_residue",
]

#: max over x of x (1 - tanh x): what the tanh form of the switching term leaves of each component
_TANH_RESIDUE = 0.2784645427610738
_RESIDUE = {"sign": 0.0, "sat": 0.25, "tanh": _TANH_RESIDUE}

SOUND_ASSUMPTIONS: tuple[str, ...] = (
    "the target's motion is a function of its pose: etadot = W^T sigma + eps, |eps| <= eps_bar, |W|_F <= W_bar",
    "the projection keeps the estimated weights in |W_hat|_F <= W_bar and does not lengthen the error "
    "(Gamma a multiple of the identity, convex bounds on the state)",
    "|sigma| <= sigma_bar everywhere; every window of the history stack is at most Dt long and was measured",
    "measurements are exact and continuous while the target is seen; camera poses are known",
    "the switching gain exceeds eps_bar",
    "excited cases, where only a part of the weights is excited: regressors lie in that part up to s, the stack keeps "
    "it, and the projection is not at work",
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
    unexcited_norm : s, bound of the basis outside the excited part of the weights; 0 where (3-19) holds in full
    switching_gain : gain of the switching term, for what it dominates beyond ``eps_bar``; None: just ``eps_bar``
    floor_per_speed : ``residue_per_speed`` of the switching term, for the part that ``unexcited_norm`` adds
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
    unexcited_norm: float = 0.0
    switching_gain: float | None = None
    floor_per_speed: float = 0.0

    def __post_init__(self) -> None:
        _check_positive(
            self,
            "k kcl gamma_inv_min gamma_inv_max window_s stack_size etadot_max sigma_bar weight_bound lambda_min_psi",
        )
        for name in ("eps_bar", "switching_floor", "unexcited_norm", "floor_per_speed"):
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

    @property
    def unexcited_speed(self) -> float:
        """Bound of |W_til^T (I - P) sigma|, 1/s: what the unexcited weights add to the residual."""
        return 2.0 * self.weight_bound * self.unexcited_norm

    @property
    def undominated_speed(self) -> float:
        """Part of it that the switching term does not dominate, 1/s."""
        gain = self.eps_bar if self.switching_gain is None else self.switching_gain
        return max(0.0, self.eps_bar + self.unexcited_speed - gain) if self.unexcited_norm > 0.0 else 0.0


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

    def as_dict(self) -> dict[str, float | str | bool]:
        """Return the constants as plain data, for JSON."""
        return asdict(self)


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
    """Return the repaired constants.

    The bounds of the stack use sup |sigma| and the projection radius: |Y_i| <= Dt sigma_bar, |E_i| <= Dt eps_bar
    and |W_til| <= 2 W_bar. The mobile case needs no larger c3: the known part f of the relative kinematics is
    affine in the state with a skew linear part, so that eta_til^T f_til = 0.
    """
    b = bounds
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
    c1_excited, k_excited = _excited_part(b, c1) if keep_c3 else (c1, b.k)
    slowest = min(k_excited, lambda_cl)
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
        c_ub=c1_excited * gamma2 / (2.0 * slowest),  # (3-27)
        lambda_d=2.0 * b.k,  # (3-24)
        lambda_cl=lambda_cl,
        lambda_dt=2.0 * slowest / gamma2,  # (3-26)
        lambda_g=lambda_g,
        growth_offset=c3 / lambda_g if keep_c3 else 0.0,
    )


def _excited_part(b: EstimatorBounds, c1: float) -> tuple[float, float]:
    """Return c1 and k of the excited case where the unexcited weights act as a disturbance.

    With d = eps_bar + 2 W_bar s - K > 0 left by the switching term, d |eta_til| <= k/2 |eta_til|^2 + d^2 / (2 k).
    """
    more = b.floor_per_speed * b.unexcited_speed
    left = b.undominated_speed
    if left == 0.0:
        return c1 + more, b.k
    return c1 + more + left**2 / (2.0 * b.k), 0.5 * b.k


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
    return residue_per_speed(kind, boundary_layer, states) * eps_bar


def residue_per_speed(kind: str, boundary_layer: float, states: int = 7) -> float:
    """Return what a softened switching term leaves of eta_til^T d for each unit of |d|, m."""
    return _RESIDUE[kind] * boundary_layer * math.sqrt(states)


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
