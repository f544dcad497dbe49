r"""The ``learned`` certificate of fixed cameras for a target that follows a learned vector field.

| symbol | name | unit | meaning |
| --- | --- | --- | --- |
| p_hat(t) | the learned flow from ``start`` | m | followed until it has come round, or for ``duration_s`` |
| exit | where the flow leaves a view, the target's extent counted | | t_off of harris2020 section 3.2 |
| s | ``spread_m`` | m | targets may leave up to this far beside the predicted exit |

The exits beside the predicted one are covered by samples at most ``cover_m`` apart; a tube that starts at a sample with
e(0) + cover/2 holds every target that leaves near it, because its true position is within e(0) of its estimate and
its estimate within cover/2 of a sample. A transition is certified when each of its tubes is inside one view in time.
Every view may have a model of its own: what was learned while the target was there, and of the gap behind it.
Mobile cameras: the views are operating regions, and the agent of the next one has to be at the prediction, with the
ball inside its footprint, once the ball is wholly in its region (``meeting``).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely

from camnet.certification.crossing import Crossing, RegionAgent, certify_crossing, meeting
from camnet.certification.free_network import GroundView
from camnet.certification.growth import PlanarField, error_tube, largest_model_error
from camnet.certification.reachable import PlanarView, TubeReach
from camnet.errors import CertificateError
from camnet.types import Array

__all__ = ["FlowExit", "FlowTargetClass", "certify_flow", "flow_exits"]


@dataclass(frozen=True, slots=True)
class FlowTargetClass:
    """Targets that follow the learned field up to a model error.

    Attributes
    ----------
    v_max_mps : bound of the speed, of target and prediction
    model_error_mps : e_v, valid in the corridor
    e0_m : position error when the target is lost
    spread_m : targets leave up to this far to either side of the predicted exit
    source : where e_v comes from: ``deterministic``, ``sampled``, ``statistical`` or ``stated``
    own_m : what the agent of each view may be off by itself: added to ``e0_m`` of targets that leave it; empty: nothing
    """

    v_max_mps: float
    model_error_mps: float
    e0_m: float
    spread_m: float = 0.0
    source: str = "stated"
    own_m: tuple[float, ...] = ()

    def lost_m(self, view: int) -> float:
        """Return the position error of a target that was lost from ``view``, m."""
        return self.e0_m + (self.own_m[view] if self.own_m else 0.0)

    @property
    def least_mu(self) -> float:
        """Least logarithmic norm taken, 1/s: a statistical e_v is the growth of whole gaps' errors, none contracts."""
        return 0.0 if self.source == "statistical" else -math.inf


@dataclass(frozen=True, eq=False)
class FlowExit:
    """Where the learned flow leaves a view: its number, the place (2,) and the direction (2,) of the flow there.

    ``after`` is the view that the flow enters next (-1: none while it was followed).
    """

    view: int
    point: Array
    direction: Array
    after: int = -1


def flow_exits(
    field: PlanarField | Sequence[PlanarField],
    ground: Sequence[GroundView],
    start: Array,
    duration_s: float,
    step_s: float = 0.05,
) -> list[FlowExit]:
    """Follow the learned flow and list its exits, each once even if the flow comes round again.

    With one field per view, the flow follows the field of the view that it was in last (at first: the nearest).

    Raises
    ------
    CertificateError
        if the flow stops: a field without data beyond the views predicts that the target stands still.
    """
    fields = _per_view(field, ground)
    p, inside = np.asarray(start, dtype=float), -1
    exits: list[FlowExit] = []
    latest = fields[int(np.argmax([g.view.depth(p) for g in ground]))]
    for _ in range(math.ceil(duration_s / step_s)):
        velocity = latest.velocity(p)
        speed = float(np.linalg.norm(velocity))
        if speed < 1e-3:
            raise CertificateError(
                f"the learned flow stops at ({p[0]:.3g}, {p[1]:.3g}) m, {speed:.2g} m/s: nothing was learned there; "
                "learn across the gaps first"
            )
        here = [k for k, g in enumerate(ground) if g.view.depth(p) >= 0.0]
        if inside >= 0 and inside not in here:
            if not here:
                known = any(e.view == inside and np.linalg.norm(e.point - p) < 0.5 for e in exits)
                if known:
                    break
                exits.append(FlowExit(inside, p, velocity / speed))
            inside = -1
        if inside < 0 and here:
            inside = here[0]
            latest = fields[inside]
            if exits and exits[-1].after < 0:
                exits[-1] = replace(exits[-1], after=inside)
        middle = latest.velocity(p + 0.5 * step_s * velocity)
        p = p + step_s * middle
    return exits


def _per_view(field: PlanarField | Sequence[PlanarField], ground: Sequence[GroundView]) -> list[PlanarField]:
    if isinstance(field, PlanarField):
        return [field] * len(ground)
    if len(field) != len(ground):
        raise CertificateError(
            f"{len(field)} learned fields for {len(ground)} views: give one, or one for each"
        )
    return list(field)


