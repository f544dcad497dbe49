"""``python -m camnet``: the same program as ``camnet``."""

from __future__ import annotations

from camnet.cli.program import program

if __name__ == "__main__":
    program()
