"""Generated inputs, hostile and harmless, against every command that reads files.

    python3 scripts/robustness.py --seed 1 --cases 3000

Each case states its right answers: exit 0 with the result of the unchanged input, exit 2, or exit 1 with a stated
verdict or resource limit. A traceback, another result, a file left behind, more than 30 s of processor time or 4 GiB
are faults, and exit status 1 says that there are any. ``--json FILE`` writes counts and faults, ``--keep DIR`` the
inputs of the faults.
"""

from __future__ import annotations

import sys
from pathlib import Path

import _environment

ROOT = Path(__file__).resolve().parent.parent


def main() -> None:
    """Run the cases in the project's own environment."""
    _environment.prepare("test")
    raise SystemExit(_environment.start("-c", _PROGRAM, str(ROOT / "tests"), *sys.argv[1:]).wait())


_PROGRAM = "import sys; sys.path.insert(0, sys.argv.pop(1)); from robustness.program import main; main()"

if __name__ == "__main__":
    main()
