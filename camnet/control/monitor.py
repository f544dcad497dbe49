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

from dataclasses import dataclass

import numpy as np

from camnet.control.monitor_kernel import advance_envelopes, realised_disturbance, row_norms, without_slip
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


@dataclass(frozen=True, eq=False, slots=True)
class _Period:
    """One control period: length, disturbance (N,6), camera orientations (N,4) and reference at its start."""

    dt_s: float
    d: Array
    q0: Array
    reference: Reference

    def without_slip(self, now: Reference) -> Array:
        """Norms (2,N) of the disturbance less what the reference moved beyond its held velocity."""
        then = self.reference
        return np.asarray(
            without_slip(
                self.d,
                self.q0,
                then.p_world,
                then.q_world,
                then.v_world,
                then.w_cam,
                now.p_world,
                now.q_world,
                self.dt_s,
            )
        )


class DisturbanceMonitor:
    """Collects the realised disturbance ``d = motion - command`` of N agents, control period by control period.

    Parameters
    ----------
    settings : the controller's gains and bounds
    n_agents : N; the first N cameras of a snapshot
    """

    def __init__(self, settings: ControllerSettings, n_agents: int) -> None:
        self._n, self._k1 = n_agents, settings.k1_per_s
        self._bars = np.array([settings.d_bar_mps, settings.d_bar_radps])
        self._layer = 3.0 * switching_loss(settings.switching, settings.boundary_layer) * self._bars
        self._a2, self._b = np.zeros((2, n_agents)), np.zeros((2, n_agents))
        self._norms: list[Array] = []
        self._error_max = np.zeros(2)
        self._exceeded = self._bound_exceeded = 0
        self._last: _Period | None = None

    def update(self, before: Snapshot, after: Snapshot, control: CameraControl) -> None:
        """Take one control period: the truth at its two ends and the command between them."""
        n = self._n
        if n == 0:
            return
        dt = after.t_s - before.t_s
        q0, d = before.camera_q_world[:n], np.empty((n, 6))
        norms = realised_disturbance(
            before.camera_p_world[:n],
            q0,
            after.camera_p_world[:n],
            after.camera_q_world[:n],
            control.v_world,
            control.w_cam,
            dt,
            d,
        )
        self._judge(control)
        self._norms.append(norms)
        self._exceeded += bool((norms > self._bars[:, None]).any())
        self._last = _Period(dt, d, q0, control.reference)

    def _judge(self, control: CameraControl) -> None:
        """Compare the errors at this instant with the envelopes, moved on over the period that ends here."""
        errors = np.stack([row_norms(control.e_linear), row_norms(control.e_angular)])
        if self._last is None:
            self._a2 = errors**2
        else:
            realised = self._last.without_slip(control.reference)
            bound = advance_envelopes(
                self._a2, self._b, realised, self._bars, self._layer, self._k1, self._last.dt_s
            )
            self._bound_exceeded += bool((errors > bound + _ROUNDING).any())
        self._error_max = np.maximum(self._error_max, errors.max(axis=1))

    def summary(self) -> dict[str, float | int | bool]:
        """Figures of everything so far: m and m/s for the linear part, rad and rad/s for the angular one.

        ``disturbance_exceeded``: control periods with a disturbance beyond d_bar (``assumption_void`` if any: the
        certificate's assumption failed). ``bound_exceeded``: control periods with an error outside the
        envelope (4-27) plus what the realised disturbance explains.
        """
        linear, angular = np.concatenate(self._norms, axis=1) if self._norms else np.zeros((2, 1))
        figures: dict[str, float | int | bool] = {
            "max_error": float(self._error_max[0]),
            "max_error_rad": float(self._error_max[1]),
            "bound_exceeded": self._bound_exceeded,
            "d_bar": float(self._bars[0]),
            "d_bar_radps": float(self._bars[1]),
            "disturbance_exceeded": self._exceeded,
            "assumption_void": self._exceeded > 0,
        }
        for unit, values in (("", linear), ("_radps", angular)):
            figures[f"disturbance_max{unit}"] = float(values.max())
            for percent in (50, 95, 99):
                figures[f"disturbance_p{percent}{unit}"] = float(np.percentile(values, percent))
        return figures
