"""camnet runs where it may write nothing: a read-only installation, no home, not root."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

NOBODY = 65534
#: a program with one kernel; prints whether the cache had it
_KERNEL = """
import numpy as np
from camnet.geometry import rotations_compiled as r
r.multiply(np.eye(4)[0], np.eye(4)[0])
print(sum(r.multiply.stats.cache_hits.values()))
"""
pytestmark = [
    pytest.mark.skipif(sys.platform != "linux", reason="changes user as Linux does"),
    pytest.mark.skipif(
        not hasattr(os, "geteuid") or os.geteuid() != 0, reason="only root can run a program as another user"
    ),
    pytest.mark.skipif(shutil.which("setpriv") is None, reason="needs setpriv (util-linux)"),
]


class Installation:
    """A copy of the package that nobody may write, and a folder that the other user may write in."""

    def __init__(self, folder: Path, root: Path) -> None:
        self.site, self.place = folder / "site", folder / "place"
        shutil.copytree(root / "camnet", self.site / "camnet", ignore=shutil.ignore_patterns("__pycache__"))
        self.place.mkdir()
        os.chown(self.place, NOBODY, NOBODY)
        subprocess.run(["chmod", "-R", "a-w", str(self.site)], check=True)
        folder.chmod(0o755)

    def run(self, *words: str, **environment: str) -> subprocess.CompletedProcess[str]:
        """Run the interpreter as nobody, without a home."""
        kept = {k: v for k, v in os.environ.items() if k not in ("HOME", "XDG_CACHE_HOME", "CAMNET_CACHE")}
        return subprocess.run(
            [
                *("setpriv", f"--reuid={NOBODY}", f"--regid={NOBODY}", "--clear-groups"),
                *(sys.executable, "-B", *words),
            ],
            cwd=self.place,
            env={**kept, "PYTHONPATH": str(self.site), "TMPDIR": str(self.place), **environment},
            capture_output=True,
            text=True,
            check=False,
        )


@pytest.fixture(scope="module")
def installation(project_root: Path) -> Iterator[Installation]:
    # not in pytest's folder: every start of pytest, another one too, closes that to all but its user
    with tempfile.TemporaryDirectory(prefix="camnet-read-only-") as folder:
        made = Installation(Path(folder), project_root)
        if made.run("-c", "import numpy").returncode != 0:
            pytest.skip("another user cannot read this interpreter's packages")
        found = made.run("-c", "import camnet; print(camnet.__file__)").stdout.strip()
        assert found == str(made.site / "camnet" / "__init__.py")  # no other installation
        yield made
        subprocess.run(["chmod", "-R", "u+w", str(made.site)], check=True)


def test_the_environment_is_imported(installation: Installation) -> None:
    done = installation.run("-c", "import camnet.env; from camnet.env import handoff_v0")
    assert done.returncode == 0, done.stderr
    assert "cache:" not in done.stderr  # Matplotlib has something to say about its own folder


def test_kernels_are_kept_in_a_private_folder_with_one_warning(installation: Installation) -> None:
    done = installation.run("-c", _KERNEL)
    assert done.returncode == 0, done.stderr
    assert done.stderr.count("\n") == 1
    assert "are kept for this run only" in done.stderr
    assert list(installation.place.glob("camnet-cache-*")) == []  # gone with the process


def test_a_cache_that_root_has_filled_is_read(installation: Installation) -> None:
    cache = installation.site.parent / "cache"
    environment = {**os.environ, "CAMNET_CACHE": str(cache)}
    subprocess.run([sys.executable, "-c", _KERNEL], env=environment, check=True, capture_output=True)
    done = installation.run("-c", _KERNEL, CAMNET_CACHE=str(cache))
    assert done.stdout == "1\n", done.stderr


@pytest.mark.slow
@pytest.mark.parametrize(
    "words",
    [
        ("simulate", "quickstart", "--duration", "10"),
        ("evaluate", "--world", "quickstart", "--agents", "learned,nearest", "--episodes", "2"),
    ],
    ids=["simulate", "evaluate"],
)
def test_commands_run(installation: Installation, words: tuple[str, ...]) -> None:
    done = installation.run("-m", "camnet.cli.main", *words, "--quiet", "--out", "out-" + words[0])
    assert done.returncode == 0, done.stderr
    assert (installation.place / f"out-{words[0]}").is_dir()
    assert "Traceback" not in done.stderr
    assert sorted(p.name for p in installation.place.iterdir() if p.name.startswith((".", "camnet-"))) == []
