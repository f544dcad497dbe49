"""Worlds: spoilt, wrong in what they say, or written in another way."""

from __future__ import annotations

import copy
import json
from collections.abc import Callable, Iterator
from random import Random
from typing import Any

from robustness import inputs
from robustness.case import Case, Nature, changed
from robustness.stage import COMMANDS
from robustness.text import bad_number, broken_text, misspelt
from robustness.yaml_writer import write_world

__all__ = ["BROKEN", "HARMLESS", "MEANING"]

_FILE = "world.yaml"
_Change = Callable[[Random, dict[str, Any]], tuple[str, ...]]

#: key -> factor and the unit that a careless user takes for it
_UNITS = {
    "_m": (100.0, "_cm"),
    "_s": (1000.0, "_ms"),
    "_mps": (3.6, "_kmh"),
    "_rad": (57.3, "_deg"),
    "_hz": (1e-3, "_khz"),
}


def _command(rng: Random) -> Any:
    return COMMANDS[rng.choice(("certify world", "simulate world", "simulate world"))]


def leaves(node: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[tuple[Any, ...], Any]]:
    """Yield every scalar of plain data with its path."""
    items = node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else ()
    for key, child in items:
        yield from leaves(child, (*path, key))
    if not isinstance(node, dict | list):
        yield path, node


def _put(world: dict[str, Any], path: tuple[Any, ...], value: Any) -> None:
    node: Any = world
    for key in path[:-1]:
        node = node[key]
    node[path[-1]] = value


def _named(path: tuple[Any, ...]) -> str:
    return next(str(part) for part in reversed(path) if isinstance(part, str))


def _numbers(world: dict[str, Any]) -> list[tuple[tuple[Any, ...], float]]:
    return [(p, v) for p, v in leaves(world) if isinstance(v, int | float) and not isinstance(v, bool)]


def _mappings(node: Any) -> Iterator[dict[str, Any]]:
    if isinstance(node, dict):
        yield node
    for child in node.values() if isinstance(node, dict) else node if isinstance(node, list) else ():
        yield from _mappings(child)


# --- wrong in what they say: each returns words of which the message holds one -----------------------------


def _key_misspelt(rng: Random, world: dict[str, Any]) -> tuple[str, ...]:
    holder = rng.choice([m for m in _mappings(world) if any(len(key) > 3 for key in m)])
    key = rng.choice([key for key in holder if len(key) > 3 and key not in ("kind", "type")])
    slip = misspelt(rng, key, set(holder))
    items = [(slip if name == key else name, value) for name, value in holder.items()]
    holder.clear()
    holder.update(items)
    return (slip,)


def _other_unit(rng: Random, world: dict[str, Any]) -> tuple[str, ...]:
    choices = [
        (m, key, end)
        for m in _mappings(world)
        for key in m
        for end in _UNITS
        if key.endswith(end) and m[key] is not True
    ]
    holder, key, end = rng.choice(choices)
    factor, unit = _UNITS[end]
    value = holder.pop(key)
    scaled = json.loads(json.dumps(value), parse_float=lambda text: factor * float(text))
    holder[key.removesuffix(end) + unit] = scaled
    return (key.removesuffix(end) + unit,)


def _text_for_number(rng: Random, world: dict[str, Any]) -> tuple[str, ...]:
    path, value = rng.choice(_numbers(world))
    _put(
        world,
        path,
        rng.choice((f"{value} m", str(value), True, None, [value], {"value": value}, f"{value},0")),
    )
    return (_named(path),)


def _magnitude(rng: Random, world: dict[str, Any]) -> tuple[str, ...]:
    path, value = rng.choice(_numbers(world))
    huge = 10.0 ** rng.uniform(9.5, 300.0)
    _put(world, path, int(huge) if isinstance(value, int) and huge < 1e30 else rng.choice((1.0, -1.0)) * huge)
    return (_named(path), str(path[0]))


_POSITIVE = ("near_m", "far_m", "fx_px", "fy_px", "width_px", "height_px", "speed_mps", "duration_s", "radius_m",
             "decision_hz", "rate_hz", "cx_px", "cy_px")  # fmt: skip


def _not_positive(rng: Random, world: dict[str, Any]) -> tuple[str, ...]:
    path, value = rng.choice([(p, v) for p, v in _numbers(world) if p[-1] in _POSITIVE])
    _put(world, path, rng.choice((0, -value, -1, -0.0)))
    return (str(path[-1]),)


