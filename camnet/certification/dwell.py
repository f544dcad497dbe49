r"""Dwell-time conditions of harris2020: how long a target may stay unseen, and must stay seen.

| symbol | name | unit | equation |
| --- | --- | --- | --- |
| V_hi, V_lo | ``v_hi``, ``v_lo`` | m^2 | Lemmas 3.3, 3.4; Remark 4.4 |
| Dt_off | ``off_max`` | s | (3-31), (4-31) |
| Dt_on | ``on_min`` | s | (3-35), Remark 3.4, (4-35) |
| nu_1 .. nu_4 | in ``_at_exit`` | - | below (4-32) |

``published`` and ``sound`` conditions differ in four places. While unseen V' <= lambda_G V + c3, whose solution is
V <= (V0 + c3/lambda_G) exp(lambda_G tau) - c3/lambda_G; (3-30) and (4-30) drop c3, ``sound`` keeps it. At a
handoff the next region's Lyapunov value holds that region's own weights, so that V_{j+1}(t_on) <= V_hi, which (4-35)
takes for granted, does not follow from V_j(t_on) <= V_hi; ``sound`` uses V_hi + c2 unless regions share one model.
The bound (3-24) holds with and without excitation, so ``sound`` takes the better of (3-24) and (3-27) once it holds.
And a condition whose logarithm is undefined, or that no dwell time can meet, is reported as impossible with its
reason instead of a NaN or a negative time.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from camnet.certification.constants import Constants
from camnet.errors import CertificateError

__all__ = ["DwellBounds", "DwellTime"]


@dataclass(frozen=True, slots=True)
class DwellTime:
    """One dwell-time condition: a time, or the reason why no time meets it.

    Attributes
    ----------
    seconds : the bound, s; None where no dwell time satisfies the condition
    equation : the equation it comes from
    reason : empty, or why it is impossible
    """

    seconds: float | None
    equation: str
    reason: str = ""

    @property
    def possible(self) -> bool:
        """Whether some dwell time satisfies the condition."""
        return self.seconds is not None

    def as_dict(self) -> dict[str, float | str | None]:
        """Return the record as plain data, for JSON."""
        return {"seconds": self.seconds, "equation": self.equation, "reason": self.reason}


@dataclass(frozen=True, slots=True)
class DwellBounds:
    """The dwell-time conditions of one certificate.

    Parameters
    ----------
    constants : of this certificate, stationary or mobile
    v_hi : level that the Lyapunov value must not exceed while the target is unseen
    v_lo : level that it must fall below while the target is seen
    shared_model : whether all regions or views share one history stack and model (``sound``)
    """

    constants: Constants
    v_hi: float
    v_lo: float
    shared_model: bool = False

    def __post_init__(self) -> None:
        for name in ("v_hi", "v_lo"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise CertificateError(f"{name} = {value!r}: a finite level > 0 is needed")

    @property
    def certificate(self) -> str:
        """Name of the certificate, ``published`` or ``sound``."""
        return self.constants.certificate

    @property
    def v_on(self) -> float:
        """Upper bound of the Lyapunov value when feedback returns."""
        c = self.constants
        if c.certificate == "sound" and not self.shared_model:
            return self.v_hi + c.reset_rise + c.c2
        return self.v_hi + c.reset_rise

    def off_max(self, on_s: float, excited_s: float, *, d: bool, h: bool) -> DwellTime:
        """Return the longest time that the target may stay unseen after an interval in view.

        Parameters
        ----------
        on_s : length of the interval in view, s
        excited_s : its part after finite excitation held, s
        d : whether finite excitation holds at its end
        h : whether it already held in an earlier visit

        Notes
        -----
        Lemma 3.3 (3-31) for stationary networks, Theorem 4.1 (4-31) for mobile ones.
        """
        level = self.exit_level(on_s, excited_s, d=d, h=h)
        return self._ratio(level, "(4-31)" if self.constants.mobile else "(3-31)")

    def exit_level(self, on_s: float, excited_s: float, *, d: bool, h: bool) -> float:
        """Return the level that V is below when the target is lost; arguments as in ``off_max``."""
        return self._at_exit(on_s, excited_s, d=d, h=h) if self.constants.mobile else self.v_lo

    def error_bound_m(self, exit_level: float, off_s: float) -> float:
        """Return the bound of the position error ``off_s`` after the target was lost, sqrt(2 V), m."""
        c = self.constants
        off_s = off_s + c.lag_s
        grown = (exit_level + c.growth_offset) * math.exp(min(c.lambda_g * off_s, 700.0)) - c.growth_offset
        if c.off_speed is not None:
            driven = 0.5 * (math.sqrt(2.0 * exit_level) + c.off_speed * off_s) ** 2 + c.off_source * off_s
            grown = min(grown, driven)
        return math.sqrt(2.0 * max(grown, 0.0))

    def _at_exit(self, on_s: float, excited_s: float, *, d: bool, h: bool) -> float:
        """Return the bound of V when feedback is lost, (4-33); ``sound`` may use the first case at any time."""
        c = self.constants
        on_s, excited_s = max(0.0, on_s - c.lag_s), max(0.0, excited_s - c.lag_s)
        unexcited = self.v_on * math.exp(-c.lambda_d * on_s) + c.beta1  # nu_1
        if not d:
            return unexcited
        excited = self._at_exit_excited(on_s, excited_s, h=h)
        return min(excited, unexcited) if c.certificate == "sound" else excited

    def _at_exit_excited(self, on_s: float, excited_s: float, *, h: bool) -> float:
        c = self.constants
        if not h:
            nu3 = math.exp(-c.lambda_dt * excited_s)
            nu2 = math.exp(-c.lambda_d * (on_s - excited_s)) * nu3
            return self.v_on * nu2 + c.beta1 * nu3 + c.c_ub
        return self.v_on * math.exp(-c.lambda_dt * on_s) + c.c_ub  # nu_4

    def _ratio(self, v_exit: float, equation: str) -> DwellTime:
        """Solve (v_exit + offset) exp(lambda_G Dt) - offset <= v_hi for Dt; the offset is c3/lambda_G or 0."""
        c = self.constants
        if c.refusal:
            return DwellTime(None, equation, c.refusal)
        if v_exit >= self.v_hi:
            return DwellTime(
                None,
                equation,
                f"the error level when the target leaves, {v_exit:.4g}, is not below the allowed level "
                f"V_hi = {self.v_hi:.4g}",
            )
        rise = (self.v_hi - v_exit) / (v_exit + c.growth_offset)
        seconds = max(math.log1p(rise) / c.lambda_g, self._driven_time(v_exit)) - c.lag_s
        if seconds <= 0.0:
            return DwellTime(
                None, equation, f"the error passes V_hi within one sensing period of {c.lag_s:.4g} s"
            )
        return DwellTime(seconds, equation)

    def _driven_time(self, v_exit: float) -> float:
        """Solve (sqrt(2 v_exit) + g Dt)^2 / 2 + c Dt = v_hi: V' <= norm(eta_til) g + c while unseen."""
        c = self.constants
        if c.off_speed is None or c.off_speed <= 0.0:
            return 0.0
        linear = c.off_speed * math.sqrt(2.0 * v_exit) + c.off_source
        room = self.v_hi - v_exit
        return 2.0 * room / (linear + math.sqrt(linear**2 + 2.0 * c.off_speed**2 * room))

    def on_min(self, *, h: bool) -> DwellTime:
        """Return the shortest time in view after which V <= V_lo; ``h``: excitation held in an earlier visit.

        Notes
        -----
        Lemma 3.4 (3-35) and Remark 3.4 for stationary networks, Theorem 4.2 (4-35) for mobile ones.
        """
        first = self._decay(h=h)
        if not h or self.constants.certificate == "published":
            return first
        times = [t for t in (first, self._decay(h=False)) if t.seconds is not None]
        return min(times, key=lambda t: t.seconds or 0.0) if times else first

    def _decay(self, *, h: bool) -> DwellTime:
        """Solve v_on exp(-rate Dt) + floor = v_lo for Dt."""
        c = self.constants
        rate, floor, name = (c.lambda_dt, c.c_ub, "c_UB") if h else (c.lambda_d, c.beta1, "beta_1")
        equation = "(4-35)" if c.mobile else ("Remark 3.4" if h else "(3-35)")
        if c.refusal:
            return DwellTime(None, equation, c.refusal)
        if self.v_lo <= floor:
            return DwellTime(
                None,
                equation,
                f"the error cannot fall below V_lo = {self.v_lo:.4g}: its floor {name} is {floor:.4g}",
            )
        return DwellTime(max(0.0, math.log(self.v_on / (self.v_lo - floor)) / rate) + c.lag_s, equation)
