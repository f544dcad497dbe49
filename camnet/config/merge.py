"""Deep merge of a recipe over a world, and overrides ``a.b.c=value``.

Rules of the merge:

- mappings merge key by key, except that a mapping with another ``kind`` or ``type`` replaces the old one whole;
- a list whose items all have a ``name`` merges with another such list by name: items of the same name merge,
  new names are appended, and an item ``{name: x, remove: true}`` takes ``x`` away;
- anything else is replaced.
"""

from __future__ import annotations

import difflib

from camnet.config.yaml_nodes import FieldPath, Node, Origin, field_text, parse_yaml
from camnet.errors import ConfigError

__all__ = ["apply_override", "merge"]

_DISCRIMINATORS = ("kind", "type")


def merge(base: Node, over: Node) -> Node:
    """Return ``over`` merged over ``base`` by the rules above; neither is changed."""
    if isinstance(base.value, dict) and isinstance(over.value, dict):
        if _discriminator_differs(base.value, over.value):
            return over
        merged = dict(base.value)
        for key, child in over.value.items():
            merged[key] = merge(merged[key], child) if key in merged else child
        return Node(merged, over.origin)
    if isinstance(base.value, list) and isinstance(over.value, list):
        old, new = _by_name(base.value), _by_name(over.value)
        if old is not None and new is not None:
            for name, item in new.items():
                _merge_item(old, name, item)
            return Node(list(old.values()), over.origin)
    return over


def _merge_item(items: dict[str, Node], name: str, item: Node) -> None:
    remove = item.child("remove")
    if remove is not None:
        if remove.value is not True or name not in items:
            advice = "write 'remove: true'" if name in items else f"there is no item {name!r} to remove"
            raise ConfigError(f"{remove.origin}: {name}.remove: value {remove.plain()!r}: {advice}")
        del items[name]
    else:
        items[name] = merge(items[name], item) if name in items else item


def _discriminator_differs(base: dict[str, Node], over: dict[str, Node]) -> bool:
    return any(
        key in base and key in over and base[key].plain() != over[key].plain() for key in _DISCRIMINATORS
    )


def _by_name(items: list[Node]) -> dict[str, Node] | None:
    """Items by name; None when an item has no name or two share one (then the list is replaced whole)."""
    named: dict[str, Node] = {}
    for item in items:
        name = item.child("name")
        if name is None or not isinstance(name.value, str) or name.value in named:
            return None
        named[name.value] = item
    return named


def apply_override(root: Node, text: str) -> Node:
    """Return ``root`` with one override applied.

    Parameters
    ----------
    root : the merged configuration
    text : ``a.b.c=value``; the value is YAML; items of lists are addressed by name or by number from 0
        (``targets.robot.motion.speed_mps=0.3``, ``agents.0.start_m=[1, 2, 3]``)

    Raises
    ------
    ConfigError
        When the text has no ``=``, its value is not YAML, or its path leads through something that is not there.
    """
    key, equals, written = text.partition("=")
    keys = [part.strip() for part in key.replace("[", ".").replace("]", "").split(".")]
    origin = Origin(f"--set {text}")
    if not equals or not all(keys):
        raise ConfigError(
            f"{origin}: value {text!r}: an override is KEY=VALUE with a dotted key, "
            "such as targets.robot.motion.speed_mps=0.3"
        )
    return _set(root, keys, parse_yaml(written, origin, tuple(keys)), ())


def _set(node: Node | None, keys: list[str], value: Node, path: FieldPath) -> Node:
    if not keys:
        return value
    key, rest = keys[0], keys[1:]
    if node is None or node.value is None:
        node = Node({}, value.origin)
    if isinstance(node.value, dict):
        child = node.value.get(key)
        return Node({**node.value, key: _set(child, rest, value, (*path, key))}, node.origin)
    if isinstance(node.value, list):
        index = _index(node.value, key, value.origin, path)
        items = list(node.value)
        items[index] = _set(items[index], rest, value, (*path, index))
        return Node(items, node.origin)
    raise ConfigError(
        f"{value.origin}: {field_text((*path, key))}: {field_text(path)} is the value {node.plain()!r} "
        f"and has no parts: set {field_text(path)} itself"
    )


def _index(items: list[Node], key: str, origin: Origin, path: FieldPath) -> int:
    names = [child.value for item in items if (child := item.child("name")) is not None]
    for index, item in enumerate(items):
        name = item.child("name")
        if name is not None and name.value == key:
            return index
    if key.isdecimal() and int(key) < len(items):
        return int(key)
    close = difflib.get_close_matches(key, [str(name) for name in names], 1)
    if close:
        advice = f"did you mean {close[0]!r}?"
    elif names:
        advice = f"names: {', '.join(str(name) for name in names)}; or a number from 0 to {len(items) - 1}"
    else:
        advice = f"give a number from 0 to {len(items) - 1}" if items else "the list is empty: set it whole"
    raise ConfigError(f"{origin}: {field_text(path)}: value {key!r}: no such item: {advice}")