def _unknown_reference(rng: Random, world: dict[str, Any]) -> tuple[str, ...]:
    section, key = rng.choice((("agents", "region"), ("agents", "camera"), ("targets", "road")))
    item = rng.choice(world[section])
    holder = item["motion"] if section == "targets" else item
    holder[key] = misspelt(rng, holder[key], {"east", "west", "lens", "loop"})
    return (holder[key],)


def _name_twice(rng: Random, world: dict[str, Any]) -> tuple[str, ...]:
    section = rng.choice(("cameras", "regions", "agents", "occluders", "roads", "targets"))
    if len(world[section]) > 1 and rng.random() < 0.5:
        world[section][1]["name"] = world[section][0]["name"]
    else:
        world[section].append(copy.deepcopy(rng.choice(world[section])))
    return ("name", "region", section)


def _bad_name(rng: Random, world: dict[str, Any]) -> tuple[str, ...]:
    item = rng.choice(world[rng.choice(("cameras", "regions", "agents", "occluders", "roads", "targets"))])
    item["name"] = rng.choice(
        ("", "a b", "<script>", "a|b", "../x", "naïve", "a\nb", "`x`", ".hidden", "a/b", 7, None)
    )
    return ("name",)


def _regions_overlap(rng: Random, world: dict[str, Any]) -> tuple[str, ...]:
    shift = rng.uniform(1.6, 5.4)
    shape = world["regions"][1]["shape"]
    for end in ("min_m", "max_m"):
        shape[end][0] += shift
    world["agents"][1]["start_m"][0] += shift
    return ("overlaps",)


def _region_inside_out(rng: Random, world: dict[str, Any]) -> tuple[str, ...]:
    shape, axis = rng.choice(world["regions"])["shape"], rng.randrange(3)
    shape["min_m"][axis], shape["max_m"][axis] = shape["max_m"][axis], shape["min_m"][axis]
    return ("shape",)


def _region_too_small(rng: Random, world: dict[str, Any]) -> tuple[str, ...]:
    shape, axis = rng.choice(world["regions"])["shape"], rng.randrange(3)
    shape["max_m"][axis] = shape["min_m"][axis] + rng.uniform(0.0, 0.45)
    return ("shape",)


def _agent_outside(rng: Random, world: dict[str, Any]) -> tuple[str, ...]:
    agent = rng.choice(world["agents"])
    k = rng.randrange(3)
    agent["start_m"][k] += rng.choice((-1.0, 1.0)) * rng.uniform(2.3, 40.0)
    return ("start_m",)


def _axes_exchanged(rng: Random, world: dict[str, Any]) -> tuple[str, ...]:
    agent = rng.choice(world["agents"])
    x, y, z = agent["start_m"]
    agent["start_m"] = [y, z, x] if rng.random() < 0.5 else [z, y, x] if x < 0 else [y, x, z]
    return ("start_m",)


def _target_far(rng: Random, world: dict[str, Any]) -> tuple[str, ...]:
    target = world["targets"][0]
    factor = rng.choice((39.37, 100.0, 1000.0, 1e5))
    target["start_m"] = [factor * x for x in target["start_m"]]
    return ("start_m",)


def _degrees(rng: Random, world: dict[str, Any]) -> tuple[str, ...]:
    holder, key = rng.choice(
        ((world["targets"][0], "start_heading_rad"), (world["agents"][0], "start_yaw_rad"))
    )
    holder[key] = rng.choice((-1, 1)) * rng.choice((45, 90, 180, 270, 360, rng.uniform(7.0, 360.0)))
    return (key,)


def _too_wide(rng: Random, world: dict[str, Any]) -> tuple[str, ...]:
    inside = world["cameras"][0]["intrinsics"]
    key = rng.choice(("fx_px", "fy_px"))
    inside[key] = rng.choice((inside[key] / 1000.0, rng.uniform(0.01, 15.0), 4.2))
    return (key,)


