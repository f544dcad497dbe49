"""Worlds that ship with camnet: ``<name>/world.yaml`` and its assets; no physics lives here."""

if __name__ != "camnet.worlds":
    raise ImportError("import this package as camnet.worlds")
