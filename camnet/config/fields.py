"""What the settings classes say about a field path: its type, its siblings."""

from __future__ import annotations

import types
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel

from camnet.config.yaml_nodes import FieldPath, Node

__all__ = ["annotation_at", "data_path", "field_names", "model_at", "plain_types", "setting_paths"]

_DISCRIMINATORS = ("kind", "type")


def data_path(model: type[BaseModel], location: tuple[str | int, ...], root: Node) -> FieldPath:
    """Drop from a validator's location the union tags, which are no keys of the data."""
    path: list[str | int] = []
    annotation: Any = model
    node: Node | None = root
    tagged = False
    for part in location:
        if not tagged and len(_models(annotation)) > 1:
            tagged = True  # the part after a union names its member
            continue
        path.append(part)
        annotation = _step(annotation, part, node)
        node = None if node is None else node.child(part)
        tagged = False
    return tuple(path)


def annotation_at(model: type[BaseModel], path: FieldPath, root: Node) -> Any:  # noqa: ANN401 - a type expression
    """Return the declared type of the field at ``path`` (None when there is no such field).

    ``root`` is the data: it says which member of a union is meant.
    """
    annotation: Any = model
    node: Node | None = root
    for part in path:
        annotation = _step(annotation, part, node)
        node = None if node is None else node.child(part)
        if annotation is None:
            return None
    return annotation


def model_at(model: type[BaseModel], path: FieldPath, root: Node) -> type[BaseModel] | None:
    """Return the settings class whose fields are the keys at ``path``."""
    node: Node | None = root
    for part in path:
        node = None if node is None else node.child(part)
    return _choose_model(annotation_at(model, path, root), node)


def field_names(model: type[BaseModel]) -> list[str]:
    """Return the keys that a settings class knows."""
    return list(model.model_fields)


def setting_paths(model: type[BaseModel], root: Node) -> list[FieldPath]:
    """Return the paths of all settings that the data ``root`` has or could have; items of lists by name."""
    paths: list[FieldPath] = []
    for name, field in model.model_fields.items():
        node = root.child(name)
        for key, inner in _inner_models((name,), field.annotation, node):
            paths += [(*key, *path) for path in setting_paths(inner, _at(root, key))]
        paths.append((name,))
    return paths


def _inner_models(
    path: FieldPath,
    annotation: Any,  # noqa: ANN401 - a type expression
    node: Node | None,
) -> list[tuple[FieldPath, type[BaseModel]]]:
    """Return the settings classes right under a field: its own, or those of the items of its list."""
    own = _choose_model(annotation, node)
    if own is not None:
        return [(path, own)]
    found: list[tuple[FieldPath, type[BaseModel]]] = []
    items = node.value if node is not None and isinstance(node.value, list) else []
    for index, item in enumerate(items):
        inner = _choose_model(_step(annotation, index, node), item)
        if inner is not None:
            found.append(((*path, index), inner))
    return found


def _at(root: Node, path: FieldPath) -> Node:
    """Return the node at ``path``; an empty mapping where there is none."""
    node: Node | None = root
    for part in path:
        node = None if node is None else node.child(part)
    return Node({}, root.origin) if node is None else node


def plain_types(annotation: Any) -> list[Any]:  # noqa: ANN401 - a type expression
    """Return the members of a type without ``Annotated``, ``None`` and unions."""
    origin = get_origin(annotation)
    if origin is Annotated:
        return plain_types(get_args(annotation)[0])
    if origin in (Union, types.UnionType):
        return [member for part in get_args(annotation) for member in plain_types(part)]
    return [] if annotation is type(None) else [annotation]


def _step(annotation: Any, part: str | int, node: Node | None) -> Any:  # noqa: ANN401
    if isinstance(part, int):
        for member in plain_types(annotation):
            arguments = get_args(member)
            if get_origin(member) is tuple and arguments:
                if arguments[-1] is Ellipsis:
                    return arguments[0]
                return arguments[min(part, len(arguments) - 1)]
        return None
    model = _choose_model(annotation, node)
    if model is None or part not in model.model_fields:
        return None
    return model.model_fields[part].annotation


def _choose_model(annotation: Any, node: Node | None) -> type[BaseModel] | None:  # noqa: ANN401
    models = _models(annotation)
    if len(models) <= 1:
        return models[0] if models else None
    return next((model for model in models if _has_tag(model, node)), None)


def _has_tag(model: type[BaseModel], node: Node | None) -> bool:
    for key in _DISCRIMINATORS:
        tag = None if node is None else node.child(key)
        field = model.model_fields.get(key)
        if tag is not None and field is not None and get_origin(field.annotation) is Literal:
            return tag.value in get_args(field.annotation)
    return False


def _models(annotation: Any) -> list[type[BaseModel]]:  # noqa: ANN401
    return [m for m in plain_types(annotation) if isinstance(m, type) and issubclass(m, BaseModel)]
