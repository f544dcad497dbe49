"""camnet: a multi-agent camera-network simulator with control.

Read next: ``camnet.config`` (what a world is), ``camnet.simulation`` (the closed loop),
``camnet.estimation`` (how a target's motion is learned), ``camnet.certification`` (what is guaranteed)
and ``camnet.env.handoff_v0`` (the multi-agent environment).
"""

from importlib.metadata import PackageNotFoundError, version

try:
    __version__ = version("camnet")
except PackageNotFoundError:  # a source tree that was never installed
    __version__ = "0+unknown"

__all__ = ["__version__"]
