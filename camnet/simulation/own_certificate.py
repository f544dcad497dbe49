"""What a certificate says of agents' own poses and exit budgets: part of the report of ``camnet certify``."""

from __future__ import annotations

from typing import Any

from camnet.certification.outage import upper_level
from camnet.simulation.certificates import view_radius
from camnet.simulation.exits import back_s
from camnet.simulation.network import Network

__all__ = ["own_pose_report"]


def own_pose_report(network: Network) -> dict[str, Any]:
    """Return e(T), its 95 % version, R - e and V_hi of every agent that may lose its pose, and every exit budget.

    An exit budget is kept for certain if an agent that is as far out as it may go at the end of the time that it was
    given is back within the budget.
    """
    names = [agent.name for agent in network.scenario.agents]
    agents, exits = {}, {}
    for j, bounds in network.outages.items():
        outage, radius = network.outage_s(j), view_radius(network, j)
        error = bounds.error_m(outage)
        agents[names[j]] = {
            "outage_s": outage,
            "bound_m": error,
            "likely_m": bounds.likely_error_m(outage),
            "view_radius_m": radius + error,
            "radius_left_m": radius,
            "v_hi_m2": upper_level(radius + error, error),
            "reach_m": bounds.reach_m,
            "stated": bounds.bounds.model_dump(),
        }
    for j, (budget, reach) in network.exits.items():
        needed, least = (back_after_s(network, j, away) for away in (reach, 0.0))
        exits[names[j]] = {
            "budget_s": budget,
            "reach_m": reach,
            "back_from_reach_s": needed,
            "leaves": least <= budget,
            "verdict": "certified",
            "reason": f"it turns back while it can be back in {budget:g} s: from {reach:g} m out in {needed:.3g} s"
            if least <= budget
            else f"it never leaves: even from its border it needs {least:.3g} s to be surely inside again",
        }
    return {"agents": agents, "exits": exits}


def back_after_s(network: Network, j: int, away_m: float) -> float:
    """Return how long agent ``j`` needs back from ``away_m`` beyond its region, with two decisions, s."""
    control = network.scenario.controller
    guard = network.own_error_m(j) + 0.5 * control.region_margin_m
    return back_s(away_m + guard, control) + 2.0 / network.scenario.run.decision_hz


def own_pose_assumptions(network: Network) -> list[str]:
    """Return what the figures of own poses and exits rest on, in words."""
    names, out = [agent.name for agent in network.scenario.agents], []
    for j, b in network.outages.items():
        s = b.bounds
        out.append(
            f"agent {names[j]}: an outage begins within {s.position_m:g} m and {s.heading_rad:g} rad of the truth, "
            "with "
            f"{100 * s.scale:g} % of scale and {s.gyro_bias_radps:g} rad/s of gyro bias unlearned at most; "
            "accumulated noise "
            f"stays within {s.sigmas:g} standard deviations; it lasts {network.outage_s(j):g} s at most; height and "
            "tilt are "
            "known"
        )
    if network.exits:
        out.append(
            "agents beyond their regions keep the speed of their references, less d_bar_mps, on the way back"
        )
    return out