def _camera_order(rng: Random, world: dict[str, Any]) -> tuple[str, ...]:
    camera = world["cameras"][0]
    if rng.random() < 0.5:
        camera["near_m"], camera["far_m"] = camera["far_m"], camera["near_m"]
        return ("near_m",)
    inside, axis = camera["intrinsics"], rng.choice("xy")
    inside[f"c{axis}_px"] = rng.uniform(1.0, 3.0) * inside["width_px" if axis == "x" else "height_px"]
    return (f"c{axis}_px",)


def _too_fast(rng: Random, world: dict[str, Any]) -> tuple[str, ...]:
    world["targets"][0]["motion"]["speed_mps"] = rng.uniform(0.7, 30.0)
    return ("speed_mps", "v_max_mps")


def _rates(rng: Random, world: dict[str, Any]) -> tuple[str, ...]:
    section, key = rng.choice((("run", "decision_hz"), ("sensing", "rate_hz"), ("run", "log_hz")))
    world.setdefault(section, {})[key] = rng.choice((7.3, 11.0, 59.9, 1000.0, 0.7, 13))
    return (key,)


def _road(rng: Random, world: dict[str, Any]) -> tuple[str, ...]:
    road = world["roads"][0]
    way = rng.randrange(4)
    if way == 0:
        road["closed"] = False
    elif way == 1:
        road["points_m"] = [road["points_m"][0]] * rng.randrange(1, 5)
    elif way == 2:
        road["points_m"][1], road["points_m"][3] = road["points_m"][3], road["points_m"][1]
    else:
        road["points_m"] = road["points_m"][:2]
    return ("road", "points_m", "turns")


def _wrong_length(rng: Random, world: dict[str, Any]) -> tuple[str, ...]:
    path, _ = rng.choice([(p, v) for p, v in _numbers(world) if isinstance(p[-1], int)])
    node: Any = world
    for key in path[:-1]:
        node = node[key]
    if rng.random() < 0.5:
        node.pop()
    else:
        node.append(1.0)
    return (_named(path),)


def _section_lost(rng: Random, world: dict[str, Any]) -> tuple[str, ...]:
    section = rng.choice(("cameras", "regions", "agents", "roads", "targets"))
    if rng.random() < 0.5:
        del world[section]
    else:
        world[section] = rng.choice(([], None, {}, "none", 3))
    return (section, "region", "road", "camera")


def _unreachable_size(rng: Random, world: dict[str, Any]) -> tuple[str, ...]:
    section, key, value = rng.choice(
        (
            ("handoff", "rollout_dt_s", 10.0 ** rng.uniform(-9, -3)),
            ("handoff", "lookahead_s", 10.0 ** rng.uniform(4, 8)),
            ("run", "duration_s", 10.0 ** rng.uniform(7, 9)),
            ("sensing", "latency_s", 10.0 ** rng.uniform(4, 8)),
            ("physics", "step_hz", 240 * rng.randrange(1000, 100_000)),
            ("estimator", "stack", {"size": rng.randrange(20_001, 10**9)}),
            ("estimator", "basis", {"max_kernels": rng.randrange(4001, 10**9)}),
            ("estimator", "regression_samples", rng.randrange(10_001, 10**9)),
            ("seed", "", rng.choice((-1, 2**53, -(2**31), 10**30))),
        )
    )
    if key:
        world.setdefault(section, {})[key] = value
    else:
        world[section] = value
    return (key or section, "size", "max_kernels")


def _in_a_solid(rng: Random, world: dict[str, Any]) -> tuple[str, ...]:
    x, y, z = rng.choice(world["agents"])["start_m"]
    radius = rng.uniform(0.1, 1.0)
    world["occluders"][0]["shape"] |= {
        "center_m": [x, y],
        "radius_m": radius,
        "z_m": [0.0, z + rng.uniform(0.1, 1.0)],
    }
    return ("crate",)


_CHANGES: dict[str, _Change] = {
    "key misspelt": _key_misspelt,
    "another unit in the key": _other_unit,
    "another type": _text_for_number,
    "magnitude": _magnitude,
    "not positive": _not_positive,
    "unknown reference": _unknown_reference,
    "name twice": _name_twice,
    "bad name": _bad_name,
    "regions overlap": _regions_overlap,
    "region inside out": _region_inside_out,
    "region too small": _region_too_small,
    "agent outside": _agent_outside,
    "axes exchanged": _axes_exchanged,
    "target far away": _target_far,
    "degrees": _degrees,
    "view too wide": _too_wide,
    "camera numbers out of order": _camera_order,
    "faster than its bound": _too_fast,
    "rates that do not divide": _rates,
    "impossible road": _road,
    "list of another length": _wrong_length,
    "section lost": _section_lost,
    "size without end": _unreachable_size,
    "agent in a solid": _in_a_solid,
}


