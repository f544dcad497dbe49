"""Worlds that ship with camnet: ``<name>/world.yaml`` and its assets; no physics lives here.

``names``, ``path`` and ``describe`` list them (see ``catalogue``); any of them runs by its name:
``camnet simulate quickstart``. A world of one's own is a folder with a ``world.yaml``, or just such a file.
"""

if __name__ != "camnet.worlds":
    raise ImportError("import this package as camnet.worlds")

from camnet.worlds.catalogue import WorldSummary, describe, names, path

__all__ = ["WorldSummary", "describe", "names", "path"]
