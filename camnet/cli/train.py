"""``camnet train``: a policy by imitation and PPO on the batch back end."""

from __future__ import annotations

import argparse
import textwrap
from typing import Any

from camnet.cli.arguments import whole
from camnet.cli.common import add_common, progress_bar, say
from camnet.cli.output import print_json, resumed_folder, write_json
from camnet.cli.parser import suggestion

__all__ = ["add_parser"]

_DESCRIPTION = """Train one policy for all agents (needs the extra: pip install camnet[train]).

The policy first imitates a built-in agent, then improves by PPO (Stable-Baselines3) on many environments at once. The
same command with the same seed gives the same policy; a run that was stopped goes on when the command is given again.

  camnet train --world quickstart --seed 1 --out runs/train
  camnet evaluate --world loop_8 --agents runs/train/policy.npz,nearest,ekf --episodes 50
  tensorboard --logdir runs/train/tensorboard

--out gets policy.npz (weights and a JSON description, nothing that runs), checkpoint.pt, result.json, tensorboard/.
Settings (--set KEY=VALUE), with their defaults:
{settings}"""


_FILES = ("policy.npz", "checkpoint.pt", "result.json", "tensorboard/*")


def add_parser(commands: Any) -> None:  # noqa: ANN401 - argparse publishes no type for it
    """Register the command."""
    from camnet.training.settings import TrainSettings

    names = ", ".join(
        f"{name}={_written(field.default)}" for name, field in TrainSettings.model_fields.items()
    )
    parser = commands.add_parser(
        "train",
        help="train a policy: imitation, then PPO on many environments at once",
        description=_DESCRIPTION.format(settings=textwrap.fill(names, 110, break_on_hyphens=False)),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "--world", metavar="W,W", help="worlds to train on, comma-separated (default quickstart)"
    )
    parser.add_argument(
        "--steps", type=whole(1, 10**12), metavar="N", help="decisions of single agents (default 4,000,000)"
    )
    parser.add_argument(
        "--set", action="append", default=[], metavar="KEY=VALUE", dest="overrides", help="change one setting"
    )
    add_common(parser, "runs/train-seedN; the same command goes on there")
    parser.set_defaults(run=run)


def _written(value: object) -> str:
    """Write a default as ``--set`` takes it."""
    if isinstance(value, tuple):
        return f"[{','.join(map(str, value))}]"
    return "null" if value is None else str(value)


def run(args: argparse.Namespace) -> int:
    """Train and write."""
    from pathlib import Path

    from camnet.errors import ConfigError

    settings = _settings(args)
    try:
        import stable_baselines3  # noqa: F401 - only whether it is there
    except ImportError:
        raise ConfigError("camnet train needs Stable-Baselines3: pip install 'camnet[train]'") from None
    from camnet.training.train import train

    seed = args.seed or 0
    out = Path(f"runs/train-seed{seed}" if args.out is None else args.out)
    with resumed_folder(out, "train", _FILES, args.force) as folder:
        with progress_bar(100, "train", "%", args.quiet) as advance:
            result = train(settings, seed, folder, lambda share, words: advance(100 * share, words))
        result = {**result, "policy": str(out / "policy.npz")}
        result = {**result, "seed": seed, "settings": settings.model_dump(mode="json")}
        write_json(folder / "result.json", result)
    if args.json:
        print_json(result)
    else:
        last = result["episodes"][-1] if result["episodes"] else {}
        print(
            f"{result['steps']} steps; last episodes: " + ", ".join(f"{k} {v:.4g}" for k, v in last.items())
        )
    say(
        f"wrote {out / 'policy.npz'}; score it with: camnet evaluate --world W --agents {out}/policy.npz,nearest"
    )
    return 0


def _settings(args: argparse.Namespace) -> Any:  # noqa: ANN401 - imported late
    from pydantic import ValidationError

    from camnet.errors import ConfigError
    from camnet.training.settings import TrainSettings

    values: dict[str, Any] = {}
    short = {
        name: option
        for name, option, given in (("worlds", "--world", args.world), ("steps", "--steps", args.steps))
        if given is not None
    }
    for text in args.overrides:
        name, equals, value = text.partition("=")
        if name in TrainSettings.model_fields and not equals:
            raise ConfigError(
                f"--set {text!r}: give a value, as in {name}={_written(TrainSettings.model_fields[name].default)}"
            )
        if not equals or name not in TrainSettings.model_fields:
            raise ConfigError(
                f"--set {text!r}: give KEY=VALUE; {suggestion(name, TrainSettings.model_fields)}"
            )
        if name in short:
            raise ConfigError(f"--set {text}: {short[name]} sets this too; give one of them")
        values[name] = _value(text, value)
    if args.world is not None:
        values["worlds"] = tuple(part.strip() for part in args.world.split(",") if part.strip())
    if args.steps is not None:
        values["steps"] = args.steps
    try:
        return TrainSettings.model_validate(values)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        raise ConfigError(f"training setting {where} = {first['input']!r}: {first['msg']}") from error


def _value(text: str, value: str) -> Any:  # noqa: ANN401 - any YAML
    from camnet.config.yaml_nodes import Origin, parse_yaml

    return parse_yaml(value, Origin(f"--set {text}")).plain()
