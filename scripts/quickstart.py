"""From a fresh clone to a report: make the environment, compile, simulate the quickstart network, say where to look."""

from __future__ import annotations

import _environment


def main() -> None:
    """Install camnet in ``.venv`` and run its main job."""
    _environment.prepare()
    out = _environment.ROOT / "runs" / "quickstart"
    recipe = _environment.ROOT / "configs" / "quickstart.yaml"
    _environment.run("-m", "camnet.cli.main", "warm-up", "quickstart")
    _environment.run("-m", "camnet.cli.main", "simulate", str(recipe), "--out", str(out), "--force")
    print(f"\nopen {out / 'report.html'} in a browser")


if __name__ == "__main__":
    main()
