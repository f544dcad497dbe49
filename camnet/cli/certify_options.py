"""Which options of ``camnet certify`` each kind of input uses; elsewhere they are refused by name."""

from __future__ import annotations

import argparse

from camnet.cli.camera_arguments import CAMERA_OPTIONS

__all__ = ["check_learning", "refuse_two_ranges", "refuse_unused"]

#: options by the inputs that use them; elsewhere they are refused by name
_USED_BY = {
    "learn": ("world",),
    "model": ("world",),
    "overrides": ("world",),
    "duration": ("world",),
    "seed": ("world",),
    "targets": ("world",),
    "detections": ("world",),
    "tracks": ("site",),
    "fix_error": ("site",),
    "origin": ("site",),
    **dict.fromkeys(CAMERA_OPTIONS, ("site",)),
    "range": ("site",),
    "pixel_class": ("world", "site"),
    "footprint": ("roads",),
    "v_lo": ("world", "roads"),
    "unseen_max_m": ("world", "roads"),
    "stop_s": ("roads",),
    "check": ("roads",),
    "confidence": ("world",),
    "on_min": ("world", "roads"),
}
_OPTION = {"overrides": "--set", "pixel_class": "--class"}
_INPUTS = {"world": "a world file", "site": "--cameras DIR_OF_KRTD", "roads": "--roads NET"}


def refuse_unused(args: argparse.Namespace) -> None:
    """Refuse options that the kind of input does not use."""
    from camnet.errors import ConfigError

    kind = "world" if args.config is not None else ("roads" if args.roads is not None else "site")
    for name, kinds in _USED_BY.items():
        value = getattr(args, name)
        if value not in (None, False, []) and kind not in kinds:
            option = _OPTION.get(name, "--" + name.replace("_", "-"))
            where = " and ".join(_INPUTS[k] for k in kinds)
            given = option if value is True else f"{option} {value[0] if isinstance(value, list) else value}"
            raise ConfigError(f"{given}: applies to {where}, not to {_INPUTS[kind]}; leave it out")
    refuse_two_ranges(args)
    check_learning(args)
    if kind == "site" and args.tracks is None:
        for name in ("fix_error", "origin"):
            if getattr(args, name) is not None:
                option = "--" + name.replace("_", "-")
                raise ConfigError(f"{option} {getattr(args, name)}: is about recorded tracks; add --tracks")


def refuse_two_ranges(args: argparse.Namespace) -> None:
    """Refuse a range beside a class, which says how far cameras see."""
    from camnet.errors import ConfigError

    if args.pixel_class is not None and args.range is not None:
        raise ConfigError(
            f"--class {args.pixel_class} and --range {args.range:g}: the class says how far cameras see; give one"
        )


def check_learning(args: argparse.Namespace) -> None:
    """Refuse a length without a run to learn from, and a model beside one to learn."""
    from camnet.errors import ConfigError

    if args.duration is not None and not args.learn:
        raise ConfigError(f"--duration {args.duration:g}: is the length of the run of --learn; add --learn")
    if args.learn and args.model is not None:
        raise ConfigError(f"--learn and --model {args.model}: learn a model or give one, not both")
