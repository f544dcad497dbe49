"""What ``certify --check`` and ``design --check`` print."""

from __future__ import annotations

from typing import Any

__all__ = ["kept", "print_check"]

#: broken stretches that are printed
_MOST_ROWS = 20


def kept(content: dict[str, Any]) -> bool:
    """Whether the traffic of ``--check``, if any, broke nothing."""
    return str(content.get("check", {}).get("verdict", "kept")) == "kept"


def print_check(check: dict[str, Any]) -> None:
    """Print the report of ``check_traffic``."""
    total = sum(check["stretches"].values())
    print(
        f"\ntraffic: {check['vehicles']} vehicles, {total} unseen stretches, {check['broken']} of them too long"
    )
    print(f"  {'':22s} {'count':>7s} {'longest m':>10s} {'longest s':>10s}")
    for kind, count in check["stretches"].items():
        print(f"  {kind:22s} {count:7d} {check['longest_m'][kind]:10.1f} {check['longest_s'][kind]:10.1f}")
    if check["tightness"] is not None:
        print(f"  longest way in traffic over longest way allowed: {check['tightness']:.2f}")
    if check["inside_assumptions"] is not None:
        print(
            f"  inside the assumptions about time: {check['inside_assumptions']:.1%} of the stretches, "
            f"{check['vehicles_inside']:.1%} of the vehicles on all of theirs"
        )
    for name, row in check["assumptions"].items():
        found = row.get("smallest", row.get("largest"))
        if found is not None:
            holds = f"{row['proposed']:.3g} holds for 99 % of the vehicles"
            print(f"  {name}: {row['stated']:g} stated, {found:.3g} found, {holds}")
    for row in check["worst"][:_MOST_ROWS]:
        why = "; ".join(row["assumptions_failed"]) or "no stated assumption failed"
        (x0, y0), (x1, y1) = row["from_xy"], row["to_xy"]
        print(
            f"  vehicle {row['vehicle']}, {row['kind']}: {row['unseen_m']:.1f} m, {row['unseen_s']:.1f} s from "
            f"({x0:.1f}, {y0:.1f}) at {row['from_s']:.1f} s to ({x1:.1f}, {y1:.1f}): {why}"
        )
    if len(check["worst"]) > _MOST_ROWS:
        print(f"  ... the worst {_MOST_ROWS} of {check['broken']}; --json or --out give more")
