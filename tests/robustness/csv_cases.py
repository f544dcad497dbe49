"""Tables of recorded positions."""

from __future__ import annotations

import gzip
from random import Random

from robustness import inputs
from robustness.case import Case, Command, Nature, changed
from robustness.stage import COMMANDS
from robustness.text import bad_number, broken_text, misspelt, same_number

__all__ = ["BROKEN", "HARMLESS", "MEANING"]

_HEAD = ["id", "t_s", "x_m", "y_m"]
_READERS = (("design tracks", "people.csv"), ("simulate track", "walk.csv"))


def _reader(rng: Random) -> tuple[Command, str]:
    name, file = rng.choice(_READERS)
    return COMMANDS[name], file


def _rows() -> list[list[str]]:
    return [[str(value) for value in row] for row in inputs.fixes()]


def _text(rows: list[list[str]], head: list[str] | None = None, delimiter: str = ",") -> str:
    return "\n".join(delimiter.join(row) for row in [head or _HEAD, *rows]) + "\n"


def _case(rng: Random, label: str, content: str, *mentions: str) -> Case:
    command, file = _reader(rng)
    return changed("csv", label, Nature.MEANING, command, file, content, *(mentions or (file,)))


def _number(rng: Random) -> Case:
    rows, (label, bad) = _rows(), bad_number(rng)
    k, column = rng.randrange(len(rows)), rng.randrange(1, 4)
    quoted = f'"{bad}"' if "," in bad else bad
    rows[k][column] = quoted
    return _case(rng, f"number: {label}", _text(rows), f"line {k + 2}", "are these milliseconds")


def _header(rng: Random) -> Case:
    head = list(_HEAD)
    way = rng.randrange(4)
    if way == 0:  # a column that is needed
        k = rng.randrange(1, 4)
        head[k] = rng.choice(("distance", "value", "column", "speed", "weather"))
    elif way == 1:  # the same twice
        head[rng.randrange(2, 4)] = rng.choice(("t", "time", "timestamp"))
    elif way == 2:  # without a header
        return _case(rng, "no header", _text(_rows()[1:], _rows()[0]))
    else:
        return _case(rng, "header only", _text([]))
    return _case(rng, "header", _text(_rows(), head), "line 1")


def _identity_misspelt(rng: Random) -> Case:
    head = ["pedestrian", *_HEAD[1:]]
    head[0] = misspelt(rng, rng.choice(("pedestrian", "track_id", "vehicle", "person", "logger")), {"track"})
    return _case(rng, "identity misspelt", _text(_rows(), head), head[0])


def _row(rng: Random) -> Case:
    rows, k = _rows(), rng.randrange(32)
    way = rng.choice(("field lost", "field more", "identity empty"))
    if way == "field lost":
        del rows[k][rng.randrange(4)]
    elif way == "field more":
        rows[k].insert(rng.randrange(4), "1")
    else:
        rows[k][0] = rng.choice(("", " "))
    return _case(rng, way, _text(rows), f"line {k + 2}")


def _two_of_a_name(rng: Random) -> Case:
    rows = _rows()
    k = rng.randrange(16)
    rows.insert(
        rng.randrange(32), ["a", rows[k][1], str(rng.choice((-1, 1)) * rng.uniform(50, 9000)), rows[k][3]]
    )
    return _case(rng, "two targets of one name", _text(rows), "two places")


def _times(rng: Random) -> Case:
    rows, k = _rows(), rng.randrange(1, 32)
    way = rng.choice(("milliseconds", "mixed kinds", "date only"))
    if way == "milliseconds":
        for row in rows:
            row[1] = str(1_588_334_400_000 + int(1000 * float(row[1])))
    elif way == "mixed kinds":
        rows[k][1] = f"2020-05-01T12:00:{k:02d}Z"
    else:
        rows[k][1] = "2020-05-01"
    return _case(rng, f"times: {way}", _text(rows))


def _far_away(rng: Random) -> Case:
    """A replayed target in another unit or about another origin."""
    factor, shift = rng.choice(((100.0, 0.0), (1000.0, 0.0), (1.0, 5e5), (1.0, -4e6), (39.37, 0.0)))
    rows = [
        [r[0], r[1], str(factor * (float(r[2]) + 20.0) + shift), str(factor * (float(r[3]) + 20.0))]
        for r in _rows()
    ]
    return changed(
        "csv",
        "track far away",
        Nature.MEANING,
        COMMANDS["simulate track"],
        "walk.csv",
        _text(rows),
        "away",
        "v_max_mps",
    )


