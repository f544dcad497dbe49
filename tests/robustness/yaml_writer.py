"""The same world, written in another way."""

from __future__ import annotations

import copy
import json
from random import Random
from typing import Any

import yaml

from robustness.text import same_number

__all__ = ["write_world"]

#: settings at their defaults
_DEFAULTS: tuple[tuple[str, str, Any], ...] = (
    ("handoff", "grace_s", 2.0),
    ("handoff", "lookahead_s", 40),
    ("physics", "gravity_mps2", 9.81),
    ("physics", "step_hz", 240),
    ("controller", "k1_per_s", 2.0),
    ("estimator", "share", False),
    ("run", "log_hz", 10.0),
    ("seed", "", 0),
    ("kind", "", "network"),
)


class _Number(float):
    """A number that is written as its text says."""

    text: str


def _shuffled(rng: Random, node: Any) -> Any:
    if isinstance(node, dict):
        keys = list(node)
        rng.shuffle(keys)
        return {key: _shuffled(rng, node[key]) for key in keys}
    return [_shuffled(rng, item) for item in node] if isinstance(node, list) else node


def _numbered(rng: Random, node: Any) -> Any:
    if isinstance(node, dict):
        return {key: _numbered(rng, item) for key, item in node.items()}
    if isinstance(node, list):
        return [_numbered(rng, item) for item in node]
    if isinstance(node, float) and rng.random() < 0.5:
        number = _Number(node)
        number.text = same_number(rng, node)
        return number
    return node


class _Dumper(yaml.SafeDumper):
    """Writes `_Number` as its text says, and no aliases."""

    def ignore_aliases(self, data: Any) -> bool:
        """Return True."""
        return True


_Dumper.add_representer(
    _Number, lambda dumper, number: dumper.represent_scalar("tag:yaml.org,2002:float", number.text)
)


def write_world(rng: Random, world: dict[str, Any]) -> tuple[str, bytes]:
    """Return what was changed and the file."""
    data = copy.deepcopy(world)
    done = []
    if rng.random() < 0.5:
        done.append("order of keys")
        data = _shuffled(rng, data)
    if rng.random() < 0.3:
        done.append("defaults")
        section, key, value = rng.choice(_DEFAULTS)
        if key:
            data.setdefault(section, {}).setdefault(key, value)
        else:
            data.setdefault(section, value)
    if rng.random() < 0.3:
        done.append("description")
        data["description"] = rng.choice(("", "ein Hof", "<b>yard</b> | `x`", "\u65e5\u672c\u8a9e", "a\nb"))
    if rng.random() < 0.2:
        return " and ".join([*done, "JSON"]), json.dumps(data, indent=rng.choice((None, 1, 4))).encode()
    if rng.random() < 0.5:
        done.append("numbers")
        data = _numbered(rng, data)
    text = yaml.dump(
        data,
        Dumper=_Dumper,
        sort_keys=False,
        default_flow_style=rng.choice((None, False, True)),
        indent=rng.choice((2, 3, 4, 8)),
        width=rng.choice((40, 80, 10_000)),
        allow_unicode=rng.random() < 0.5,
        explicit_start=rng.random() < 0.3,
        explicit_end=rng.random() < 0.2,
        default_style=None,
    )
    return _dressed(rng, text, done)


def _dressed(rng: Random, text: str, done: list[str]) -> tuple[str, bytes]:
    """Comments, blank lines, line ends and a byte order mark."""
    if rng.random() < 0.4:
        done.append("comments")
        text = (
            f"# {rng.random()}\n\n{text}\n# the end\n" if "..." not in text else f"# {rng.random()}\n\n{text}"
        )
    if rng.random() < 0.3:
        done.append("line ends")
        text = text.replace("\n", "\r\n")
    data = text.encode()
    if rng.random() < 0.2:
        done.append("byte order mark")
        data = b"\xef\xbb\xbf" + data
    return " and ".join(done) or "layout", data
