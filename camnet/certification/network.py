"""One dwell-time report for one network: constants, dwell times and the verdict of Theorem 3.1, published and sound.

| symbol | name | unit | equation |
| --- | --- | --- | --- |
| R = d sin(psi) less the target's extent | ``working_radius`` | m | bell2019, Figure 5-1 |
| V_hi = R^2 / 2 | ``default_levels`` | m^2 | Lemma 3.3, Remark 4.3 |
| V_lo | ``default_levels`` | m^2 | Lemma 3.4, Remark 4.4 |
| norm(etadot) | ``pose_rate_bound`` | 1/s | (3-1): sqrt(v^2 + w^2/4), as norm(B w) = norm(w) |
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from camnet.certification.constants import (
    SOUND_ASSUMPTIONS,
    Constants,
    EstimatorBounds,
    lattice_sigma_bar,
    published,
    sound,
    switching_residue,
)
from camnet.certification.dwell import DwellBounds, DwellTime
from camnet.certification.sampled import Sampling
from camnet.certification.settings import CertificateSettings
from camnet.certification.verdict import Theorem31, occlusion_verdict, theorem_31
from camnet.errors import CertificateError

__all__ = [
    "DwellCertificates",
    "NetworkGap",
    "certify_dwell",
    "default_levels",
    "dwell_report",
    "estimator_bounds",
    "pose_rate_bound",
    "working_radius",
]

#: a time in view that stands for "as long as one likes" in the reports, s
_LONG_S = 1e6


@dataclass(frozen=True, slots=True)
class NetworkGap:
    """A gap between two fields of view (or regions) that the target may have to cross.

    Attributes
    ----------
    source, target : names of the two
    gap_m : distance between them, m; 0 where they overlap
    overlap_m : how deep inside the second view a target can be when it leaves the first, m; 0 without an overlap
    """

    source: str
    target: str
    gap_m: float
    overlap_m: float = 0.0


@dataclass(frozen=True, slots=True)
class DwellCertificates:
    """The two certificates of one network, ready for the monitor and for the report."""

    published: DwellBounds
    sound: DwellBounds


def pose_rate_bound(v_max_mps: float, w_max_radps: float) -> float:
    """Return the bound of the pose rate's norm that linear and angular speed imply, (3-1)."""
    return math.hypot(v_max_mps, 0.5 * w_max_radps)


def working_radius(
    half_angles_rad: Sequence[float], range_m: float, near_m: float, far_m: float, extent_m: float
) -> float:
    """Return the radius of the largest ball about the optical axis at a range, less the target's extent.

    Parameters
    ----------
    half_angles_rad : angles between the optical axis and the sides of the view
    range_m : distance along the axis at which targets are watched, m
    near_m, far_m : ends of the field-of-view volume, m
    extent_m : largest distance of a target's feature from its reference point, m

    Raises
    ------
    CertificateError
        if the target does not fit the view at that range.
    """
    if not near_m < range_m < far_m:
        raise CertificateError(
            f"working range {range_m:.4g} m is not between {near_m:.4g} m and {far_m:.4g} m"
        )
    side = range_m * math.sin(min(half_angles_rad))  # bell2019, Figure 5-1: R = d sin(psi)
    radius = min(side, range_m - near_m, far_m - range_m) - extent_m
    if radius <= 0.0:
        raise CertificateError(
            f"the view holds a ball of radius {radius + extent_m:.4g} m at {range_m:.4g} m, "
            f"which does not hold a target of extent {extent_m:.4g} m: widen the view or watch from farther away"
        )
    return radius


def default_levels(constants: Constants, radius_m: float, v_lo: float | None) -> tuple[float, float]:
    """Return (V_hi, V_lo): V_hi = R^2/2, V_lo as given or between the reachable floor and V_hi.

    The floor is beta_1 where that is below V_hi, so that the conditions can hold before the model is learned too,
    else c_UB. Where both are above V_hi no choice helps; V_lo is then V_hi/2 and the dwell times say why.
    """
    v_hi = 0.5 * radius_m**2
    if v_lo is not None:
        return v_hi, v_lo
    floors = [floor for floor in (constants.beta1, constants.c_ub) if floor < v_hi]
    if not floors:
        return v_hi, 0.5 * v_hi
    return v_hi, math.sqrt(max(*floors, 1e-6 * v_hi) * v_hi)


def estimator_bounds(
    settings: CertificateSettings,
    *,
    k: float,
    kcl: float,
    gamma: float,
    alpha: float,
    window_s: float,
    stack_size: int,
    excitation: float,
    weight_bound: float,
    kernel_spacing_m: float,
    kernel_width_m: float,
    v_max_mps: float,
    w_max_radps: float,
    switching: str = "sign",
    switching_gain: float = math.inf,
    boundary_layer: float = 0.0,
    sampling: Sampling | None = None,
) -> EstimatorBounds:
    """Collect the bounds from an estimator's gains and a target's speed limits; ``settings`` has the last word.

    Parameters
    ----------
    k, kcl, gamma, alpha, window_s, stack_size : gains of the update laws (Gamma = gamma I), window and stack
    excitation : smallest eigenvalue of the stack at which excitation is said to hold
    weight_bound : outer radius of the projection: its bound plus its boundary layer
    kernel_spacing_m, kernel_width_m : of the basis
    v_max_mps, w_max_radps : bounds of the target's speed
    switching, switching_gain, boundary_layer : form of the switching term, for the continuous law
    sampling : how the estimator is sampled and disturbed; None: the continuous law
    """
    floor = 0.0
    sigma_bar = settings.sigma_bar or lattice_sigma_bar(kernel_spacing_m, kernel_width_m)
    if switching != "sign" and sampling is None:
        floor = switching_residue(switching, switching_gain, boundary_layer, settings.eps_bar)
    return EstimatorBounds(
        k=k,
        kcl=kcl,
        gamma_inv_min=1.0 / gamma,
        gamma_inv_max=1.0 / gamma,
        alpha=alpha,
        window_s=window_s,
        stack_size=stack_size,
        eps_bar=settings.eps_bar,
        etadot_max=settings.etadot_max or pose_rate_bound(v_max_mps, w_max_radps),
        sigma_bar=sigma_bar,
        weight_bound=settings.weight_bound or weight_bound,
        lambda_min_psi=excitation,
        switching_floor=floor,
        sampling=sampling,
    )


