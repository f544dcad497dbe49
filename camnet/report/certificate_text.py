"""What the page of a certificate says: the verdict first, what fails, then cameras, assumptions and theorems."""

from __future__ import annotations

from typing import Any

from camnet.report.html import table
from camnet.report.markup import shown

__all__ = ["page_head", "page_tail"]

_MAP = (
    "<h2>Map</h2><p>Blue: what cameras or agents can see of the ground; grey: occluders; pale lines: the ways; purple: "
    "cameras and where they look. Of the ways, "
    "green is out of view for no longer than allowed, red for longer. Hold the pointer over a line or a view "
    "for its details. Views "
    "farther from the site than its own size are left out. North is up where y points north; lengths are in metres.</p>"
)
_THEOREMS = (
    "<p>The published conditions ask a ball that grows at twice the target's top speed to fit a view before it is "
    "reached: views that do not overlap can never meet them, which reads <em>unsatisfiable</em> and says nothing about "
    "the layout. <em>sound</em> is the same argument with its errors repaired; its constants are conservative.</p>"
)


def page_head(report: dict[str, Any], title: str) -> list[str]:
    """Return the parts above the map: the verdict in words, what speaks against it, both claims."""
    network, promise = report["network"], report.get("promise")
    who = f"{shown(network['cameras'])} cameras, {shown(network['regions'])} operating regions"
    if promise is None:
        rows = [(k, v["verdict"], v["reason"]) for k, v in report["certificates"].items()]
        return [
            f"<h1>{shown(title)}</h1><p>{who}; targets: {shown(report['target_class'])}</p>",
            table(("certificate", "verdict", "reason"), rows),
            _MAP,
        ]
    good = promise["verdict"] == "certified"
    style = ' style="background:#e6f4ea;padding:.6rem 1rem;border-radius:.4rem"' if good else ' class="warn"'
    body = [
        f"<h1>{shown(title)}: {shown(promise['verdict'])}</h1>",
        f"<p{style}><b>{shown(_capital(promise['sentence']))}</b></p>",
    ]
    if promise["reasons"]:
        body.append(
            "<h2>What fails</h2><ul>" + "".join(f"<li>{shown(r)}</li>" for r in promise["reasons"]) + "</ul>"
        )
        body += _remedies(report, title)
    blind = promise["blind_cameras"]
    if blind:
        unseeing = [(c["name"], c["reason"]) for c in blind]
        body += ["<h2>Cameras that see none of the ways</h2>", table(("camera", "likely reason"), unseeing)]
    body += [
        "<h2>Claims</h2>",
        table(("claim", "verdict", "in words"), _claims(report)),
        f"<p>{who}.</p>",
        _MAP,
    ]
    return body


def _remedies(report: dict[str, Any], title: str) -> list[str]:
    """Return the table of ways that are out of view for too long, each with what would be enough, the worst first."""
    bad = [t for t in report["transitions"] if t.get("unseen", {}).get("verdict", "certified") != "certified"]
    rows = []
    for t in sorted(bad, key=lambda t: _margin(t["unseen"])):
        lacks_m, lacks_s = t["unseen"]["margin_m"], t["unseen"]["margin_s"]
        over = [
            f"{-v:.1f} {unit}" for v, unit in ((lacks_m, "m"), (lacks_s, "s")) if v is not None and v < 0.0
        ]
        longest = t.get("longest_m")
        out = "without end" if longest is None else f"{longest:.1f} m"
        rows.append((f"{t['from']} → {t['to']}", out, ", ".join(over) or "–", _remedy(t)))
    if not rows:
        return []
    head = ("way between two views", "out of view", "too long by", "nearest remedy")
    more = f"<p>{len(rows)} ways in all; the worst {_MOST_REMEDIES} are listed.</p>"
    found = [table(head, rows[:_MOST_REMEDIES]), more if len(rows) > _MOST_REMEDIES else ""]
    if report["network"]["regions"] == 0 and report.get("cameras"):
        found.append(
            f"<p>Which cameras to turn, move or add: <code>camnet design --repair {shown(title)}</code> (the world's "
            "file) finds the cheapest change that is enough, and writes the world after it.</p>"
        )
    return found


