"""A test that is skipped for a missing package fails where CI is set; other skips do not."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

_TESTS = Path(__file__).resolve().parent.parent
_BODIES = {
    "in_a_test": "def test_it():\n    pytest.importorskip('no_such_package')\n",
    "of_a_file": "pytest.importorskip('no_such_package')\n\ndef test_it():\n    pass\n",
    "by_a_mark": "@pytest.mark.skipif(True, reason='no-such-package is not installed')\ndef test_it():\n    pass\n",
    "data": "def test_it():\n    pytest.skip('no recorded inputs at ../shared/data')\n",
}


def _unsuccessful(root: Path, **environment: str) -> tuple[int, set[str]]:
    """Exit status of a run of all the tests under ``root``, and the files that failed."""
    others = {name: value for name, value in os.environ.items() if not name.startswith(("CI", "PYTEST"))}
    options = ("-q", "-p", "no:cacheprovider", "--continue-on-collection-errors", "--rootdir", str(root))
    done = subprocess.run(
        [sys.executable, "-m", "pytest", *options, "tests"],
        cwd=root, env={**others, **environment}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    return done.returncode, set(re.findall(r"^(?:FAILED|ERROR) (\S+\.py)", done.stdout, re.MULTILINE))


def test_a_missing_package_is_an_error_in_ci_and_a_skip_elsewhere(tmp_path: Path) -> None:
    for folder in ("some", "ecosystem"):
        (tmp_path / "tests" / folder).mkdir(parents=True)
        for name, body in _BODIES.items():
            (tmp_path / "tests" / folder / f"test_{folder}_{name}.py").write_text("import pytest\n\n" + body)
    (tmp_path / "tests" / "conftest.py").write_text((_TESTS / "conftest.py").read_text())
    missing = {f"tests/some/test_some_{name}.py" for name in _BODIES if name != "data"}
    assert _unsuccessful(tmp_path, CI="true") == (1, missing)
    assert _unsuccessful(tmp_path, CI="false") == (0, set())
