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

import numpy as np

from camnet.control.monitor_kernel import record_period, run_periods
from camnet.control.settings import ControllerSettings
from camnet.control.sliding_mode import CameraControl, switching_loss
from camnet.types import Array, Snapshot

__all__ = ["DisturbanceMonitor", "envelope"]

_ROUNDING = 1e-9
#: control periods judged at a time
_CHUNK = 256


def envelope(t_s: Array, e0: float, k1: float, excess: float, layer_term: float) -> Array:
    """Bound on the norm of the error at times ``t_s`` after switching on: the closed form in the module's text.

    ``excess`` is the supremum of ``max(|d| - d_bar, 0)``, ``layer_term`` is c. Both zero: (4-27).
    """
    decay = np.exp(-k1 * np.asarray(t_s, dtype=float))
    smooth = np.sqrt(e0**2 * decay**2 + layer_term / k1 * (1.0 - decay**2))  # (4-27) and the layer
    return np.asarray(smooth + excess / k1 * (1.0 - decay))


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
        self._last = np.zeros((n_agents, 24))
        self._norms: list[Array] = []
        self._error_max = np.zeros(2)
        self._exceeded = self._bound_exceeded = self._count = 0
        self._dt = np.empty(_CHUNK)
        self._truth, self._reference = np.empty((_CHUNK, n_agents, 14)), np.empty((_CHUNK, n_agents, 13))
        self._command, self._error = np.empty((_CHUNK, n_agents, 6)), np.empty((_CHUNK, n_agents, 6))
        self._buffers = (self._truth, self._command, self._error, self._reference)

    def update(self, before: Snapshot, after: Snapshot, control: CameraControl) -> None:
        """Take one control period: the truth at its two ends and the command between them.

        Periods are collected and judged many at a time.
        """
        poses = (before.camera_p_world, before.camera_q_world, after.camera_p_world, after.camera_q_world)
        self.update_poses(poses, after.t_s - before.t_s, control)

    def update_poses(
        self, poses: tuple[Array, Array, Array, Array], dt_s: float, control: CameraControl
    ) -> None:
        """Take a control period by the cameras' positions and orientations before and after it."""
        n, k = self._n, self._count
        if n == 0:
            return
        r = control.reference
        record_period(
            k,
            *self._buffers,
            *poses,
            control.v_world,
            control.w_cam,
            control.e_linear,
            control.e_angular,
            r.p_world,
            r.q_world,
            r.v_world,
            r.w_cam,
        )
        self.ended(dt_s)

    @property
    def place(self) -> int:
        """Where the kernels of `camnet.control.period_kernel` write the present period in ``buffers``."""
        return self._count

    @property
    def buffers(self) -> tuple[Array, Array, Array, Array]:
        """Truth (K,N,14), command (K,N,6), error (K,N,6), reference (K,N,13) of the periods not yet judged."""
        return self._buffers

    def ended(self, dt_s: float) -> None:
        """Note that the present period, which lasted ``dt_s``, is written."""
        self._dt[self._count] = dt_s
        self._count += 1
        if self._count == _CHUNK:
            self._judge()

    def _judge(self) -> None:
        """Compare the errors of the collected periods with the envelopes."""
        k, self._count = self._count, 0
        if k == 0:
            return
        norms = np.empty((k, 2, self._n))
        self._bound_exceeded += run_periods(
            self._dt[:k],
            self._truth[:k],
            self._command[:k],
            self._error[:k],
            self._reference[:k],
            self._last,
            self._a2,
            self._b,
            self._bars,
            self._layer,
            self._k1,
            _ROUNDING,
            norms,
        )
        self._norms.append(norms)
        self._exceeded += int((norms > self._bars[:, None]).any(axis=(1, 2)).sum())
        errors = np.linalg.norm(self._error[:k].reshape(k, self._n, 2, 3), axis=3)
        self._error_max = np.maximum(self._error_max, errors.max(axis=(0, 1)))

    def summary(self) -> dict[str, float | int | bool]:
        """Figures of everything so far: m and m/s for the linear part, rad and rad/s for the angular one.

        ``disturbance_exceeded``: control periods with a disturbance beyond d_bar (``assumption_void`` if any: the
        certificate's assumption failed). ``bound_exceeded``: control periods with an error outside the
        envelope (4-27) plus what the realised disturbance explains.
        """
        self._judge()
        norms = np.concatenate(self._norms) if self._norms else np.zeros((1, 2, 1))
        linear, angular = norms[:, 0], norms[:, 1]
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
