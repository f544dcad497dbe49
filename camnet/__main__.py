"""``python -m camnet``: the same program as ``camnet``."""

from __future__ import annotations

import sys

from camnet.cli.main import main

if __name__ == "__main__":
    sys.exit(main())
