"""Recorded walks as GPX."""

from __future__ import annotations

from random import Random

from robustness import inputs
from robustness.case import Case, Nature, changed
from robustness.formats import write_gpx
from robustness.stage import COMMANDS
from robustness.text import bad_number, broken_text, same_number

__all__ = ["BROKEN", "HARMLESS", "MEANING"]

_FILE = "walk.gpx"
_COMMAND = COMMANDS["simulate gpx"]


def _case(label: str, content: str, *mentions: str) -> Case:
    return changed("gpx", label, Nature.MEANING, _COMMAND, _FILE, content, *(mentions or (_FILE,)))


def _number(rng: Random) -> Case:
    points, (label, bad) = inputs.gpx(), bad_number(rng)
    k = rng.randrange(12)
    lat, lon, t = points[k]
    points[k] = (bad, lon, t) if rng.random() < 0.5 else (lat, bad, t)
    return _case(f"number: {label}", write_gpx(points), f"line {k + 2}")


def _place(rng: Random) -> Case:
    points = inputs.gpx()
    way = rng.choice(
        ("swapped", "off the Earth", "another continent", "minutes for degrees", "sign", "one fix astray")
    )
    if way == "swapped":
        points = [(lon, lat, t) for lat, lon, t in points]
    elif way == "off the Earth":
        points[rng.randrange(12)] = (
            str(rng.choice((-1, 1)) * rng.uniform(90.5, 1e5)),
            "11.0",
            "2020-05-01T13:00:00Z",
        )
    elif way == "another continent":
        points = [(f"{float(lat) - rng.uniform(2, 40)}", lon, t) for lat, lon, t in points]
    elif way == "minutes for degrees":
        points = [(f"{float(lat) * 0.6:.8f}", lon, t) for lat, lon, t in points]
    elif way == "sign":
        points = [(lat, f"-{lon}", t) for lat, lon, t in points]
    else:  # a jump that no target of this class makes
        k = rng.randrange(1, 12)
        points[k] = (f"{float(points[k][0]) + rng.uniform(0.001, 0.01):.8f}", *points[k][1:])
    return _case(way, write_gpx(points), _FILE, "v_max_mps")


def _time(rng: Random) -> Case:
    points: list[tuple[str, str, str | None]] = list(inputs.gpx())
    k = rng.randrange(12)
    lat, lon, t = points[k]
    assert t is not None
    bad = rng.choice(
        (None, "", t[:-1], "noon", "2020-13-01T12:00:00Z", "2020-05-01T25:00:00Z", "2020-05-01", "01/05/2020 12:00",
         "1588334400", t.replace("-", "/"), t.replace("T", "t_"), "\u0662\u0660" + t[2:])
    )  # fmt: skip
    points[k] = (lat, lon, bad)
    return _case("time", write_gpx(points), _FILE)


def _time_unit(rng: Random) -> Case:
    """All within a second: times without their fractions in another format."""
    points = [(lat, lon, f"2020-05-01T12:00:00.{k:03d}Z") for k, (lat, lon, _) in enumerate(inputs.gpx())]
    return _case("times too dense", write_gpx(points), "v_max_mps")


def _structure(rng: Random) -> Case:
    points = inputs.gpx()
    text = write_gpx(points)
    ways = {
        "another name": write_gpx(points, rng.choice(("b", "A", "aa", "<![CDATA[c]]>"))),
        "route": text.replace("trkpt", "rtept")
        .replace("trkseg", "rte2")
        .replace("<trk>", "<rte>")
        .replace("</trk>", "</rte>"),
        "waypoints": text.replace("trkpt", "wpt"),
        "no point": write_gpx([]),
        "no longitude": text.replace(" lon=", " long=", 1),
        "no latitude": text.replace("<trkpt lat=", "<trkpt latitude=", 1),
        "another format": text.replace("gpx", "kml"),
        "two tracks of a name": text.replace("</gpx>", text[text.index("<trk>") :]).replace(
            "<name>a<", "<name>c<", 1
        ),
    }
    label = rng.choice(sorted(set(ways) - {"two tracks of a name"}))
    return _case(label, ways[label], _FILE)


MEANING = [_number, _number, _place, _place, _time, _time, _time_unit, _structure]


def _broken(rng: Random) -> Case:
    text = write_gpx(inputs.gpx())
    bomb = "".join(f'<!ENTITY e{k + 1} "{f"&e{k};" * 10}">' for k in range(9))
    ways = {
        "entities": f'<!DOCTYPE gpx [<!ENTITY e0 "aaaaaaaaaa">{bomb}]>{text.replace("<name>a", "<name>&e9;")}',
        "outside entity": f'<!DOCTYPE gpx [<!ENTITY x SYSTEM "file:///etc/passwd">]>{text.replace(">a<", ">&x;<")}',
        "deep": text.replace("<name>", "<x>" * 5000 + "</x>" * 5000 + "<name>", 1),
        "tag": text.replace("</trkpt>", "", 1),
        "ampersand": text.replace("<name>a", "<name>a & b", 1),
        "encoding": f'<?xml version="1.0" encoding="klingon"?>{text}',
        "two roots": text + text,
    }
    label = rng.choice([*ways, "text", "text", "text"])
    if label == "text":
        label, content = broken_text(rng, text, 0.0, 0.9)
        if label == "UTF-16":  # with a mark XML may be written so
            content = text.encode("utf-32-le")
        return changed("gpx", label, Nature.BROKEN, _COMMAND, _FILE, content, _FILE)
    return changed("gpx", label, Nature.BROKEN, _COMMAND, _FILE, ways[label], _FILE)


def _rewritten(rng: Random) -> Case:
    points: list[tuple[str, str, str | None]] = []
    for k, (lat, lon, t) in enumerate(inputs.gpx()):
        zone = rng.choice(
            (t, t, f"2020-05-01T14:00:{k:02d}+02:00", f"2020-05-01T08:30:{k:02d}-03:30", f"{t[:-1]}.000Z")
        )
        points.append((same_number(rng, float(lat)), same_number(rng, float(lon)), zone))
    if rng.random() < 0.4:
        rng.shuffle(points)
    if rng.random() < 0.3:
        points.append(points[rng.randrange(12)])
    more = rng.choice(("", "", "<ele>12.5</ele>", "<extensions><hr>120</hr></extensions>", "<sat>7</sat>"))
    text = write_gpx(points, rng.choice(("a", " a ", "<![CDATA[a]]>")), more)
    if rng.random() < 0.3:
        text = text.replace("<trk>", '<metadata><name>b</name></metadata><wpt lat="1" lon="2"/><trk>', 1)
    if rng.random() < 0.3:
        text = text.replace("\n", "\r\n" if rng.random() < 0.5 else "\n<!-- a walk -->\n\n")
    if rng.random() < 0.3:
        text = text.replace(' lat="', "\n lat='", 1).replace('" lon=', "'  lon=", 1)
    if rng.random() < 0.3:
        text = '<?xml version="1.0" encoding="UTF-8"?>\n' + text
    content = text.encode("utf-16") if rng.random() < 0.1 and "encoding" not in text else text.encode()
    return changed("gpx", "rewritten", Nature.HARMLESS, _COMMAND, _FILE, content)


BROKEN = [_broken]
HARMLESS = [_rewritten]
