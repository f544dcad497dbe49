"""What the sliding-mode controller assumes and promises, measured while it runs.

Assumption 4.3 bounds the disturbance d by d_bar; (4-27) promises ``|e(t)| <= |e(t_on)| exp(-k1 (t - t_on))``. A real
quadrotor exceeds d_bar now and then, the switching function has a boundary layer, and commands are held for a
control period. The envelope that follows from the realised disturbance, for each of the linear and angular errors
(three components e, norms in R^3):

| symbol | name | meaning |
| --- | --- | --- |
| kappa | `switching_loss` | sup of ``e - e s(e)``: given away per component by the boundary layer |
| x | excess | ``max(|d| - d_bar, 0)`` |
| h | | control period |
| c | | ``3 kappa d_bar + h/2 (|d| + sqrt(3) d_bar)^2`` |

The closed loop (4-7) gives ``d/dt |e|^2/2 <= -k1 |e|^2 + 3 kappa d_bar + x |e|``. With ``a' = -k1 a + c/a`` and
``b' = -k1 b + x`` the sum y = a + b satisfies ``y y' = -k1 y^2 + c (a + b)/a + x y >= -k1 y^2 + c + x y``, so
``|e| <= a + b`` by comparison:

    |e(t)| <= sqrt(|e0|^2 exp(-2 k1 t) + (c/k1)(1 - exp(-2 k1 t))) + sup(x)/k1 (1 - exp(-k1 t)).

Without layer, excess and holding this is (4-27). Holding: ``e+ = (1 - k1 h) e + h (d - d_bar s(e))`` adds
``h^2 |d - d_bar s|^2 <= h^2 (|d| + sqrt(3) d_bar)^2`` to ``|e+|^2``, the second part of c (for k1 h < 1). The
recursion below uses each period's d: its mean over the period, and what the reference moved beyond its held velocity,
so that the linear bound is exact for the sampled loop. The angular one holds to second order in h times
the error.
"""

from __future__ import annotations

import math

import numpy as np

from camnet.control.rates_kernel import mean_rates, row_norms, turn_between
from camnet.control.settings import ControllerSettings
from camnet.control.sliding_mode import CameraControl, Reference, switching_loss
from camnet.types import Array, Snapshot

__all__ = ["DisturbanceMonitor", "envelope"]

_ROUNDING = 1e-9


def envelope(t_s: Array, e0: float, k1: float, excess: float, layer_term: float) -> Array:
    """Bound on the norm of the error at times ``t_s`` after switching on: the closed form in the module's text.

    ``excess`` is the supremum of ``max(|d| - d_bar, 0)``, ``layer_term`` is c. Both zero: (4-27).
    """
    decay = np.exp(-k1 * np.asarray(t_s, dtype=float))
    smooth = np.sqrt(e0**2 * decay**2 + layer_term / k1 * (1.0 - decay**2))  # (4-27) and the layer
    return np.asarray(smooth + excess / k1 * (1.0 - decay))


class _Envelope:
    """The recursion of a and b for N agents; see the module's text."""

    def __init__(self, k1: float, d_bar: float, loss: float) -> None:
        self._k1, self._d_bar, self._layer = k1, d_bar, 3.0 * loss * d_bar
        self._a2: Array = np.zeros(0)
        self._b: Array = np.zeros(0)

    def start(self, error: Array) -> None:
        self._a2, self._b = error**2, np.zeros_like(error)

    def advance(self, d: Array, h: float) -> Array:
        """Bound (N,) after a period of ``h`` seconds with disturbance norms ``d`` (N,)."""
        k1 = self._k1
        held = 0.5 * h * (d + math.sqrt(3.0) * self._d_bar) ** 2
        self._a2 = self._a2 * math.exp(-2.0 * k1 * h) + 2.0 * h * (self._layer + held)
        self._b = self._b * math.exp(-k1 * h) + h * np.maximum(d - self._d_bar, 0.0)
        return np.sqrt(self._a2) + self._b


