"""What several commands read: a world, a learned motion, recorded tracks, the size of images."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from camnet.cli.arguments import numbers
from camnet.cli.common import overrides, progress_bar
from camnet.plugins import is_plugin, load_plugin

__all__ = ["image_size", "learned_model", "read_tracks", "world_of"]


def world_of(args: argparse.Namespace) -> Any:  # noqa: ANN401 - imported late
    """Load the world of the command line, its traffic expanded."""
    from camnet.cache_folder import cache_folder
    from camnet.config.load import load_scenario
    from camnet.config.models import Scenario
    from camnet.config.traffic import expand_traffic
    from camnet.errors import ConfigError

    scenario = load_scenario(args.config, overrides(args), seed=args.seed)
    if not isinstance(scenario, Scenario):
        raise ConfigError(
            f"{args.config}: kind 'recorded' is no network; give a network, or --cameras DIR_OF_KRTD"
        )
    return scenario if scenario.traffic is None else expand_traffic(scenario, cache_folder())


def learned_model(args: argparse.Namespace, scenario: Any) -> Any:  # noqa: ANN401 - imported late
    """Return the models that the command line asks for by target, learned now or loaded; None without any."""
    from camnet.experiments.learned_model import learn_models, load_models

    if args.model is not None:
        return load_models(args.model, scenario)
    if not args.learn:
        return None
    seconds = scenario.run.duration_s
    with progress_bar(seconds, "learning", "s", args.quiet) as advance:
        return learn_models(scenario, seconds, scenario.seed, advance)


def image_size(text: str) -> tuple[int, int]:
    """Read the width and height of ``--image``, px."""
    from camnet.errors import ConfigError
    from camnet.numerals import read_whole

    parts = text.lower().split("x")
    try:
        width, height = (read_whole(part, 1, 20_000) for part in parts)
    except ValueError as error:
        raise ConfigError(
            f"--image {text!r}: width x height in pixels was expected, such as 1920x1080 ({error})"
        ) from None
    return width, height


def read_tracks(args: argparse.Namespace) -> Any:  # noqa: ANN401 - imported late
    """Read ``--tracks``: ETH/UCY text, a CSV table, or ``module:attribute:FILE`` by a reader of another package."""
    from camnet.importers.csv_tracks import read_csv_tracks
    from camnet.importers.eth_tracks import read_eth_tracks
    from camnet.importers.fixes import TrackOptions
    from camnet.importers.geodesy import Origin

    origin = None
    if args.origin is not None:
        names = ("latitude", "longitude", "altitude")
        origin = Origin(*numbers("--origin", args.origin, names, "39.05,-85.53,205"))
    module, _, rest = str(args.tracks).partition(":")
    attribute, _, file = rest.partition(":")
    if file and is_plugin(f"{module}:{attribute}") and not args.tracks.exists():
        words = "a function of (path, options) that returns tracks"
        reader = load_plugin(f"{module}:{attribute}", "--tracks", words)
        return tuple(reader(Path(file), TrackOptions(origin=origin)))
    read = read_eth_tracks if args.tracks.suffix == ".txt" else read_csv_tracks
    return read(args.tracks, TrackOptions(origin=origin))
