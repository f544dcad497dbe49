"""What the figures of the moving-target experiment are held against."""

from __future__ import annotations

from typing import Any

__all__ = ["acceptance"]


def acceptance(content: dict[str, Any]) -> list[dict[str, Any]]:
    """Every figure beside its limit; a figure that is missing is not reached."""
    scale, seen, never = content["scale"], content["seen"], content["never_at_rest"]

    def gap(part: str, name: str, key: str) -> float | None:
        row = content[part].get(name)
        return None if row is None else float(row[key])

    def share(part: str, name: str, of: float) -> float | None:
        other = gap(part, name, "median_m")
        return None if other is None else of * other

    replay = "replay", "median_m"
    rows: list[tuple[str, float | None, float | None]] = [
        ("identities, largest error", content["identities_max_error"], 1e-10),
        ("scale at rest, RMS %", scale["rms_pct"], 0.6),
        ("the same, odometry scale 1 %", scale["rms_pct_odometry_1pct"], 1.6),
        ("shape, mm", scale["shape_mm"], 4.0),
        ("seen: position, m", seen["position_m"], seen["position_bound_m"]),
        ("seen: velocity, m/s", seen["velocity_mps"], 0.035),
        ("seen: heading, degrees", seen["heading_deg"], 0.8),
        ("gaps: replay, median m", gap("gaps", *replay), 0.12),
        ("gaps: replay, 90 % m", gap("gaps", "replay", "p90_m"), 0.25),
        ("5 % of constant velocity", gap("gaps", *replay), share("gaps", "constant_velocity", 0.05)),
    ]
    for part in ("first_lap", "varied_speed", "branch"):
        words = f"{part.replace('_', ' ')}: replay, coordinated turn, median m"
        rows.append((words, gap(part, *replay), share(part, "coordinated_turn", 1.0)))
    rows += [
        ("never at rest, 30 s, RMS %", never["30s_pct"], 3.0),
        ("never at rest, 150 s, RMS %", never["150s_pct"], 1.5),
    ]
    out = []
    for what, value, limit in rows:
        reached = value is not None and limit is not None and value <= limit
        out.append({"what": what, "value": value, "limit": limit, "reached": reached})
    holds = content["branch"].get("holds_true_share")
    reached = holds is not None and holds >= 0.9
    out.append(
        {
            "what": "branch: futures hold the true one, at least",
            "value": holds,
            "limit": 0.9,
            "reached": reached,
        }
    )
    return out