class DisturbanceMonitor:
    """Collects the realised disturbance ``d = motion - command`` of N agents, control period by control period.

    Parameters
    ----------
    settings : the controller's gains and bounds
    n_agents : N; the first N cameras of a snapshot
    """

    def __init__(self, settings: ControllerSettings, n_agents: int) -> None:
        self._n = n_agents
        self._bars = (settings.d_bar_mps, settings.d_bar_radps)
        loss = switching_loss(settings.switching, settings.boundary_layer)
        self._envelopes = tuple(_Envelope(settings.k1_per_s, bar, loss) for bar in self._bars)
        self._norms: tuple[list[Array], list[Array]] = ([], [])
        self._error_max = [0.0, 0.0]
        self._exceeded = self._bound_exceeded = 0
        self._last: tuple[float, Array, Array, Array, CameraControl] | None = None

    def update(self, before: Snapshot, after: Snapshot, control: CameraControl) -> None:
        """Take one control period: the truth at its two ends and the command between them."""
        if self._n == 0:
            return
        dt = after.t_s - before.t_s
        p0, q0 = before.camera_p_world[: self._n], before.camera_q_world[: self._n]
        p1, q1 = after.camera_p_world[: self._n], after.camera_q_world[: self._n]
        d_linear = (p1 - p0) / dt - control.v_world
        d_angular = mean_rates(q0, q1, dt) - control.w_cam
        self._judge(control)
        beyond = False
        for norms, d, bar in zip(self._norms, (d_linear, d_angular), self._bars, strict=True):
            norms.append(row_norms(d))
            beyond = beyond or bool((norms[-1] > bar).any())
        self._exceeded += beyond
        self._last = (dt, d_linear, d_angular, q0, control)

    def _judge(self, control: CameraControl) -> None:
        """Compare the errors at this instant with the envelopes, moved on over the period that ends here."""
        errors = [row_norms(e) for e in (control.e_linear, control.e_angular)]
        if self._last is None:
            for bound, error in zip(self._envelopes, errors, strict=True):
                bound.start(error)
        else:
            realised = self._with_slip(control.reference)
            outside = False
            for bound, d, error in zip(self._envelopes, realised, errors, strict=True):
                outside = outside or bool((error > bound.advance(d, self._last[0]) + _ROUNDING).any())
            self._bound_exceeded += outside
        for k, error in enumerate(errors):
            self._error_max[k] = max(self._error_max[k], float(error.max()))

    def _with_slip(self, now: Reference) -> tuple[Array, Array]:
        """Norms (N,) of the last period's disturbance less what the reference moved beyond its held velocity."""
        if self._last is None:
            raise RuntimeError("no earlier period")
        dt, d_linear, d_angular, q0, control = self._last
        then = control.reference
        slip_linear = (now.p_world - then.p_world) / dt - then.v_world
        slip = mean_rates(then.q_world, now.q_world, dt) - then.w_cam
        slip_angular = turn_between(q0, then.q_world, slip)  # into the camera's frame
        return row_norms(d_linear - slip_linear), row_norms(d_angular - slip_angular)

    def summary(self) -> dict[str, float | int | bool]:
        """Figures of everything so far: m and m/s for the linear part, rad and rad/s for the angular one.

        ``disturbance_exceeded``: control periods with a disturbance beyond d_bar (``assumption_void`` if any: the
        certificate's assumption failed). ``bound_exceeded``: control periods with an error outside the
        envelope (4-27) plus what the realised disturbance explains.
        """
        linear, angular = (np.concatenate(x) if x else np.zeros(1) for x in self._norms)
        figures: dict[str, float | int | bool] = {
            "max_error": self._error_max[0],
            "max_error_rad": self._error_max[1],
            "bound_exceeded": self._bound_exceeded,
            "d_bar": self._bars[0],
            "d_bar_radps": self._bars[1],
            "disturbance_exceeded": self._exceeded,
            "assumption_void": self._exceeded > 0,
        }
        for unit, values in (("", linear), ("_radps", angular)):
            figures[f"disturbance_max{unit}"] = float(values.max())
            for percent in (50, 95, 99):
                figures[f"disturbance_p{percent}{unit}"] = float(np.percentile(values, percent))
        return figures
