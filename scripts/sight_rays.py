"""Compare the package's sight lines with PyBullet's rays in many random cases: cameras, solids, points.

    python scripts/sight_rays.py --cases 1000000 --seed 2

Prints the figures as one JSON object; exit status 1 if a disagreement is farther than 1 cm from an edge of the view
or of a solid, or if fewer than a fifth of the points are in view or fewer than a tenth within 10 cm of an edge.
"""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import asdict
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))
from sight_trials import compare

_TOLERANCE_M = 0.01


def main() -> int:
    """Compare and print."""
    parser = argparse.ArgumentParser(description="sight lines against PyBullet's rays")
    parser.add_argument("--cases", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=2)
    args = parser.parse_args()
    found = compare(args.cases, args.seed)
    print(json.dumps(asdict(found)))
    enough = found.in_view >= 0.2 * found.cases and found.near_edge >= 0.1 * found.cases
    return 0 if enough and found.farthest_m <= _TOLERANCE_M else 1


if __name__ == "__main__":
    raise SystemExit(main())
