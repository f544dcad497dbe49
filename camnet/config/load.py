"""Load a world or a recipe: YAML, merged, overridden, validated and checked."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import yaml

import camnet
from camnet.config.check import check_scenario
from camnet.config.diagnose import validate
from camnet.config.fields import annotation_at, plain_types
from camnet.config.merge import apply_override, merge
from camnet.config.models import Scenario
from camnet.config.recorded import RecordedScenario, check_recorded
from camnet.config.yaml_nodes import FieldPath, Node, Origin, parse_yaml
from camnet.errors import ConfigError

__all__ = ["dump_scenario", "load_scenario", "shipped_worlds"]

#: content only: the package ``camnet.worlds`` itself is above this one
_WORLDS = Path(camnet.__file__).parent / "worlds"
_MAX_CHAIN = 8
#: largest settings file, bytes
_MOST_BYTES = 4_000_000


def shipped_worlds() -> dict[str, Path]:
    """Return the world files that ship with camnet, by name."""
    return {path.parent.name: path for path in sorted(_WORLDS.glob("*/world.yaml"))}


def load_scenario(
    source: str | Path, overrides: Sequence[str] = (), seed: int | None = None
) -> Scenario | RecordedScenario:
    """Load what a user names: a shipped world, a world file, a folder with ``world.yaml``, or a recipe.

    A recipe is a scenario file with ``world: NAME_OR_PATH`` (a path is relative to the recipe); its sections are
    merged over that world's by the rules of ``camnet.config.merge``. Overrides come last.

    Parameters
    ----------
    source : name or path
    overrides : texts ``a.b.c=value`` as in ``--set``
    seed : replaces the scenario's seed

    Raises
    ------
    ConfigError
        With file, line, field, value and advice for every problem found.
    WorldError
        When the configuration is well formed but no world can be built from it (overlapping regions, ...).
    """
    root = _read(_locate(source), 0)
    for text in overrides:
        root = apply_override(root, text)
    if seed is not None:
        root = apply_override(root, f"seed={seed}")
    kind = root.child("kind")
    if kind is not None and kind.value == "recorded":
        root = _resolve_paths(RecordedScenario, root)
        recorded = validate(RecordedScenario, root)
        check_recorded(recorded, root)
        return recorded
    root = _resolve_paths(Scenario, root)
    return check_scenario(validate(Scenario, root), root)


def dump_scenario(scenario: Scenario | RecordedScenario) -> str:
    """Write a scenario as a world file that loads back to an equal one."""
    data = scenario.model_dump(mode="json", exclude_none=True)
    return yaml.safe_dump(data, sort_keys=False, default_flow_style=None, width=110, allow_unicode=True)


def _locate(source: str | Path, folder: Path = Path()) -> Path:
    """Find the file that a user means; relative paths start in ``folder``."""
    worlds = shipped_worlds()
    if isinstance(source, str) and source in worlds:
        return worlds[source]
    path = folder / source
    try:
        if path.is_dir():
            if (path / "world.yaml").is_file():
                return path / "world.yaml"
            raise ConfigError(f"world: value {str(source)!r}: the folder has no world.yaml")
        if path.is_file():
            return path
    except (OSError, ValueError):
        pass
    close = difflib.get_close_matches(str(source), worlds, 1)
    hint = f"did you mean {close[0]!r}? " if close else ""
    raise ConfigError(
        f"world: value {str(source)!r}: no such file, folder or shipped world: "
        f"{hint}shipped worlds: {', '.join(worlds)}"
    )


def _read(path: Path, depth: int) -> Node:
    """Read a file and, under it, the world that it names."""
    text = _text(path)
    origin = Origin(str(path), 1, path.parent)
    root = parse_yaml(text, origin)
    if not isinstance(root.value, dict):
        raise ConfigError(f"{path}: value {root.plain()!r}: a mapping of settings was expected")
    world = root.value.get("world")
    if world is None:
        return root
    rest = Node({key: child for key, child in root.value.items() if key != "world"}, root.origin)
    if not isinstance(world.value, str) or not world.value:
        raise ConfigError(
            f"{world.origin}: world: value {world.plain()!r}: give the name of a shipped world or a path"
        )
    if depth >= _MAX_CHAIN:
        raise ConfigError(
            f"{world.origin}: world: value {world.value!r}: recipes refer to each other in a circle"
        )
    return merge(_read(_locate_from(world.value, world.origin), depth + 1), rest)


def _text(path: Path) -> str:
    """Read a file of at most ``_MOST_BYTES``, whatever size it says that it has."""
    try:
        with path.open("rb") as stream:
            content = stream.read(_MOST_BYTES + 1)
        if len(content) > _MOST_BYTES:
            raise ConfigError(f"{path}: larger than {_MOST_BYTES:,} bytes: settings are smaller")
        return content.decode("utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: cannot be read as UTF-8 text: {error}") from None


def _locate_from(name: str, origin: Origin) -> Path:
    try:
        return _locate(name, origin.folder or Path())
    except ConfigError as error:
        raise ConfigError(f"{origin}: {error}") from None


def _resolve_paths(model: type[Scenario | RecordedScenario], root: Node) -> Node:
    """Make relative paths absolute: against ``data`` when given, else against the file they are written in."""
    data = root.child("data")
    data_folder = _absolute(data, None) if data is not None and isinstance(data.value, str) else None

    def resolve(path: FieldPath, leaf: Node) -> Node:
        is_path = Path in plain_types(annotation_at(model, path, root))
        if not is_path or not isinstance(leaf.value, str):
            return leaf
        return replace(leaf, value=str(_absolute(leaf, None if path == ("data",) else data_folder)))

    return _map_leaves(root, resolve, ())


def _absolute(leaf: Node, data_folder: Path | None) -> Path:
    written = Path(str(leaf.value)).expanduser()
    in_file = leaf.origin.folder
    base = Path.cwd() if in_file is None else (data_folder or in_file)
    return (base / written).resolve()


def _map_leaves(node: Node, change: Callable[[FieldPath, Node], Node], path: FieldPath) -> Node:
    if isinstance(node.value, dict):
        items = {key: _map_leaves(child, change, (*path, key)) for key, child in node.value.items()}
        return replace(node, value=items)
    if isinstance(node.value, list):
        return replace(node, value=[_map_leaves(c, change, (*path, i)) for i, c in enumerate(node.value)])
    return change(path, node)
