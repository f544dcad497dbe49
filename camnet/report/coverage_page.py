"""The page of a coverage report: the figures first, then maps, areas, blind spots, cameras and assumptions."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from camnet.report.html import picture, table, write_page
from camnet.report.markup import shown

__all__ = ["headline", "write_coverage_page"]

#: blind spots on the page; the JSON file has more
_MOST_SPOTS = 12
_STANDARD = (
    "<p>Classes of EN 62676-4:2015: pixels on a metre that is perpendicular to the line of sight. Later editions may "
    "divide and name them differently.</p>"
)


def headline(report: dict[str, Any]) -> str:
    """Return the result in one sentence."""
    ground, roads = report["ground"], report["roads"]
    quality = "" if report["class"] is None else f" well enough to {report['class']}"
    words = f"{report['cameras']} cameras see {ground['seen_share']:.1%} of {ground['m2']:,.0f} m2 of ground{quality}"
    if roads is not None:
        words += f", and the whole width of {roads['seen_share']:.1%} of {roads['m']:,.0f} m of road"
    return words + "."


def write_coverage_page(folder: Path, report: dict[str, Any]) -> None:
    """Write ``report.html`` into a folder that has the maps already."""
    body = [
        f"<h1>{shown(report['site'])}: coverage</h1><p><b>{shown(headline(report))}</b></p>",
        _figures(report),
    ]
    if report["warnings"]:
        items = "".join(f"<li>{shown(words)}</li>" for words in report["warnings"])
        body.append(f'<ul class="warn">{items}</ul>')
    body += ["<h2>Blind spots</h2>", picture(folder / "map.png", "map of blind spots"), _spots(report)]
    body += ["<h2>By how many cameras</h2>", _counts(report)]
    if report["classes"] is not None:
        head = ("class", "pixels per metre, at least", "ground", "road")
        rows = [
            (c["class"], c["px_per_m"], _percent(c["ground_share"]), _percent(c["road_share"]))
            for c in report["classes"]
        ]
        body += [
            "<h2>Pixels per metre</h2>",
            table(head, rows),
            _STANDARD,
            picture(folder / "pixels.png", "map of pixels per metre"),
        ]
    if report["areas"]:
        rows = [(a["name"], a["m2"], a["seen_m2"], _percent(a["seen_share"])) for a in report["areas"]]
        body += ["<h2>Areas</h2>", table(("area", "ground (m2)", "seen (m2)", "seen"), rows)]
    body += ["<h2>Cameras</h2>", _cameras(report)]
    items = "".join(f"<li>{shown(words)}</li>" for words in report["assumptions"])
    body += [f"<h2>Assumptions</h2><ul>{items}</ul>"]
    write_page(folder / "report.html", f"camnet: coverage of {report['site']}", "\n".join(body))


def _figures(report: dict[str, Any]) -> str:
    ground, roads = report["ground"], report["roads"]
    figures = [(_percent(ground["seen_share"]), "of the ground seen")]
    if roads is not None:
        figures.append((_percent(roads["seen_share"]), "of the road seen"))
    twice = sum(row["share"] for row in ground["by_cameras"] if row["cameras"] >= 2)
    figures += [
        (_percent(twice), "of the ground seen by two cameras or more"),
        (f"{ground['m2'] - ground['seen_m2']:,.0f} m2", f"unseen, in {_spots_words(report)}"),
        (str(report["cameras"]), "cameras"),
    ]  # fmt: skip
    blocks = "".join(f"<div><b>{shown(a)}</b>{shown(b)}</div>" for a, b in figures)
    return f'<div class="figures">{blocks}</div>'


def _spots_words(report: dict[str, Any]) -> str:
    count = report["blind_spots_count"]
    return f"{count} blind spot" if count == 1 else f"{count} blind spots"


def _spots(report: dict[str, Any]) -> str:
    spots = report["blind_spots"]
    if not spots:
        return "<p>None.</p>"
    rows = [(k + 1, s["m2"], s["x_m"], s["y_m"]) for k, s in enumerate(spots[:_MOST_SPOTS])]
    more = report["blind_spots_count"] - len(rows)
    words = f"<p>{more} smaller ones: see coverage.json.</p>" if more > 0 else ""
    return table(("the largest", "size (m2)", "x inside (m)", "y inside (m)"), rows) + words


def _counts(report: dict[str, Any]) -> str:
    ground = report["ground"]["by_cameras"]
    roads = [] if report["roads"] is None else report["roads"]["by_cameras"]
    rows = []
    for k in range(max(len(ground), len(roads))):
        row = [str(k)]
        for of, unit in ((ground, "m2"), (roads, "m")):
            found = of[k] if k < len(of) else None
            row += [
                "–" if found is None else f"{found[unit]:,.1f}",
                "–" if found is None else _percent(found["share"]),
            ]
        rows.append(row if roads else row[:3])
    head = ("cameras", "ground (m2)", "share", "road (m)", "share")
    return table(head if roads else head[:3], rows)


def _cameras(report: dict[str, Any]) -> str:
    rows = []
    for c in report["camera_list"]:
        pixels = c["px_per_m"]
        rows.append(
            (
                c["name"],
                f"{c['x_m']:.1f}",
                f"{c['y_m']:.1f}",
                f"{c['z_m']:.1f}",
                "–" if c["pan_deg"] is None else f"{c['pan_deg']:.1f}",
                f"{c['tilt_deg']:.1f}",
                f"{c['counted_m2']:,.0f}",
                "–" if pixels is None else f"{pixels[0]:.3g} to {pixels[1]:.3g}",
            )
        )
    head = (
        "camera",
        "x (m)",
        "y (m)",
        "height (m)",
        "pan (deg)",
        "tilt (deg)",
        "sees (m2)",
        "pixels per metre",
    )
    words = "<p>Pan: anticlockwise from the x axis; tilt: below the horizon; seen: of what is counted.</p>"
    return words + table(head, rows)


def _percent(share: float | None) -> str:
    return "–" if share is None else f"{share:.1%}"
