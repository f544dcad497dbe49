"""Archives of arrays: learned models of both kinds, and policies."""

from __future__ import annotations

import json
from collections.abc import Callable
from random import Random

import numpy as np

from robustness.case import Answer, Case, Nature, changed
from robustness.formats import archive, arrays_of
from robustness.stage import COMMANDS, Stage
from robustness.text import broken_text

__all__ = ["generators"]

_Arrays = dict[str, np.ndarray]
_Change = Callable[[Random, _Arrays], None]
#: kind, command and file of each archive that commands read
_KINDS = (
    ("model", "simulate model", "learned.npz"),
    ("model", "certify model", "model.npz"),
    ("policy", "evaluate policy", "policy.npz"),
)


def generators(stage: Stage) -> list[tuple[str, Nature, Callable[[Random], Case]]]:
    """Return kind, nature and generator of every change of every archive."""
    found: list[tuple[str, Nature, Callable[[Random], Case]]] = []
    for kind, command, file in _KINDS:
        content = stage.files[file]
        changes = {**_CHANGES, **(_HEADERS if kind == "policy" or file == "learned.npz" else _TRACKS)}
        for label, change in changes.items():
            found.append((kind, Nature.MEANING, _meaning(kind, command, file, content, label, change)))
        found += [(kind, Nature.BROKEN, _broken(kind, command, file, content))] * 3
        found += [(kind, Nature.HARMLESS, _rewritten(kind, command, file, content))] * 5
    return found


def _meaning(
    kind: str, command: str, file: str, content: bytes, label: str, change: _Change
) -> Callable[[Random], Case]:
    def make(rng: Random) -> Case:
        arrays = arrays_of(content)
        change(rng, arrays)
        spoilt = archive(arrays, pickled=True)
        return changed(kind, f"{file}: {label}", Nature.MEANING, COMMANDS[command], file, spoilt, file)

    return make


def _pick(rng: Random, arrays: _Arrays, least: int = 1) -> str:
    return rng.choice(
        [n for n, a in arrays.items() if n != "header" and a.dtype.kind == "f" and a.size >= least]
    )


def _not_finite(rng: Random, arrays: _Arrays) -> None:
    name = _pick(rng, arrays)
    arrays[name].flat[rng.randrange(arrays[name].size)] = rng.choice((np.nan, np.inf, -np.inf))


def _lost(rng: Random, arrays: _Arrays) -> None:
    del arrays[rng.choice(list(arrays))]


def _unknown(rng: Random, arrays: _Arrays) -> None:
    arrays[rng.choice(("extra", "weights_99", "readme", "centers", "weight_7"))] = np.zeros(3)


def _other_shape(rng: Random, arrays: _Arrays) -> None:
    name = _pick(rng, arrays, 2)
    array = arrays[name]
    ways = [array[None], array.ravel() if array.ndim > 1 else array[:, None], array[:-1], array[:0]]
    arrays[name] = rng.choice(ways)


def _other_kind(rng: Random, arrays: _Arrays) -> None:
    name = _pick(rng, arrays)
    array = arrays[name]
    arrays[name] = rng.choice((array.astype(str), array.astype(complex), array > 0, array.astype(object)))


def _magnitude(rng: Random, arrays: _Arrays) -> None:
    name = _pick(rng, arrays)
    arrays[name] = arrays[name].copy()
    arrays[name].flat[rng.randrange(arrays[name].size)] = rng.choice((-1, 1)) * 10.0 ** rng.uniform(150, 308)


_CHANGES: dict[str, _Change] = {
    "not finite": _not_finite,
    "member lost": _lost,
    "unknown member": _unknown,
    "another shape": _other_shape,
    "another kind of numbers": _other_kind,
    "magnitude": _magnitude,
}


def _header(rng: Random, arrays: _Arrays) -> None:
    """Another version, format or count in the description."""
    raw = arrays["header"]
    text = raw.tobytes().decode() if raw.dtype == np.uint8 else str(raw)
    head = json.loads(text)
    key = rng.choice([k for k in head if k not in _FREE])
    value = head[key]
    if isinstance(value, int):
        head[key] = rng.choice((value + 1, -1, 0, 10**9, str(value), None, float("nan")))
    elif isinstance(value, str):
        head[key] = rng.choice((value + "x", "", None, 3, "<script>"))
    else:
        head[key] = rng.choice((value[:-1], [], value[::-1], [*value, "more"], "all"))
    written = json.dumps(head)
    arrays["header"] = (
        np.frombuffer(written.encode(), dtype=np.uint8) if raw.dtype == np.uint8 else np.array(written)
    )