def _meaning(label: str, change: _Change) -> Callable[[Random], Case]:
    def make(rng: Random) -> Case:
        while True:
            world = copy.deepcopy(inputs.WORLD)
            mentions = change(rng, world)
            if world != inputs.WORLD:
                break
        return changed("yaml", label, Nature.MEANING, _command(rng), _FILE, inputs.dump(world), *mentions)

    return make


def _bad_scalar(rng: Random) -> Case:
    """A number written as no number is, though other programs take it for one."""
    text = inputs.dump(inputs.WORLD)
    path, value = rng.choice([(p, v) for p, v in _numbers(inputs.WORLD) if not isinstance(p[-1], int)])
    label, bad = bad_number(rng, ",")
    old = f"{path[-1]}: {value}"
    assert old in text, (old, text)
    spoilt = text.replace(old, f"{path[-1]}: {bad}", 1)
    return changed(
        "yaml", f"number: {label}", Nature.MEANING, _command(rng), _FILE, spoilt, str(path[-1]), "YAML", _FILE
    )


_WORDS = (
    ("--seed", "-1"), ("--seed", "1_0"), ("--seed", "1.5"), ("--seed", "99999999999999999999"), ("--seed", "\u0663"),
    ("--set", "run.duration=3"), ("--set", "agents.9.start_m=[1, 2, 3]"), ("--set", "=3"), ("--set", "seed"),
    ("--set", "targets.robto.start_m=[3, -1]"), ("--set", "sensing.rate_hz=thirty"), ("--set", "sensing.rate_hz=.inf"),
    ("--set", "run.estimators=[]"), ("--set", "run.estimators=[learnt]"), ("--set", "run.log_hz=1e-9999"),
    ("--set", "seed=[" + 60 * "["), ("--model", "nothing.npz"), ("--model", "world.yaml"), ("--unknown", "1"),
)  # fmt: skip


def _words(rng: Random) -> Case:
    """Words of the command line that no one may mean."""
    words = rng.choice(_WORDS)
    return Case("yaml", "words of the command line", Nature.MEANING, _command(rng), {}, words)


MEANING = [_meaning(label, change) for label, change in _CHANGES.items()] + [_bad_scalar, _bad_scalar, _words]


# --- broken, and harmless ----------------------------------------------------------------------------------


def _broken(rng: Random) -> Case:
    text = inputs.dump(inputs.WORLD)
    ways = {
        "tab": text.replace("\n  ", "\n\t", 1),
        "bracket": text.replace("]", "", 1),
        "two documents": text + "---\n" + text,
        "tag": text + "note: !!python/object/apply:os.system [echo]\n",
        "deep": text + "note: " + "[" * rng.randrange(41, 20_000) + "\n",
        "aliases": "a: &a [x, x, x, x, x, x, x, x]\n"
        + "".join(
            f"{b}: &{b} [{', '.join([f'*{a}'] * 8)}]\n" for a, b in zip("abcdefg", "bcdefgh", strict=True)
        ),
        "itself": "name: &a [*a]\n",
        "huge": text + "#" * 4_000_000,
        "many": text + "note: [" + "1, " * 300_000 + "1]\n",
        "list": "- " + text.replace("\n", "\n  "),
        "key twice": text + text.splitlines()[0] + "\n",
        "merge key": text + "<<: {seed: 1}\n",
        "set": text + "note: ? a\n",
    }
    label = rng.choice([*ways, "text", "text", "text"])
    if label == "text":
        label, content = broken_text(rng, text, 0.0, 0.8)
        return changed("yaml", label, Nature.BROKEN, _command(rng), _FILE, content, _FILE)
    return changed("yaml", label, Nature.BROKEN, _command(rng), _FILE, ways[label], _FILE)


def _rewritten(rng: Random) -> Case:
    label, content = write_world(rng, inputs.WORLD)
    return changed("yaml", f"rewritten: {label}", Nature.HARMLESS, _command(rng), _FILE, content)


BROKEN = [_broken]
HARMLESS = [_rewritten]
