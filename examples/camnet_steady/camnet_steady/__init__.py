"""Parts for camnet: an estimator, an agent, a law of motion and a reader of tracks, each as small as it can be."""

from camnet_steady.agent import Hover
from camnet_steady.estimator import steady
from camnet_steady.reader import read_xyt
from camnet_steady.target import whirl

__all__ = ["Hover", "read_xyt", "steady", "whirl"]
