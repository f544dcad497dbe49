"""Lint, types, import contracts and tests, in the project's own environment.

``--slow`` adds the long reproductions; every other argument goes to pytest. Types are checked beside the tests; what is
found is printed at the end.
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
    _environment.run("-c", "from importlinter.cli import lint_imports_command as c; c()")
    types = _environment.start("-m", "mypy", quiet=True)
    try:
        tests = _environment.start("-m", "pytest", "-n", "2", "--dist", "loadscope", "-q", *arguments).wait()
        said, _ = types.communicate()
    finally:
        types.kill()
    print(f"mypy: {said.strip()}", flush=True)
    failed = [name for name, status in (("types", types.returncode), ("tests", tests)) if status]
    print(
        f"FAILED: {', '.join(failed)}" if failed else "lint, import contracts, types and tests passed",
        flush=True,
    )
    raise SystemExit(types.returncode or tests)


if __name__ == "__main__":
    main()