#: most rows of the table of remedies
_MOST_REMEDIES = 20


def _margin(unseen: dict[str, Any]) -> float:
    known = [v for v in (unseen["margin_m"], unseen["margin_s"]) if v is not None]
    return min(known, default=float("-inf"))


def _remedy(t: dict[str, Any]) -> str:
    """Return what would be enough for one way, in words."""
    unseen = t["unseen"]
    lacks_m, lacks_s, longest = unseen["margin_m"], unseen["margin_s"], t.get("longest_m")
    if longest is None:
        return "see one place of every circle of unseen roads"
    if unseen["binding"] == "time in view":
        return f"widen the view of {t['to']}: it is in view for too short a time"
    if lacks_m is not None and lacks_m < 0.0:
        return f"see {-lacks_m:.1f} m more of it, from either end, or any place that leaves {longest + lacks_m:.1f} m"
    if lacks_s is not None and lacks_s < 0.0:
        return f"see what the target passes in {-lacks_s:.1f} s more of it, from either end"
    return str(unseen["binding"])


def _claims(report: dict[str, Any]) -> list[tuple[str, str, str]]:
    claims = report["claims"]
    learned = claims["estimate"]["learned"]
    return [
        (
            "unseen: how long out of view",
            claims["unseen"]["verdict"],
            "decides the exit status; see --require",
        ),
        ("estimate survives that: learned", learned["verdict"], learned["reason"]),
    ]


def page_tail(report: dict[str, Any]) -> list[str]:
    """Return the parts below the transitions: cameras, assumptions, and the theorems last."""
    body = []
    cameras = report.get("cameras")
    if cameras:
        head = ("camera", "x (m)", "y (m)", "height (m)", "pan (deg)", "tilt (deg)", "sees (m2)")
        keys = ("name", "x_m", "y_m", "z_m", "pan_deg", "tilt_deg", "ground_m2")
        body += [
            "<h2>Cameras</h2><p>Pan: anticlockwise from the x axis; tilt: below the horizon.</p>",
            table(head, [tuple(c[k] for k in keys) for c in cameras]),
        ]
    if report.get("structure"):
        body += _structure(report["structure"])
    if report.get("assumptions"):
        items = "".join(f"<li>{shown(a)}</li>" for a in report["assumptions"])
        body.append(f"<h2>Assumptions</h2><ul>{items}</ul>")
    if report.get("promise") is not None:
        estimate = report["claims"]["estimate"]
        rows = [
            (k, estimate[k]["verdict"], estimate[k]["reason"])
            for k in ("published", "sound")
            if k in estimate
        ]
        body += ["<h2>Published theorems</h2>", _THEOREMS, table(("certificate", "verdict", "reason"), rows)]
    return body


def _structure(structure: dict[str, Any]) -> list[str]:
    """Dwell times of agents that learn structure from their own motion."""
    names = ("published", "repaired", "sound", "learned")
    rows: list[tuple[object, ...]] = []
    reasons = []
    for what, row in structure["dwell_times"].items():
        words = what.replace("_", " ")
        cells = [row[n]["seconds"] if row[n]["seconds"] is not None else "none" for n in names if n in row]
        there = iter(cells)
        rows.append((words, *(next(there) if n in row else "" for n in names)))
        reasons += [f"{words}, {n}: {row[n]['reason']}" for n in names if n in row and row[n]["reason"]]
    items = "".join(f"<li>{shown(r)}</li>" for r in reasons)
    return [
        "<h2>Dwell times of structure from motion</h2>"
        "<p>bell2019, chapters 4 and 5: least times in view, and longest times out of view, s.</p>",
        table(("", *names), rows),
        f"<ul>{items}</ul>" if items else "",
    ]


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]