def certify_flow(
    field: PlanarField | Sequence[PlanarField],
    ground: Sequence[GroundView],
    target: FlowTargetClass,
    start: Array,
    duration_s: float,
    off_max_s: float,
    on_min_s: float = 0.0,
    step_s: float = 0.2,
    cover_m: float = 0.1,
    find_largest: bool = True,
    agents: Sequence[RegionAgent | None] | None = None,
) -> dict[str, object]:
    """Certify every exit of the learned flow and return the report as plain data for JSON.

    Parameters
    ----------
    field : learned velocity field, or one for each view
    ground : views on the ground, shrunk by the target's extent; mobile cameras: their regions
    target : class of the targets
    start : (2,) a point on the flow, m
    duration_s : how long to follow it
    off_max_s, on_min_s : longest time that a target may stay unseen; time that it must stay in view
    step_s : of the tubes
    cover_m : distance between samples across an exit
    find_largest : also find the largest model error that each transition tolerates
    agents : mobile cameras, one for each region; None in the place of a fixed camera
    """
    fields = _per_view(field, ground)
    exits = flow_exits(fields, ground, start, duration_s)
    settings = _Settings(off_max_s, on_min_s, step_s, cover_m, agents)
    transitions = []
    for leave in exits:
        crossing = _worst(fields[leave.view], ground, target, target.model_error_mps, leave, settings)
        transitions.append(
            _entry(fields[leave.view], ground, target, leave, crossing, settings, find_largest)
        )
    good = [t["learned"]["verdict"] == "certified" for t in transitions]  # type: ignore[index]
    whole = "certified" if good and all(good) else "not certified"
    reason = f"{sum(good)} of {len(good)} exits of the learned flow are certified"
    return {
        "network": {"cameras": len(ground), "regions": sum(a is not None for a in agents or ())},
        "target_class": f"vector field, at most {target.v_max_mps:g} m/s, model error {target.model_error_mps:.3g} m/s",
        "certificates": {"learned": {"verdict": whole, "reason": reason}},
        "transitions": transitions,
        "uncertified": [
            {"from": t["from"], "to": t["to"]} for t, ok in zip(transitions, good, strict=True) if not ok
        ],
        "constants": {"model_error_source": target.source},
    }


#: stands for a view that is left out
_BLIND = PlanarView(np.zeros((1, 2)), np.zeros(1), possible=False)


@dataclass(frozen=True, eq=False)
class _Settings:
    """What all transitions share: dwell times, step of the tubes, distance of samples, mobile cameras."""

    off_max_s: float
    on_min_s: float
    step_s: float
    cover_m: float
    agents: Sequence[RegionAgent | None] | None


def _worst(
    field: PlanarField,
    ground: Sequence[GroundView],
    target: FlowTargetClass,
    model_error_mps: float,
    leave: FlowExit,
    settings: _Settings,
) -> Crossing:
    """Return the worst verdict over the samples across an exit."""
    # a view cannot help while the ball leaves it; it counts where the flow comes back to it
    others = [_BLIND if k == leave.view and leave.after != k else g.view for k, g in enumerate(ground)]
    largest = max(g.radius_m for g in ground)
    n = max(1, math.ceil(2.0 * target.spread_m / settings.cover_m - 1e-9))
    half = target.spread_m / n
    across = np.array([-leave.direction[1], leave.direction[0]])
    results = []
    for offset in np.linspace(-target.spread_m + half, target.spread_m - half, n):
        horizon = settings.off_max_s + settings.on_min_s + settings.step_s
        tube = error_tube(
            field,
            leave.point + offset * across,
            target.lost_m(leave.view) + half,
            model_error_mps,
            target.v_max_mps,
            horizon,
            settings.step_s,
            tolerance=1e-2,
            max_cells=600,
            stop_radius_m=largest,
            least_mu=target.least_mu,
        )
        reach = TubeReach(tube)
        result = certify_crossing(
            reach, others, tube.t_s, settings.off_max_s, settings.on_min_s, target.v_max_mps
        )
        if settings.agents is not None:
            result = meeting(reach, result, settings.agents, settings.off_max_s)
        results.append(result)
        if results[-1].verdict != "certified":
            return results[-1]
    return min(results, key=lambda r: r.margin_m)


def _entry(
    field: PlanarField,
    ground: Sequence[GroundView],
    target: FlowTargetClass,
    leave: FlowExit,
    crossing: Crossing,
    settings: _Settings,
    find_largest: bool,
) -> dict[str, object]:
    """Return one transition's entry of the report."""
    into = crossing.view if crossing.verdict == "certified" or leave.after < 0 else leave.after
    view = ground[into]
    gap = float(view.outline.distance(shapely.Point(leave.point)))
    tube = error_tube(
        field,
        leave.point,
        target.lost_m(leave.view),
        target.model_error_mps,
        target.v_max_mps,
        settings.off_max_s,
        settings.step_s,
        tolerance=1e-2,
        max_cells=600,
        stop_radius_m=view.radius_m,
        least_mu=target.least_mu,
    )
    learned: dict[str, object] = {
        "verdict": crossing.verdict,
        "margin_m": _finite(crossing.margin_m),
        "margin_s": _finite(crossing.margin_s),
        "binding": crossing.binding,
        "seen_again_s": _finite(crossing.time_s),
        "trust_horizon_s": tube.trust_horizon_s(view.radius_m),
        "model_error_source": target.source,
    }
    if find_largest:
        learned["largest_model_error_mps"] = largest_model_error(
            lambda e_v: _worst(field, ground, target, e_v, leave, settings).verdict == "certified",
            target.v_max_mps,
            2e-3,
        )
    learned["exit_m"] = leave.point.tolist()
    return {"from": ground[leave.view].name, "to": view.name, "gap_m": gap, "learned": learned}


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
