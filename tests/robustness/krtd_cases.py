"""Camera files."""

from __future__ import annotations

from random import Random

import numpy as np

from robustness import inputs
from robustness.case import Case, Nature, changed
from robustness.formats import write_krtd
from robustness.stage import COMMANDS
from robustness.text import bad_number, broken_text, same_number

__all__ = ["BROKEN", "HARMLESS", "MEANING"]

_FILE = "cameras/north.krtd"
_COMMAND = COMMANDS["certify cameras"]


def _parts() -> tuple[np.ndarray, np.ndarray, np.ndarray, list[float]]:
    return inputs.krtd(*inputs.NORTH)


def _case(label: str, content: str, *mentions: str) -> Case:
    return changed("krtd", label, Nature.MEANING, _COMMAND, _FILE, content, *(mentions or ("north",)))


def _tokens(text: str) -> list[tuple[int, int]]:
    """Return line and number of every word."""
    return [(k, j) for k, line in enumerate(text.split("\n")) for j in range(len(line.split()))]


def _replaced(text: str, at: tuple[int, int], word: str) -> str:
    lines = text.split("\n")
    words = lines[at[0]].split()
    words[at[1]] = word
    lines[at[0]] = " ".join(words)
    return "\n".join(lines)


def _number(rng: Random) -> Case:
    text, (label, bad) = write_krtd(*_parts()), bad_number(rng, " ")
    if not bad:
        label, bad = "words", "x"
    at = rng.choice(_tokens(text))
    return _case(f"number: {label}", _replaced(text, at, bad), f"line {at[0] + 1}", "north.krtd")


def _intrinsics(rng: Random) -> Case:
    k, r, t, d = _parts()
    way = rng.choice(
        (
            "no focal length",
            "negative",
            "skew",
            "millimetres",
            "principal point",
            "last row",
            "transposed",
            "lower",
        )
    )
    axis = rng.randrange(2)
    if way == "no focal length":
        k[axis, axis] = 0.0
    elif way == "negative":
        k[axis, axis] *= -1.0
    elif way == "skew":
        k[0, 1] = rng.uniform(0.5, 50.0)
    elif way == "millimetres":
        k[axis, axis] = rng.uniform(2.0, 40.0)
    elif way == "principal point":
        k[axis, 2] = rng.choice((-1.0, 0.0, 1.0)) * k[axis, 2] * rng.choice((1.0, 2.0, 3.5)) or -5.0
        k[axis, 2] = k[axis, 2] if not 0 < k[axis, 2] < (1920, 1080)[axis] else -k[axis, 2]
    elif way == "last row":
        k[2, rng.randrange(3)] += rng.choice((0.5, 1.0, -1.0))
    elif way == "transposed":
        k = k.T
    else:
        k[1, 0] = rng.uniform(0.1, 5.0)
    return _case(f"K: {way}", write_krtd(k, r, t, d))


def _rotation(rng: Random) -> Case:
    k, r, t, d = _parts()
    way = rng.choice(
        ("scaled", "reflection", "row twice", "zero", "sheared", "degrees", "handedness", "rows exchanged")
    )
    if way == "scaled":
        r = r * rng.choice((0.5, 1.01, 2.0, 100.0))
    elif way == "reflection":
        r = -r
    elif way == "row twice":
        r[1] = r[0]
    elif way == "zero":
        r = r * 0.0
    elif way == "sheared":
        r[0, rng.randrange(3)] += rng.uniform(0.01, 0.5)
    elif way == "degrees":
        r = r * 57.29578
    elif way == "handedness":
        r[rng.randrange(3)] *= -1.0
    else:
        i, j = rng.sample(range(3), 2)
        r[[i, j]] = r[[j, i]]
    return _case(f"R: {way}", write_krtd(k, r, t, d), "R ")


def _shape(rng: Random) -> Case:
    k, r, t, d = _parts()
    text = write_krtd(k, r, t, d)
    lines = text.split("\n")
    way = rng.choice(("line lost", "line twice", "word lost", "D too long", "quaternion", "T lost"))
    if way == "line lost":
        del lines[rng.choice((0, 1, 2, 4, 5, 6))]
    elif way == "line twice":
        at = rng.choice((0, 1, 2, 4, 5, 6))
        lines.insert(at, lines[at])
    elif way == "word lost":
        at = rng.choice((0, 1, 2, 4, 5, 6, 8))
        lines[at] = " ".join(lines[at].split()[1:])
    elif way == "D too long":
        lines[10] = " ".join(["0.0"] * rng.randrange(15, 40))
    elif way == "quaternion":
        lines[4:7] = ["1.0 0.0 0.0 0.0"]
    else:
        del lines[8]
        lines[8:] = []
    return _case(way, "\n".join(lines))


def _image(rng: Random) -> Case:
    size = rng.choice(("640x480", "1080x1920", "0x1080", "1920", "1920x1080x3", "-1920x1080", "1e3x1e3", "1_920x1080",
                       "\u0661920x1080", "99999999x1080", "1920 1080", "axb"))  # fmt: skip
    return Case("krtd", "image size", Nature.MEANING, _COMMAND, {}, (f"--image={size}",))


MEANING = [_number, _number, _intrinsics, _intrinsics, _rotation, _rotation, _shape, _image]


def _broken(rng: Random) -> Case:
    text = write_krtd(*_parts())
    label, content = broken_text(rng, text, 0.0, 0.3)
    return changed("krtd", label, Nature.BROKEN, _COMMAND, _FILE, content, "north.krtd")


def _rewritten(rng: Random) -> Case:
    text = write_krtd(*_parts())
    for at in _tokens(text):
        if rng.random() < 0.3:
            lines = text.split("\n")
            text = _replaced(text, at, same_number(rng, float(lines[at[0]].split()[at[1]])))
    if rng.random() < 0.3:
        text = text.replace(" ", rng.choice(("\t", "   ", " \t ")))
    if rng.random() < 0.3:
        text = text.replace("\n", rng.choice(("\r\n", " \n", "\n\n", "\n# K, R, T, D\n")))
    if rng.random() < 0.3:
        text = text.rstrip("\n") + " 0.0" * rng.choice((1, 4, 8))
    content = text.encode("utf-8-sig" if rng.random() < 0.2 else "utf-8")
    return changed("krtd", "rewritten", Nature.HARMLESS, _COMMAND, _FILE, content)


BROKEN = [_broken]
HARMLESS = [_rewritten]
