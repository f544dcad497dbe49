"""Units in configuration files: every number is SI (pixels in images), and its key's suffix says so.

Used for advice only: a key or a value in another unit is never converted silently.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from camnet.config.yaml_nodes import Value

__all__ = ["Unit", "convert", "split_unit", "text_with_unit"]


@dataclass(frozen=True, slots=True)
class Unit:
    """A unit: what it measures, its size in SI and its name; ``si`` marks those that configurations use."""

    dimension: str
    factor: float
    words: str
    si: bool = False


_DEG = math.pi / 180.0

#: key suffix -> unit
_UNITS: dict[str, Unit] = {
    "m": Unit("length", 1.0, "metres", True),
    "mm": Unit("length", 1e-3, "millimetres"),
    "cm": Unit("length", 1e-2, "centimetres"),
    "km": Unit("length", 1e3, "kilometres"),
    "ft": Unit("length", 0.3048, "feet"),
    "inch": Unit("length", 0.0254, "inches"),
    "s": Unit("time", 1.0, "seconds", True),
    "ms": Unit("time", 1e-3, "milliseconds"),
    "us": Unit("time", 1e-6, "microseconds"),
    "min": Unit("time", 60.0, "minutes"),
    "h": Unit("time", 3600.0, "hours"),
    "rad": Unit("angle", 1.0, "radians", True),
    "mrad": Unit("angle", 1e-3, "milliradians"),
    "deg": Unit("angle", _DEG, "degrees"),
    "mps": Unit("speed", 1.0, "metres per second", True),
    "kmh": Unit("speed", 1 / 3.6, "kilometres per hour"),
    "kph": Unit("speed", 1 / 3.6, "kilometres per hour"),
    "mph": Unit("speed", 0.44704, "miles per hour"),
    "knots": Unit("speed", 1852 / 3600, "knots"),
    "mps2": Unit("acceleration", 1.0, "metres per second squared", True),
    "radps": Unit("angular speed", 1.0, "radians per second", True),
    "degps": Unit("angular speed", _DEG, "degrees per second"),
    "rpm": Unit("angular speed", math.pi / 30.0, "revolutions per minute"),
    "hz": Unit("frequency", 1.0, "hertz", True),
    "khz": Unit("frequency", 1e3, "kilohertz"),
    "fps": Unit("frequency", 1.0, "frames per second"),
    "kg": Unit("mass", 1.0, "kilograms", True),
    "g": Unit("mass", 1e-3, "grams"),
    "lb": Unit("mass", 0.45359237, "pounds"),
    "px": Unit("image length", 1.0, "pixels", True),
    "per_s": Unit("rate", 1.0, "per second", True),
    "per_min": Unit("rate", 1 / 60.0, "per minute"),
    "kgm2": Unit("inertia", 1.0, "kg m^2", True),
}

_WRITTEN = {
    "°": "deg",
    "degree": "deg",
    "degrees": "deg",
    "metre": "m",
    "metres": "m",
    "meter": "m",
    "meters": "m",
    "in": "inch",
    "sec": "s",
    "seconds": "s",
    "minutes": "min",
    "hours": "h",
    "m/s": "mps",
    "km/h": "kmh",
    "rad/s": "radps",
    "deg/s": "degps",
    "°/s": "degps",
    "m/s^2": "mps2",
    "m/s2": "mps2",
    "1/s": "per_s",
    "pixel": "px",
    "pixels": "px",
}

_SUFFIXES = sorted(_UNITS, key=len, reverse=True)
_NUMBER_AND_UNIT = re.compile(r"^\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*([^\d\s].*?)\s*$")


def split_unit(key: str) -> tuple[str, Unit | None]:
    """Split ``near_m`` into ``("near", metres)``; a key without a known unit comes back whole with None."""
    for suffix in _SUFFIXES:
        if key.endswith(f"_{suffix}") and len(key) > len(suffix) + 1:
            return key[: -len(suffix) - 1], _UNITS[suffix]
    return key, None


def text_with_unit(text: str) -> tuple[float, Unit] | None:
    """Read ``"30 deg"`` or ``"5cm"``; None when the text is not a number followed by a known unit."""
    match = _NUMBER_AND_UNIT.match(text)
    if match is None:
        return None
    written = match.group(2).lower()
    unit = _UNITS.get(_WRITTEN.get(written, written))
    return None if unit is None else (float(match.group(1)), unit)


def convert(value: Value, given: Unit, wanted: Unit) -> str | None:
    """Say what ``value`` is in the wanted unit, or None when it is no number (or list of numbers) of that dimension."""
    if given.dimension != wanted.dimension:
        return None
    if isinstance(value, list):
        items = [convert(item, given, wanted) for item in value]
        return None if None in items or not items else f"[{', '.join(str(item) for item in items)}]"
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    return f"{value * given.factor / wanted.factor:.6g}"
