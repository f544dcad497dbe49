"""Lint, types, import contracts and tests, in the project's own environment.

``--slow`` adds the long reproductions; every other argument goes to pytest.
"""

from __future__ import annotations

import sys

import _environment


def main() -> None:
    """Run every check; the first that fails gives the exit status."""
    _environment.prepare("test")
    arguments = sys.argv[1:]
    _environment.run("-m", "ruff", "check", ".")
    _environment.run("-m", "ruff", "format", "--check", ".")
    _environment.run("-m", "mypy")
    _environment.run("-c", "from importlinter.cli import lint_imports_command as c; c()")
    _environment.run("-m", "pytest", "-n", "2", "--dist", "loadscope", "-q", *arguments)


if __name__ == "__main__":
    main()