def _no_json(rng: Random, arrays: _Arrays) -> None:
    raw = arrays["header"]
    written = rng.choice(("{", "", "[]", "null", "3", '{"format": "camnet"}', "{" * 5000))
    arrays["header"] = (
        np.frombuffer(written.encode(), dtype=np.uint8) if raw.dtype == np.uint8 else np.array(written)
    )


#: fields of descriptions that may have other values
_FREE = ("training", "heading_scale_m", "residual_of", "activation", "residual_scale", "filter_name", "form")
_HEADERS: dict[str, _Change] = {"description": _header, "description is no JSON": _no_json}


def _whole_path(rng: Random, arrays: _Arrays) -> None:
    """Places cut to whole numbers: a path that no target of the class could take."""
    arrays["path"] = np.trunc(arrays["path"]).astype(rng.choice((float, np.int64)))


def _time_back(rng: Random, arrays: _Arrays) -> None:
    path = arrays["path"]
    i, j = sorted(rng.sample(range(len(path)), 2))
    path[[i, j], 0] = path[[j, i], 0]


def _unknown_camera(rng: Random, arrays: _Arrays) -> None:
    name, column = rng.choice((("path", 3), ("gaps", 0), ("gaps", 1)))
    rows = arrays[name]
    rows[rng.randrange(len(rows)), column] = rng.choice((-2.0, 2.0, 0.5, 99.0))


def _centimetres(rng: Random, arrays: _Arrays) -> None:
    arrays["path"][:, 1:3] *= rng.choice((100.0, 1000.0))


def _no_kernels(rng: Random, arrays: _Arrays) -> None:
    arrays["precision"] = arrays["precision"] * rng.choice((0.0, -1.0))


_TRACKS: dict[str, _Change] = {
    "path cut to whole numbers": _whole_path,
    "times go back": _time_back,
    "unknown camera": _unknown_camera,
    "path in another unit": _centimetres,
    "kernels without width": _no_kernels,
}


def _broken(kind: str, command: str, file: str, content: bytes) -> Callable[[Random], Case]:
    def make(rng: Random) -> Case:
        at = rng.randrange(len(content))
        ways = {
            "cut": content[:at],
            "bytes changed": content[:at] + rng.randbytes(40) + content[at + 40 :],
            "empty": b"",
            "text": broken_text(rng, "not an archive at all")[1],
            "array alone": b"\x93NUMPY\x01\x00" + rng.randbytes(80),
            "pickle": b"\x80\x04\x95\x10\x00\x00\x00\x00\x00\x00\x00\x8c\x02os\x94\x8c\x06system\x94\x93\x94.",
            "unpacks to gigabytes": archive({**arrays_of(content), "extra": np.zeros(40_000_000)}),
        }
        label = rng.choice(sorted(ways))
        spoilt = ways[label]
        case = changed(kind, f"{file}: {label}", Nature.BROKEN, COMMANDS[command], file, spoilt, file)
        if label != "bytes changed":
            return case
        # bytes between members may say nothing; then the result is the same
        answers = frozenset({Answer.REFUSED, Answer.UNCHANGED})
        return Case(case.kind, case.label, case.nature, case.command, case.files, (), answers, (file,))

    return make


def _rewritten(kind: str, command: str, file: str, content: bytes) -> Callable[[Random], Case]:
    def make(rng: Random) -> Case:
        arrays = arrays_of(content)
        order = list(arrays)
        rng.shuffle(order)
        for name in order:
            array = arrays[name]
            if array.dtype.kind == "f" and array.ndim > 1 and rng.random() < 0.5:
                arrays[name] = np.asfortranarray(array)
            elif array.dtype.kind == "f" and rng.random() < 0.5:
                arrays[name] = array.astype(array.dtype.newbyteorder(">"))
        written = archive(arrays, rng.random() < 0.5, order)
        return changed(kind, f"{file}: rewritten", Nature.HARMLESS, COMMANDS[command], file, written)

    return make
