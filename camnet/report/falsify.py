"""The page of an attack in the closed loop: the verdict first, the worst that was found, and what was used up."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from camnet.report.html import table, write_page
from camnet.report.markup import shown

__all__ = ["write_attack_page"]

#: figures of a promise: what they are, and their unit
_FIGURES = {
    "unseen_m": ("out of view", "m"),
    "unseen_s": ("out of view", "s"),
    "unseen_way_m": ("out of view between two regions", "m"),
    "error_m": ("error of the estimate when seen again", "m"),
}
_ASSUMPTIONS = (
    "<p>Shares of what is assumed: above 1 an assumption did not hold, whatever became of the promise. Flags are 0 or "
    "1; targets at once in one region are counted.</p>"
)


def write_attack_page(path: Path, content: dict[str, Any]) -> None:
    """Write the page of ``result.json``'s content, of a search or of a replay."""
    world, broken = str(content["world"]), bool(content["violations"])
    style = (
        ' class="warn"' if broken else ' style="background:#e6f4ea;padding:.6rem 1rem;border-radius:.4rem"'
    )
    body = [
        f"<h1>{shown(world)}: the promise {'is broken' if broken else 'held'}</h1>",
        f"<p{style}><b>{shown(_verdict(content))}</b></p>",
        *_changes(content),
        "<h2>The worst that was found</h2>",
        _worst(content["worst"]),
    ]
    used = content.get("assumptions") or {}
    if used:
        nearest = content.get("nearest_to_breaking")
        rows = [
            (name, share, "nearest to breaking" if name == nearest else "") for name, share in used.items()
        ]
        body += ["<h2>Assumptions</h2>", _ASSUMPTIONS, table(("assumption", "used up", ""), rows)]
    if "replayed" not in content:
        body += [
            "<h2>Fly the worst again</h2><p><code>camnet falsify "
            f"{shown(world)} --closed-loop --replay attack.json</code> gives the same figures.</p>"
        ]
    write_page(path, f"camnet: attack on {world}", "\n".join(body))


def _verdict(content: dict[str, Any]) -> str:
    if "replayed" in content:
        same = "with the same figures" if content["same"] else "WITH OTHER FIGURES than were written down"
        return (
            f"One attack flown again, {same}: {', '.join(content['broken']) or 'nothing'} beyond the promise."
        )
    end = ", as the time was over" if content["out_of_time"] else ""
    share = content["closest_fraction"]
    closest = "" if share is None else f" The closest came to {share:.1%} of what is promised."
    return (
        f"{content['violations']} of {content['trials']} hostile flights{end} break the promise; "
        f"{content['stretches']} stretches out of view were judged by the truth alone.{closest}"
    )


def _changes(content: dict[str, Any]) -> list[str]:
    """Return which assumptions were falsified on request."""
    changed = content.get("violate") or {}
    if not changed:
        return []
    words = ", ".join(f"{name} times {factor:g}" for name, factor in changed.items())
    return [
        f"<p>Flown in another world than the one certified, to see whether that is found: {shown(words)}.</p>"
    ]


def _worst(worst: dict[str, dict[str, Any]]) -> str:
    head = ("figure", "occurred", "promised", "margin", "target", "where")
    rows = []
    for name, w in worst.items():
        words, unit = _FIGURES[name]
        promised = "nothing" if w["promised"] is None else f"{w['promised']:.3g} {unit}"
        margin = "–" if w["margin"] is None else f"{w['margin']:.3g} {unit}"
        where = f"from {w['from_s']:.1f} s on"
        if "from" in w:
            where += f", {w['from']} to {w['to']}"
        if w.get("into_first_view"):
            where += ", into the first view"
        rows.append((words, f"{w['value']:.3g} {unit}", promised, margin, w["target"], where))
    return table(head, rows) if rows else "<p>Nothing was out of view.</p>"