def _too_fast(rng: Random) -> Case:
    """Times in another unit: the target would be faster than its class."""
    factor = rng.choice((1e-3, 1e-2, 1.0 / 60.0, 1.0 / 3600.0))
    rows = [[r[0], str(factor * float(r[1])), *r[2:]] for r in _rows()]
    command = COMMANDS["simulate track"]
    return changed(
        "csv", "times in another unit", Nature.MEANING, command, "walk.csv", _text(rows), "v_max_mps"
    )


def _geodetic(rng: Random) -> Case:
    """Latitudes and longitudes: without an origin, off the Earth, or the one for the other."""
    lat, lon = (44.0, 11.0) if rng.random() < 0.5 else (39.05, -85.53)
    rows = [
        [r[0], r[1], f"{lat + 1e-5 * float(r[2]):.7f}", f"{lon + 1e-5 * float(r[3]):.7f}"] for r in _rows()
    ]
    head, extra = ["id", "t", "lat", "lon"], ("--origin", f"{lat},{lon},50")
    way = rng.choice(("no origin", "swapped", "off the Earth", "origin far away", "origin is no number"))
    if way == "no origin":
        extra = ()
    elif way == "swapped":
        head = ["id", "t", "lon", "lat"]
    elif way == "off the Earth":
        rows[rng.randrange(32)][2] = str(rng.choice((-1, 1)) * rng.uniform(90.1, 1e6))
    elif way == "origin far away":
        extra = ("--origin", f"{-lat},{lon},50")
    else:
        extra = (
            "--origin",
            rng.choice((f"{lat},{lon}", f"{lat};{lon};5", f"{lat},nan,5", f"{lat},{lon},1_0", "here")),
        )
    case = changed(
        "csv", f"geodetic: {way}", Nature.MEANING, COMMANDS["design tracks"], "people.csv", _text(rows, head)
    )
    return Case(case.kind, case.label, case.nature, case.command, case.files, extra)


MEANING = [
    _number,
    _number,
    _number,
    _header,
    _identity_misspelt,
    _row,
    _two_of_a_name,
    _times,
    _far_away,
    _too_fast,
]
MEANING += [_geodetic]


def _broken(rng: Random) -> Case:
    command, file = _reader(rng)
    text = _text(_rows())
    label = rng.choice(("text", "text", "quote", "line without end", "gzip that is none"))
    if label == "text":
        label, content = broken_text(rng, text, 0.0, 0.02)
    elif label == "quote":
        k = rng.randrange(25, len(text))
        content = (text[:k] + '"' + text[k:]).encode()
    elif label == "line without end":
        content = (text + "a," * 800_000).encode()
    else:
        content = gzip.compress(text.encode())
    return changed("csv", label, Nature.BROKEN, command, file, content, file)


def _rewritten(rng: Random) -> Case:
    command, file = _reader(rng)
    rows = [
        [r[0], *(same_number(rng, float(x)) if rng.random() < 0.3 else x for x in r[1:])] for r in _rows()
    ]
    if rng.random() < 0.5:  # rows of one identity in any order, identities as they first appear
        mine, other = rows[:16], rows[16:]
        rng.shuffle(mine)
        rng.shuffle(other)
        rows = mine + other
    rows += [rows[k] for k in rng.sample(range(32), rng.randrange(3))]  # the same fix twice
    head = list(_HEAD)
    if rng.random() < 0.4:
        head = [name.upper() if rng.random() < 0.5 else name for name in head]
    if rng.random() < 0.3:
        head = [rng.choice(("id", "track_id", "person")), rng.choice(("t", "time", "t_s")), "x", "y"]
    if rng.random() < 0.3:
        head, rows = [*head, "comment"], [[*row, rng.choice(("", "x", "ü"))] for row in rows]
    if rng.random() < 0.3:
        order = rng.sample(range(len(head)), len(head))
        head, rows = [head[k] for k in order], [[row[k] for k in order] for row in rows]
    text = _text(rows, head, rng.choice(",,;\t"))
    if rng.random() < 0.3:
        text = text.replace("\n", rng.choice(("\r\n", "\n\n")))
    content = text.encode("utf-8-sig" if rng.random() < 0.2 else "utf-8")
    return changed("csv", "rewritten", Nature.HARMLESS, command, file, content)


BROKEN = [_broken]
HARMLESS = [_rewritten]
