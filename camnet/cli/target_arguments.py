"""Options that certify, design and coverage share: the target class, what is allowed out of view, pixel classes."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from camnet.cli.arguments import non_negative
from camnet.cli.common import positive
from camnet.numerals import read_decimal

__all__ = ["add_detections", "add_pixel_class", "add_target_class", "detections"]


def add_pixel_class(group: Any, words: str) -> None:  # noqa: ANN401 - argparse publishes no type for it
    """Add ``--class``, whose names are those of EN 62676-4:2015."""
    from camnet.geometry.pixel_classes import PIXEL_CLASSES

    names = ", ".join(f"{name} {least:g}" for name, least in PIXEL_CLASSES.items())
    group.add_argument(
        "--class",
        dest="pixel_class",
        choices=tuple(PIXEL_CLASSES),
        metavar="CLASS",
        help=f"{words}: {names} px/m",
    )


def add_detections(group: Any) -> None:  # noqa: ANN401 - argparse publishes no type for it
    """Add when a target in view of a fixed camera counts as seen."""
    group.add_argument(
        "--detections",
        metavar="N,P,HZ[,Q[,S]]",
        help="a world's targets count as seen by a fixed camera after N detections with probability Q (default 0.99): "
        "HZ frames in a second, each a detection with probability P, known S seconds later (default 0): 3,0.8,10",
    )


def detections(text: str) -> Any:  # noqa: ANN401 - imported late
    """Return the settings of ``--detections``.

    Raises
    ------
    ConfigError
        The text is no such list.
    """
    from camnet.certification.settings import DetectionSettings
    from camnet.errors import ConfigError

    parts = text.split(",")
    try:
        if not 3 <= len(parts) <= 5:
            raise ValueError(f"{len(parts)} numbers")
        values = [read_decimal(part) for part in parts] + [0.99, 0.0][len(parts) - 3 :]
        count, probability, rate_hz, confidence, latency_s = values
        if count != int(count):
            raise ValueError(f"N = {count:g}")
        return DetectionSettings(
            rate_hz=rate_hz,
            probability=probability,
            count=int(count),
            confidence=confidence,
            latency_s=latency_s,
        )
    except ValueError as error:
        why = str(error).splitlines()[0] if not hasattr(error, "errors") else _first_fault(error)
        raise ConfigError(
            f"--detections {text}: {why}: a whole number N from 1 on, a probability P above 0 and up to 1, frames a "
            "second HZ above 0, a probability Q below 1, seconds S from 0 on were expected, such as 3,0.8,10,0.99,0.2"
        ) from None


def _first_fault(error: Any) -> str:  # noqa: ANN401 - pydantic's
    fault = error.errors()[0]
    return f"{'.'.join(map(str, fault['loc']))}: {fault['msg'].lower()}"


def add_target_class(parser: argparse.ArgumentParser) -> None:
    """Add the target class and the dwell times that a designer states."""
    group = parser.add_argument_group("target class and dwell times (defaults: the world's)")
    group.add_argument("--v-max", type=positive, metavar="MPS", help="bound of the targets' speed, m/s")
    group.add_argument("--v-lo", type=positive, metavar="MPS", help="least speed on roads, m/s")
    group.add_argument("--extent", type=positive, metavar="M", help="radius of the targets' extent, m")
    group.add_argument("--off-max", type=positive, metavar="S", help="longest time out of view allowed, s")
    group.add_argument(
        "--unseen-max-m",
        type=positive,
        metavar="M",
        help="longest way out of view allowed, m; needs no speed",
    )
    group.add_argument(
        "--check",
        metavar="TRAFFIC",
        type=Path,
        help="with --roads: replay recorded traffic (SUMO's FCD, or tracks .csv) and list every broken promise",
    )
    group.add_argument(
        "--stop-s",
        type=non_negative,
        metavar="S",
        help="longest time that targets on --roads stand still while unseen, s (default 0)",
    )
    group.add_argument("--on-min", type=positive, metavar="S", help="least time in view needed, s")
    group.add_argument(
        "--model-error",
        type=_model_error,
        metavar="MPS",
        help="stated velocity error of the model, m/s; or 'conformal': from the gaps of --learn or --model, no truth "
        "needed",
    )
    group.add_argument(
        "--confidence",
        type=_share,
        metavar="P",
        help="of --model-error conformal: share of the gaps that keep to it, statistically (default 0.95)",
    )
    group.add_argument(
        "--initial-error", type=positive, metavar="M", help="position error when a target is lost, m"
    )


def _share(text: str) -> float:
    """Parse a number strictly between 0 and 1, for argparse."""
    value = positive(text)
    if value >= 1.0:
        raise argparse.ArgumentTypeError(f"{text!r}: a number between 0 and 1 was expected")
    return value


def _model_error(text: str) -> float | str:
    """Parse a velocity, m/s, or the word ``conformal``, for argparse."""
    return text if text == "conformal" else positive(text)
