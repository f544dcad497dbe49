"""Random handoff environments, for Hypothesis (extra ``test``).

>>> from hypothesis import given
>>> from camnet.env import conformance, handoff_v0, strategies
>>> @given(strategies.environments())
... def test_conforms(options):
...     conformance.check_containment(lambda: handoff_v0.parallel_env(**options), episodes=1)
"""

from __future__ import annotations

import math
from typing import Any

from hypothesis import strategies as st

from camnet.config.models import Scenario
from camnet.simulation.filters import FILTERS

__all__ = ["environments", "scenarios"]

#: distance between the middles of two neighbouring regions, m; regions stay within half of it
_PITCH_M = 4.4
_LENS = {"width_px": 320, "height_px": 240, "fx_px": 210.0, "fy_px": 210.0, "cx_px": 160.0, "cy_px": 120.0}


def _number(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(low, high, allow_nan=False)


@st.composite
def _shapes(draw: st.DrawFn, x: float, y: float) -> dict[str, Any]:
    """Draw a region of any kind about (x, y)."""
    h, top = draw(_number(0.9, 2.0)), draw(_number(1.5, 5.0))
    kind = draw(st.sampled_from(("box", "cylinder", "polytope", "extruded_polygon", "ell")))
    if kind == "box":
        return {"type": "box", "min_m": (x - h, y - h, 0.0), "max_m": (x + h, y + h, top)}
    if kind == "cylinder":
        return {"type": "cylinder", "center_m": (x, y), "radius_m": h, "z_m": (0.0, top)}
    corners = [(x - h, y - h), (x + h, y - h), (x + h, y + h), (x - h, y + h)]
    if kind == "polytope":
        below = [(a, b, 0.0) for a, b in corners]
        above = [(x + 0.8 * (a - x), y + 0.8 * (b - y), top) for a, b in corners]
        return {"type": "polytope", "vertices_m": below + above}
    if kind == "ell":  # not convex
        corners = [corners[0], corners[1], (x + h, y), (x, y), (x, y + h), corners[3]]
    return {"type": "extruded_polygon", "vertices_m": corners, "z_m": (0.0, top)}


@st.composite
def _targets(draw: st.DrawFn, index: int, loop_m: float) -> dict[str, Any]:
    """Draw a target: on the loop, on the loop's road at random, or on a field of its own."""
    speed = draw(_number(0.1, 0.5))
    kind = draw(st.sampled_from(("loop", "wave", "road")))
    if kind == "road":
        motion: dict[str, Any] = {"kind": "road", "road": "loop", "speed_mps": (0.5 * speed, speed)}
    else:
        motion = {
            "kind": "vector_field",
            "field": kind,
            "speed_mps": speed,
            "scale_m": draw(_number(2.0, 4.0)),
        }
        if kind == "loop":
            motion["road"] = "loop"
        else:
            angle = draw(_number(0.0, 6.2))
            motion["center_m"] = (loop_m * math.cos(angle), loop_m * math.sin(angle))
    return {"name": f"target_{index}", "motion": motion}


@st.composite
def scenarios(draw: st.DrawFn) -> Scenario:
    """Draw a small network: 1 to 6 agents, 0 to 2 fixed cameras, 1 to 3 targets."""
    n = draw(st.integers(1, 6))
    loop_m = max(3.0, _PITCH_M / (2.0 * math.sin(math.pi / max(n, 2))) * 1.05)
    middles = [
        (loop_m * math.cos(2 * math.pi * k / n), loop_m * math.sin(2 * math.pi * k / n)) for k in range(n)
    ]
    road = [
        (loop_m * math.cos(2 * math.pi * k / 12), loop_m * math.sin(2 * math.pi * k / 12)) for k in range(12)
    ]
    lens = {
        "name": "lens",
        "intrinsics": _LENS,
        "near_m": draw(_number(0.1, 0.4)),
        "far_m": draw(_number(3.0, 9.0)),
    }
    fixed = [
        {
            "name": f"mast_{k}",
            "camera": "lens",
            "pose": {"position_m": (*road[draw(st.integers(0, 11))], 4.0), "quaternion_wxyz": (0, 1, 0, 0)},
        }
        for k in range(draw(st.integers(0, 2)))
    ]
    return Scenario.model_validate(
        {
            "name": "random",
            "cameras": [lens],
            "regions": [{"name": f"region_{k}", "shape": draw(_shapes(*p))} for k, p in enumerate(middles)],
            "agents": [{"name": f"camera_{k}", "region": f"region_{k}", "camera": "lens"} for k in range(n)],
            "fixed_cameras": fixed,
            "roads": [{"name": "loop", "closed": True, "points_m": road}],
            "targets": [draw(_targets(k, loop_m)) for k in range(draw(st.integers(1, 3)))],
            "physics": {"actuation": draw(st.sampled_from(("quadrotor", "kinematic")))},
            "sensing": {
                "position_noise_m": draw(_number(0.0, 0.05)),
                "latency_s": draw(st.sampled_from((0.0, 0.1))),
                "dropout_probability": draw(_number(0.0, 0.5)),
            },
            "estimator": {"basis": {"spacing_m": 1.0, "width_m": 1.0}},
            "handoff": {"lookahead_s": draw(_number(5.0, 40.0))},
        }
    )


@st.composite
def environments(draw: st.DrawFn, max_cycles: int = 8) -> dict[str, Any]:
    """Draw options of `camnet.env.handoff_v0.parallel_env`: a random network shown in a random way."""
    world = draw(scenarios())
    names = [agent.name for agent in world.agents]
    doomed = draw(
        st.dictionaries(st.sampled_from(names), _number(0.0, 0.1 * max_cycles), max_size=len(names))
    )
    return {
        "world": world,
        "filter_name": draw(st.sampled_from(tuple(f for f in FILTERS if f in ("learned", "ekf", "ideal")))),
        "max_cycles": draw(st.integers(1, max_cycles)),
        "action_mode": draw(st.sampled_from(("setpoint", "velocity", "assign"))),
        "observation_form": draw(st.sampled_from(("flat", "dict"))),
        "region_guard": draw(st.booleans()),
        "neighbours": draw(st.integers(0, 4)),
        "communication_range_m": draw(_number(1.0, 50.0)),
        "message_delay_s": draw(st.sampled_from((0.0, 0.05, 0.3))),
        "message_loss": draw(st.sampled_from((0.0, 0.5, 1.0))),
        "failures": {"rate_per_s": draw(st.sampled_from((0.0, 0.5, 5.0))), "schedule_s": doomed},
        "lost_limit_s": draw(st.sampled_from((None, 0.3))),
        "terminate_on_collision": draw(st.booleans()),
    }
