"""Exceptions raised on misuse; expected failure (a refused certificate) is a result, not an exception."""

from __future__ import annotations

__all__ = [
    "CamnetError",
    "CertificateError",
    "ConfigError",
    "DataError",
    "OutputError",
    "SimulationError",
    "WorkerError",
    "WorldError",
]


class CamnetError(Exception):
    """Base of every error that camnet raises on purpose; the command line turns it into exit status 2."""


class ConfigError(CamnetError):
    """A world file, recipe or override is wrong.

    The message names the file, the line and the field, quotes the value and says what would be right.
    """


class DataError(CamnetError):
    """A recorded input (camera file, track, road network) cannot be read as what it claims to be."""


class WorldError(CamnetError):
    """A world cannot be built from a valid configuration (overlapping regions, agent outside its region)."""


class CertificateError(CamnetError):
    """A certificate was asked of inputs for which its formulas are not defined."""


class SimulationError(CamnetError):
    """The simulation left its domain (NaN, divergence); names the body and the step. Exit status 1."""


class OutputError(CamnetError):
    """Results could not be written (full disk, no permission); says where what was written is. Exit status 1."""


class WorkerError(CamnetError):
    """A worker process ended before its work was done; says how, and how much is done. Exit status 1."""
