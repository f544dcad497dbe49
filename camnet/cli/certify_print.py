"""What ``camnet certify`` prints: the promise, the claims, what fails, and the transitions."""

from __future__ import annotations

from typing import Any

__all__ = ["print_certificate"]

#: transitions that are printed
_MOST_ROWS = 40


def print_certificate(content: dict[str, Any]) -> None:
    """Print a report, the verdict first."""
    network, promise, claims = content["network"], content["promise"], content["claims"]
    print(f"PROMISE {promise['verdict'].upper()}: {promise['sentence']}")
    for words in promise["reasons"]:
        print(f"  - {words}")
    for camera in promise["blind_cameras"]:
        print(f"  camera {camera['name']} sees none of the ways: {camera['reason']}")
    first = promise["into_first_view"]
    if first is not None and first["length_m"] is not None:
        print(f"  way into the first view: at most {first['length_m']:.1f} m, {first['time_s']:.1f} s")
    print(
        f"\n{network.get('name', 'network')}: {network['cameras']} cameras, {network['regions']} operating regions; "
        f"targets: {content['target_class']}"
    )
    print(f"\nunseen, how long out of view: {claims['unseen']['verdict']}")
    print("estimate, whether it survives that:")
    for name, part in claims["estimate"].items():
        print(f"  {name}: {part['verdict']}\n    {part['reason']}")
        if part.get("dwell_times", part["reason"]) != part["reason"]:
            print(f"    dwell times of the estimator: {part['dwell_times']}")
    _print_transitions(content["transitions"])
    if "own_pose" in content:
        _print_own_poses(content["own_pose"])
    if "structure" in content:
        _print_structure(content["structure"])
    if "recorded" in content:
        _print_recorded(content["recorded"])
    needed = content.get("required")
    if needed is not None:
        what = "reached" if needed["reached"] else "NOT reached: " + ", ".join(needed["missed"])
        print(f"\nrequired ({', '.join(needed['claims'])}): {what}")


def _print_own_poses(own: dict[str, Any]) -> None:
    for name, a in own["agents"].items():
        print(
            f"\nagent {name} without external pose for {a['outage_s']:g} s: off by at most {a['bound_m']:.3g} m (95 %: "
            f"{a['likely_m']:.3g} m), which leaves {a['radius_left_m']:.3g} m of its view's {a['view_radius_m']:.3g} m"
        )
    for name, x in own["exits"].items():
        print(f"\nagent {name} may leave its region for {x['budget_s']:g} s: {x['verdict']} ({x['reason']})")


def _print_structure(structure: dict[str, Any]) -> None:
    names = ("published", "repaired", "sound", "learned")
    print("\ndwell times of structure from motion, s" + "".join(f"{name:>11s}" for name in names))
    for what, row in structure["dwell_times"].items():
        cells = (_seconds(row.get(name)) for name in names)
        print(f"  {what.replace('_', ' '):36s} " + "".join(f"{cell:>11s}" for cell in cells))
    allowed = structure["allowed_off_s"]
    if allowed is not None:
        verdicts = ", ".join(f"{name} {verdict}" for name, verdict in structure["verdicts"].items())
        print(f"  target out of view for {allowed:g} s: {verdicts}")


def _seconds(time: dict[str, Any] | None) -> str:
    if time is None:
        return "-"
    return "none" if time["seconds"] is None else f"{time['seconds']:.3g}"


def _print_recorded(r: dict[str, Any]) -> None:
    later, rides = r["held_out"], r["rides"]
    print(
        f"\nrecorded people: {r['people']} with {r['fixes']} fixes, {r['faster_than_v_max']} steps between them are "
        f"faster than {r['v_max_mps']:g} m/s\n"
        f"  error of a fix: at most {r['fix_error_m']:.3g} m ({r['fix_error_source']})\n"
        f"  out of their reachable set: {later['outside']} of {later['unseen']} unseen fixes"
        f"{'' if r['fix_error_source'] == 'stated' else ' recorded later'}, {r['outside']} of all {r['unseen']}\n"
        f"  nobody leaves from an error of {r['least_fix_error_m']:.4g} m on (exact fixes: v_max "
        f"{r['least_v_max_mps']:.3g} m/s)\n"
        f"  longest jump beyond v_max {r['longest_jump_m']:.0f} m; {rides['count']} stretches of three steps or more "
        f"above {1.5 * r['v_max_mps']:g} m/s, median {rides['median_mps']:.1f}, most {rides['fastest_mps']:.1f} m/s\n"
        "  error m  fixes outside  people outside"
    )
    for row in r["table"]:
        print(f"  {row['fix_error_m']:7g}  {row['outside']:13d}  {row['people_outside']:14d}")


def _print_transitions(transitions: list[dict[str, Any]]) -> None:
    if not transitions:
        print("\nno transition between two views was found")
        return
    print(
        f"\n{'transition':32s} {'gap m':>8s}  {'unseen':15s} {'learned':15s} {'margin s':>9s} {'margin m':>9s}  binding"
    )
    worst = sorted(transitions, key=_margin)
    for t in worst[:_MOST_ROWS]:
        part = _deciding(t)
        print(
            f"{t['from'] + ' > ' + str(t['to']):32.32s} {t['gap_m']:8.2f}  {_verdict(t, 'unseen'):15s} "
            f"{_verdict(t, 'learned'):15s} {_text(part.get('margin_s')):>9s} "
            f"{_text(part.get('margin_m')):>9s}  {part.get('binding', '')}"
        )
    if len(transitions) > _MOST_ROWS:
        print(f"... the worst {_MOST_ROWS} of {len(transitions)}; --json or --out give all")


def _deciding(transition: dict[str, Any]) -> dict[str, Any]:
    """Return the claim whose margin is printed: ``unseen``, unless only others were asked about."""
    for name in ("unseen", "learned", "sound"):
        if name in transition:
            return dict(transition[name])
    return {}


def _margin(transition: dict[str, Any]) -> float:
    value = _deciding(transition).get("margin_m")
    return -1e9 if value is None else float(value)


def _text(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"


def _verdict(transition: dict[str, Any], name: str) -> str:
    return str(transition.get(name, {}).get("verdict", "-"))
