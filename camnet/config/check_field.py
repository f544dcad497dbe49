"""Problems of targets of kind ``field``: which law, where it begins, and whether it is one."""

from __future__ import annotations

from collections.abc import Iterator

from camnet.config.diagnose import Problem, show
from camnet.config.yaml_nodes import FieldPath
from camnet.errors import ConfigError, DataError
from camnet.motion.field_law import build_law
from camnet.motion.settings import FieldTarget, TargetSettings

__all__ = ["field_problems"]

_LAWS = ("velocity_mps", "acceleration_mps2", "grid", "entry")
#: settings that only some laws use
_ONLY = {
    "parameters": ("velocity_mps", "acceleration_mps2"),
    "of_time": ("entry",),
    "dimensions": ("entry",),
    "start_velocity_mps": ("acceleration_mps2", "entry"),
}


def field_problems(path: FieldPath, target: TargetSettings, motion: FieldTarget) -> Iterator[Problem]:
    """Yield what is wrong with the law of a target; ``path`` is that of its ``motion``."""
    given = [name for name in _LAWS if getattr(motion, name) is not None]
    if len(given) != 1:
        advice = f"give one of {', '.join(_LAWS)}; there are {len(given)}"
        yield Problem((*path, given[1]) if given else path, "", advice)
        return
    (law,) = given
    default = FieldTarget(kind="field")
    for name, laws in _ONLY.items():
        value = getattr(motion, name)
        if value != getattr(default, name) and law not in laws:
            yield Problem(
                (*path, name), show(value), f"is of no use with {law}, only with {' or '.join(laws)}"
            )
    if law == "grid" and motion.grid is not None and not motion.grid.is_file():
        advice = "no such file: paths start at the file's folder, or at data=FOLDER"
        yield Problem((*path, "grid"), show(str(motion.grid)), advice)
        return
    if target.start_m is None:
        yield Problem(
            (*path[:-1], "start_m"), "", "missing: a target of kind 'field' begins somewhere: [x, y] in m"
        )
    try:
        built = build_law(motion)
    except (ConfigError, DataError) as error:
        yield Problem((*path, law), "", str(error))
        return
    if built.dimensions == 2 and motion.start_height_m:
        advice = "the law has two components, so the target stays on the ground; give three for one in space"
        yield Problem((*path, "start_height_m"), show(motion.start_height_m), advice)
