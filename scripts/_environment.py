"""Make the project's virtual environment with the standard library alone."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
import venv
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
VENV = ROOT / ".venv"
#: numerical libraries share two cores badly; one thread each also keeps sums in one order
THREADS = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")


def python() -> Path:
    """Return the interpreter of the environment."""
    return VENV / ("Scripts/python.exe" if os.name == "nt" else "bin/python")


def prepare(extras: str = "") -> Path:
    """Create ``.venv``, install camnet in it (editable) with ``extras``, and return its interpreter.

    Installation is skipped while ``pyproject.toml`` and the extras are those of the last one.
    """
    if sys.version_info < (3, 11):
        raise SystemExit(f"camnet needs Python 3.11 or newer; this is {sys.version.split()[0]}")
    if not python().exists():
        print(f"making {VENV} ...", flush=True)
        venv.create(VENV, with_pip=True)
    mark = VENV / f".camnet-installed{'-' + extras if extras else ''}"
    state = hashlib.sha256((ROOT / "pyproject.toml").read_bytes()).hexdigest()
    if not mark.exists() or mark.read_text() != state:
        print("installing camnet and what it needs (about a minute) ...", flush=True)
        target = f"{ROOT}[{extras}]" if extras else str(ROOT)
        # byte code is made on first import, of what is used
        options = ("--quiet", "--disable-pip-version-check", "--no-compile")
        run("-m", "pip", "install", *options, "--editable", target)
        mark.write_text(state)
    return python()


def start(*arguments: str, quiet: bool = False) -> subprocess.Popen[str]:
    """Start the environment's interpreter in the project's root; what it says is kept for later if ``quiet``."""
    return subprocess.Popen(
        [str(python()), *arguments],
        cwd=ROOT,
        env={**os.environ, **THREADS},
        stdout=subprocess.PIPE if quiet else None,
        stderr=subprocess.STDOUT if quiet else None,
        text=True,
    )


def run(*arguments: str) -> None:
    """Run the environment's interpreter in the project's root; leave with its status if it fails."""
    status = start(*arguments).wait()
    if status:
        raise SystemExit(status)