def certify_dwell(
    bounds: EstimatorBounds,
    radius_m: float,
    *,
    mobile: bool,
    v_lo: float | None = None,
    shared_model: bool = False,
) -> DwellCertificates:
    """Return both certificates' dwell times for a network whose views hold a ball of ``radius_m``.

    ``shared_model``: all regions or views share one model and history stack (``estimator.share``).
    """
    pair = []
    for make in (published, sound):
        constants = make(bounds, mobile=mobile)
        v_hi, level = default_levels(constants, radius_m, v_lo)
        pair.append(DwellBounds(constants, v_hi, level, shared_model=shared_model))
    return DwellCertificates(*pair)


def dwell_report(
    certificates: DwellCertificates,
    *,
    v_max_mps: float,
    extent_m: float,
    gaps: Sequence[NetworkGap] = (),
    faults: Sequence[str] = (),
) -> dict[str, object]:
    """Return the dwell-time report of a network as plain data.

    Parameters
    ----------
    certificates : from ``certify_dwell``
    v_max_mps : bound of the target's speed, m/s
    extent_m : largest distance of a target's feature from its reference point, m
    gaps : gaps between views; Theorem 3.1 is applied to each of them, for stationary networks
    faults : why ``sound`` is refused: premises that contradict each other, settings outside its proof

    Returns
    -------
    dict
        ``published`` and ``sound``, each with ``verdict``, ``reason``, ``constants``, ``v_hi``, ``v_lo``,
        ``off_max_s``, ``on_min_s``; ``gaps`` with one verdict each; ``assumptions``; ``violations`` = 0, to be
        replaced by the monitor's count after a run.
    """
    verdicts = _gap_verdicts(certificates.published, v_max_mps, extent_m, gaps)
    sound_part = _one_report(certificates.sound, [])
    if faults:
        sound_part |= {
            "verdict": "refused",
            "reason": "; ".join(faults),
        }
    return {
        "published": _one_report(certificates.published, verdicts),
        "sound": sound_part,
        "gaps": [
            {"from": g.source, "to": g.target, "gap_m": g.gap_m, "published": v.as_dict()}
            for g, v in zip(gaps, verdicts, strict=False)
        ],
        "assumptions": list(SOUND_ASSUMPTIONS),
        "violations": 0,
    }


def _gap_verdicts(
    bounds: DwellBounds, v_max_mps: float, extent_m: float, gaps: Sequence[NetworkGap]
) -> list[Theorem31]:
    """Apply Theorem 3.1 to each gap; it is about stationary networks only."""
    if bounds.constants.mobile:
        return []
    best = [bounds.on_min(h=h).seconds for h in (False, True)]
    on_min = min((s for s in best if s is not None), default=None)
    return [
        occlusion_verdict(gap.overlap_m, v_max_mps, on_min, extent_m)
        if gap.overlap_m > 0.0
        else theorem_31(gap.gap_m, v_max_mps, on_min, extent_m)
        for gap in gaps
    ]


def _one_report(bounds: DwellBounds, verdicts: Sequence[Theorem31]) -> dict[str, object]:
    """Return one certificate's part of the report."""
    on = {name: bounds.on_min(h=h) for name, h in (("not_excited", False), ("excited_before", True))}
    off = _off_limits(bounds)
    verdict, reason = _verdict(on, off, verdicts)
    return {
        "verdict": verdict,
        "reason": reason,
        "v_hi": bounds.v_hi,
        "v_lo": bounds.v_lo,
        "on_min_s": {name: time.as_dict() for name, time in on.items()},
        "off_max_s": {name: time.as_dict() for name, time in off.items()},
        "constants": bounds.constants.as_dict(),
    }


def _off_limits(bounds: DwellBounds) -> dict[str, DwellTime]:
    """Return the longest time out of view after a long interval in view, by case of (4-31)."""
    cases = {
        "not_excited": (False, False),
        "excited_this_visit": (True, False),
        "excited_before": (True, True),
    }
    return {name: bounds.off_max(_LONG_S, 0.5 * _LONG_S, d=d, h=h) for name, (d, h) in cases.items()}


def _verdict(
    on: dict[str, DwellTime], off: dict[str, DwellTime], verdicts: Sequence[Theorem31]
) -> tuple[str, str]:
    """Summarise: unsatisfiable geometry first, then impossible dwell times, then the times themselves."""
    apart = [v for v in verdicts if v.verdict == "unsatisfiable"]
    if apart:
        return "unsatisfiable", "Theorem 3.1: " + apart[0].reason
    texts, possible = [], False
    for name, words in (
        ("not_excited", "before the model is learned"),
        ("excited_before", "once it is learned"),
    ):
        on_time, off_time = on[name], off[name]
        if on_time.seconds is not None and off_time.seconds is not None:
            possible = True
            text = f"at least {on_time.seconds:.3g} s in view, at most {off_time.seconds:.3g} s out of view"
        else:
            text = "no dwell time meets the condition: " + (on_time.reason or off_time.reason)
        texts.append(f"{words}, {text}")
    return ("conditional" if possible else "unsatisfiable"), "; ".join(texts)
